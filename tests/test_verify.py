"""Verifying: whatever byte of an archive is changed, it is found, and nothing wrong comes out."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from libraries import CLIPS, copied, tree

from motifold.codec.errors import DamagedError, MotifoldError, NotAnArchiveError, VersionError
from motifold.codec.formats.files import clip_bytes
from motifold.pipeline import verify as module
from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import SerialExecutor, executor
from motifold.pipeline.layout import TRAITS, index_path
from motifold.pipeline.verify import Verified, verify_archive

FLIPS = (0x01, 0x10, 0x80)


def verified(archive: Path, **options: Any) -> Verified:
    with Archive(archive) as opened:
        return verify_archive(opened, engine=SerialExecutor(), **options)


def decoded(archive: Path) -> dict[str, bytes]:
    with Archive(archive) as opened:
        return {name: clip_bytes(clip.decode(), "npz") for name, clip in opened.items()}


def state(archive: Path) -> Any:
    """What COMMIT.json says, however it is laid out."""
    return json.loads((archive / "COMMIT.json").read_text())


def test_a_whole_archive_has_no_problems(small_archive: Path, small_library: Path) -> None:
    quick = verified(small_archive)
    assert (quick.clips, quick.decoded, quick.measured) == (CLIPS, 0, 0)
    full = verified(small_archive, decode=True)
    assert (full.clips, full.decoded, full.measured) == (CLIPS, CLIPS, 0)
    measured = verified(small_archive, library=small_library)
    assert (measured.clips, measured.decoded, measured.measured) == (CLIPS, CLIPS, CLIPS)
    for found in (quick, full, measured):
        assert found.problems == []
        assert found.orphans == 0
        assert 0.05 < found.max_error <= 0.1
    assert measured.max_error == pytest.approx(quick.max_error, rel=7e-4)  # its code


def test_workers_find_the_same(
    small_archive: Path, small_library: Path, cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "BATCH_CLIPS", 5)
    with Archive(small_archive) as opened, executor(scheduler=cluster.scheduler_address) as engine:
        found = verify_archive(opened, engine=engine, library=small_library)
    assert found == verified(small_archive, library=small_library)


def test_a_changed_byte_is_found_in_every_file(tiny_archive: Path, tmp_path: Path) -> None:
    archive = copied(tiny_archive, tmp_path / "a")
    whole, before, commit = tree(archive), decoded(archive), state(archive)
    assert len([name for name in whole if name.endswith(".mfi")]) == 3, "one is superseded"
    rng = np.random.default_rng(0)
    for name, data in sorted(whole.items()):
        path = archive / name
        places = {0, len(data) - 1, *rng.integers(0, len(data), 2).tolist()}
        for place in places:
            flip = FLIPS[int(rng.integers(len(FLIPS)))]
            path.write_bytes(data[:place] + bytes([data[place] ^ flip]) + data[place + 1 :])
            assert_found(archive, path, before, commit)
        path.write_bytes(data)
    assert verified(archive).problems == []


def test_every_byte_of_commit_json_counts(tiny_archive: Path, tmp_path: Path) -> None:
    archive = copied(tiny_archive, tmp_path / "a")
    path, before, commit = archive / "COMMIT.json", decoded(archive), state(archive)
    data = path.read_bytes()
    for place in range(len(data)):
        flip = FLIPS[place % 2]
        path.write_bytes(data[:place] + bytes([data[place] ^ flip]) + data[place + 1 :])
        assert_found(archive, path, before, commit)


def assert_found(archive: Path, path: Path, before: dict[str, bytes], commit: Any) -> None:
    """Damage to ``path`` is told with its name, and no clip comes out wrong."""
    try:
        found = verified(archive).problems
    except (DamagedError, VersionError, NotAnArchiveError) as problem:
        found = [str(problem)]
    harmless = path.name == "COMMIT.json" and not found and state(archive) == commit
    if not harmless:
        assert found, f"{path} is damaged, and nobody knows"
        if path.name != "COMMIT.json":  # whose damage shows where it points to
            assert any(path.name in problem for problem in found), found
    try:
        with Archive(archive) as opened:
            names = list(opened)
            for name in names:
                try:
                    clip = opened[name].decode()
                except MotifoldError:
                    continue
                assert clip_bytes(clip, "npz") == before[name], f"{name} is silently wrong"
    except (DamagedError, VersionError, NotAnArchiveError):
        pass


def test_a_missing_file_is_found(tiny_archive: Path, tmp_path: Path) -> None:
    archive = copied(tiny_archive, tmp_path / "a")
    for name, data in sorted(tree(archive).items()):
        if name.startswith(f"{TRAITS}/"):
            continue  # which may be deleted
        (archive / name).unlink()
        try:
            found = verified(archive).problems
        except (DamagedError, NotAnArchiveError) as problem:
            found = [str(problem)]
        assert found, name
        if name != "COMMIT.json":
            assert any(Path(name).name in problem for problem in found)
        (archive / name).write_bytes(data)


def test_a_file_that_does_not_belong_to_the_store_is_found(
    tiny_archive: Path, tmp_path: Path
) -> None:
    archive = copied(tiny_archive, tmp_path / "a")
    (archive / "store.zarr" / "000001" / "stranger").write_text("")
    (problem,) = verified(archive).problems
    assert "stranger does not belong here" in problem


def test_index_files_of_nobody_are_counted_and_harmless(tiny_archive: Path, tmp_path: Path) -> None:
    archive = copied(tiny_archive, tmp_path / "a")
    path = index_path(archive, "0123456789abcdef")
    path.parent.mkdir()
    path.write_bytes(b"")
    found = verified(archive)
    assert (found.problems, found.orphans) == ([], 1)


def test_a_source_that_changed_is_told(
    small_archive: Path, small_library: Path, tmp_path: Path
) -> None:
    library = tmp_path / "l"
    shutil.copytree(small_library, library)
    names = sorted(path.name for path in library.iterdir())
    shutil.copy(library / names[-1], library / names[0])
    (library / names[1]).unlink()
    (library / names[2]).write_text("torn")
    found = verified(small_archive, library=library)
    assert found.measured == CLIPS - 3
    assert [problem.partition(":")[0] for problem in found.problems] == names[:3]
    assert "has changed since it was archived" in found.problems[0]


def test_a_certificate_that_is_too_good_to_be_true_is_told(
    small_archive: Path, small_library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from motifold.codec.geometry.metrics import Errors

    monkeypatch.setattr(module, "measure", lambda *_: Errors(0.09999999, 0.01, 0.05))
    found = verified(small_archive, library=small_library)
    assert len(found.problems) >= CLIPS - 3
    assert all("off its source, but certifies" in problem for problem in found.problems)


def test_a_certificate_outside_the_tolerance_of_its_job_is_told(
    small_archive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from motifold.pipeline.archived_clip import ArchivedClip

    monkeypatch.setattr(ArchivedClip, "tolerance", 0.001)
    assert all("outside 0.001 cm" in problem for problem in verified(small_archive).problems)
    assert len(verified(small_archive).problems) == CLIPS


def test_a_library_of_one_file(small_library: Path, tmp_path: Path) -> None:
    from motifold.pipeline.run import archive_library

    source = next(iter(sorted(small_library.iterdir())))
    archive_library(source, tmp_path / "a", workers=0)
    found = verified(tmp_path / "a", library=source)
    assert (found.measured, found.problems) == (1, [])
