"""Finding the clips of a library: one order, globs, and nothing left out in silence."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.errors import UsageError
from motifold.pipeline.discover import discover

FILES = ["walk/01.bvh", "walk/02.BVH", "walk.bvh", "a/b/c.trc", "z.c3d", "07/07_01.amc"]


def library(folder: Path, files: list[str]) -> Path:
    for number, name in enumerate(files):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x" * number)
    return folder


def names(folder: Path, *globs: str) -> list[str]:
    return [source.name for source in discover(folder, globs)]


@given(st.permutations(FILES))
def test_the_order_is_that_of_the_names_however_they_were_made(
    tmp_path_factory: pytest.TempPathFactory, files: list[str]
) -> None:
    folder = library(tmp_path_factory.mktemp("library"), files)
    assert names(folder) == sorted(FILES)


def test_sources_name_the_file_and_its_size(tmp_path: Path) -> None:
    for source in discover(library(tmp_path, FILES)):
        assert Path(source.path) == tmp_path / source.name
        assert source.size == FILES.index(source.name)


def test_only_motion_files_are_found(tmp_path: Path) -> None:
    library(tmp_path, [*FILES, "readme.txt", "07/07.asf", "bvh", ".bvh", "a.bvh.bak", "x.npz"])
    assert names(tmp_path) == sorted(FILES)


@pytest.mark.parametrize(
    ("globs", "expected"),
    [
        (["*.trc"], ["a/b/c.trc"]),
        (["walk/*"], ["walk/01.bvh", "walk/02.BVH"]),
        (["01.bvh", "z.c3d"], ["walk/01.bvh", "z.c3d"]),
        (["*"], sorted(FILES)),
        (["a/*"], ["a/b/c.trc"]),
    ],
)
def test_globs_match_the_name_or_the_base_name(
    tmp_path: Path, globs: list[str], expected: list[str]
) -> None:
    assert names(library(tmp_path, FILES), *globs) == expected


def test_nothing_to_archive_is_an_error_that_says_what_could_be(tmp_path: Path) -> None:
    library(tmp_path, ["readme.txt", "a.bvh"])
    with pytest.raises(UsageError, match=r"no motion files that match \*\.c3d.*\.amc, \.bvh"):
        discover(tmp_path, ["*.c3d"])
    with pytest.raises(UsageError, match="no such folder"):
        discover(tmp_path / "nowhere")


def test_one_file_is_a_library_of_one(tmp_path: Path) -> None:
    library(tmp_path, ["a.bvh", "b.bvh"])
    assert names(tmp_path / "b.bvh") == ["b.bvh"]


def test_paths_are_absolute_so_that_workers_find_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library(tmp_path / "here", FILES)
    monkeypatch.chdir(tmp_path)
    for relative in (Path("here"), Path("here/walk.bvh")):
        for source in discover(relative):
            assert Path(source.path).is_absolute()
            assert Path(source.path).is_file()


def test_links_to_files_are_followed_and_to_folders_not(tmp_path: Path) -> None:
    outside = library(tmp_path / "outside", ["a.bvh", "deep/b.bvh"])
    inside = library(tmp_path / "inside", ["own.bvh"])
    (inside / "linked.bvh").symlink_to(outside / "a.bvh")
    (inside / "deep").symlink_to(outside / "deep")
    (inside / "loop").symlink_to(inside)
    assert names(inside) == ["linked.bvh", "own.bvh"]


def test_a_dangling_link_is_listed_and_a_pipe_is_not(tmp_path: Path) -> None:
    library(tmp_path, ["own.bvh"])
    (tmp_path / "gone.bvh").symlink_to(tmp_path / "nowhere.bvh")
    os.mkfifo(tmp_path / "pipe.bvh")
    (tmp_path / "folder.bvh").mkdir()
    assert names(tmp_path) == ["gone.bvh", "own.bvh"]


def test_a_folder_that_cannot_be_listed_is_not_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    library(tmp_path, FILES)
    real = os.scandir

    def scandir(folder: str) -> object:
        if Path(folder).name == "walk":
            raise PermissionError(13, "Permission denied", folder)
        return real(folder)

    monkeypatch.setattr(os, "scandir", scandir)
    assert names(tmp_path) == sorted({*FILES, "walk"} - {"walk/01.bvh", "walk/02.BVH"})


def test_names_need_not_be_text(tmp_path: Path) -> None:
    path = os.fsencode(tmp_path) + b"/caf\xe9.bvh"
    Path(os.fsdecode(path)).write_bytes(b"x")
    (name,) = names(tmp_path)
    assert os.fsencode(name) == b"caf\xe9.bvh"


def test_a_large_folder_keeps_its_order(tmp_path: Path) -> None:
    files = [f"{number:04d}.bvh" for number in range(500)]
    random.Random(0).shuffle(files)
    assert names(library(tmp_path, files)) == sorted(files)
