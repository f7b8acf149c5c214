"""Restoring: files that others can read, inside the tolerance, and never outside the folder."""

from __future__ import annotations

import csv
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pybvh
import pytest
from libraries import STRANGE_NAME, copied, marker_course, short_specs, tree, write_clips

from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import SerialExecutor, executor
from motifold.pipeline.restore import Restored, restore_clips
from motifold.pipeline.run import archive_library


def restored(archive: Path, out: Path, names: list[str] | None = None, **options: Any) -> Restored:
    with Archive(archive) as opened:
        chosen = list(opened) if names is None else names
        return restore_clips(opened, chosen, out, engine=SerialExecutor(), **options)


def archived(tmp_path: Path, *names: str) -> Path:
    """Archive one short clip under several names."""
    (made,) = write_clips(tmp_path / "made", short_specs(1))
    for name in names:
        target = tmp_path / "library" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(tmp_path / "made" / made, target)
    archive_library(tmp_path / "library", tmp_path / "archive", workers=0)
    return tmp_path / "archive"


@pytest.fixture(scope="module")
def back(small_archive: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Restored]:
    out = tmp_path_factory.mktemp("restored")
    return out, restored(small_archive, out)


def test_every_clip_comes_back_under_its_name(
    small_library: Path, back: tuple[Path, Restored]
) -> None:
    out, done = back
    names = {path.name for path in small_library.iterdir()}
    assert set(tree(out)) == set(done.files) == names
    assert all(Path(path) == out / name for name, path in done.files.items())
    assert done.failures == []
    assert done.bytes == sum(map(len, tree(out).values()))


def test_what_is_written_is_inside_the_tolerance(
    small_library: Path, small_archive: Path, back: tuple[Path, Restored]
) -> None:
    with Archive(small_archive) as archive:
        for name, clip in archive.items():
            source, written = small_library / name, back[0] / name
            error = oracle.shell_error(oracle.read_bvh(source), oracle.read_bvh(written))
            rounding = 1e-4  # of the numbers in the file
            assert error.max() <= clip.certificate.maximum + rounding
            assert error.max() <= 0.1 + rounding


def test_another_library_reads_the_same_motion(
    small_library: Path, back: tuple[Path, Restored]
) -> None:
    for name in sorted(back[1].files)[::8]:
        first, second = (pybvh.read_bvh_file(folder / name) for folder in (small_library, back[0]))
        assert [node.name for node in first.nodes] == [node.name for node in second.nodes]
        assert first.frame_time == pytest.approx(second.frame_time)
        np.testing.assert_allclose(second.root_pos, first.root_pos, atol=0.11)


def test_the_layout_of_the_file_stays(small_library: Path, back: tuple[Path, Restored]) -> None:
    for name in back[1].files:
        first, second = ((folder / name).read_text() for folder in (small_library, back[0]))
        assert first.partition("MOTION")[0] == second.partition("MOTION")[0]


def test_each_kind_of_clip_gets_a_format_that_can_hold_it(
    odd_archive: Path, odd_library: Path, tmp_path: Path
) -> None:
    done = restored(odd_archive, tmp_path)
    assert {
        name: Path(path).relative_to(tmp_path).as_posix() for name, path in done.files.items()
    } == {
        "07_01.amc": "07_01.bvh",
        "Upper.BVH": "Upper.bvh",
        STRANGE_NAME: STRANGE_NAME,
        "cut.bvh": "cut.bvh",
        "markers/sway.c3d": "markers/sway.c3d.trc",
        "markers/sway.trc": "markers/sway.trc.trc",
    }
    strange = tmp_path / os.fsdecode(b"caf\xe9.bvh")
    error = oracle.shell_error(
        oracle.read_bvh(odd_library / STRANGE_NAME), oracle.read_bvh(strange)
    )
    assert error.max() < 0.1 + 1e-4


def test_restored_markers_are_inside_the_tolerance(odd_archive: Path, tmp_path: Path) -> None:
    done = restored(odd_archive, tmp_path, ["markers/sway.trc", "markers/sway.c3d"])
    for name, path in done.files.items():
        rows = list(csv.reader(Path(path).read_text().splitlines(), delimiter="\t"))
        assert rows[2][4] == "mm"
        cells = [row[2:26] for row in rows[5:] if len(row) > 2 and row[0].strip()]
        values = np.array([[float(cell or "nan") for cell in row] for row in cells])
        found = values.reshape(len(cells), 8, 3)
        gaps = np.isnan(found).any(axis=2)
        assert gaps.sum() == (10 if name.endswith("trc") else 0)
        away = np.linalg.norm(found - marker_course(), axis=2)
        assert np.nanmax(away) <= 1.0 + 1e-2  # millimetres, and rounding


def test_npz_holds_the_arrays(small_archive: Path, odd_archive: Path, tmp_path: Path) -> None:
    for archive, name in ((small_archive, None), (odd_archive, "markers/sway.trc")):
        with Archive(archive) as opened:
            clip = opened[name or next(iter(opened))]
            done = restored(archive, tmp_path, [clip.name], format="npz")
            with np.load(done.files[clip.name], allow_pickle=False) as arrays:
                np.testing.assert_array_equal(arrays["positions"], clip.positions)
                assert tuple(arrays["names"]) == clip.skeleton.names
                if name is None:
                    np.testing.assert_array_equal(arrays["rotations"], clip.rotations)


def test_the_preview_can_be_written_too(small_archive: Path, tmp_path: Path) -> None:
    with Archive(small_archive) as archive:
        name = next(iter(archive))
        decoded = archive[name].decode("preview")
    done = restored(small_archive, tmp_path, [name], tier="preview")
    error = oracle.shell_error(oracle.of_clip(decoded), oracle.read_bvh(done.files[name]))
    assert error.max() < 1e-3


def test_a_format_that_cannot_hold_a_clip_is_a_failure_of_that_clip(
    odd_archive: Path, tmp_path: Path
) -> None:
    done = restored(odd_archive, tmp_path, format="trc")
    assert sorted(done.files) == ["markers/sway.c3d", "markers/sway.trc"]
    assert len(done.failures) == 4
    assert all("cannot be written as 'trc'" in failure.reason for failure in done.failures)


def test_clips_that_would_meet_keep_their_suffix(tmp_path: Path) -> None:
    names = ("a.bvh", "a.BVH", "a.BVH.bvh", "a.BVH.bvh.bvh", "b/a.bvh", "dots.in.name.bvh")
    archive = archived(tmp_path, *names)
    done = restored(archive, tmp_path / "out")
    assert len(set(done.files.values())) == len(names) == len(tree(tmp_path / "out"))
    assert done.files["b/a.bvh"] == str(tmp_path / "out" / "b" / "a.bvh")
    assert done.files["dots.in.name.bvh"] == str(tmp_path / "out" / "dots.in.name.bvh")
    one = restored(archive, tmp_path / "one", ["a.bvh"])
    assert Path(one.files["a.bvh"]).name == "a.bvh.bvh", "however many are asked for"


@pytest.mark.parametrize("name", ["../evil.bvh", "a/../../evil.bvh", "/tmp/evil.bvh"])
def test_names_that_lead_out_of_the_folder_are_refused(
    small_archive: Path, tmp_path: Path, name: str
) -> None:
    out = tmp_path / "deep" / "out"
    with Archive(small_archive) as archive:
        good = next(iter(archive))
        row, generation = archive.rows[good]
        archive.rows[name] = replace(row, name=name), generation
        done = restore_clips(archive, [name, good], out, engine=SerialExecutor())
    assert list(done.files) == [good]
    (failure,) = done.failures
    assert "leads out of the folder" in failure.reason
    assert list(tree(tmp_path)) == [f"deep/out/{good}"]
    assert not Path("/tmp/evil.bvh").exists()


def test_a_damaged_clip_stops_nothing(small_archive: Path, tmp_path: Path) -> None:
    archive = copied(small_archive, tmp_path / "a")
    with Archive(archive) as opened:
        bad = next(iter(opened.values()))
        bad.path.write_bytes(b"MFI torn")
    done = restored(archive, tmp_path / "out")
    assert [failure.name for failure in done.failures] == [bad.name]
    assert bad.path.name in done.failures[0].reason
    assert len(done.files) == len(tree(tmp_path / "out")) == 23


def test_where_nothing_can_be_written_every_clip_says_so(
    small_archive: Path, tmp_path: Path
) -> None:
    (tmp_path / "out").write_text("a file")
    with Archive(small_archive) as archive:
        names = list(archive)[:2]
    done = restored(small_archive, tmp_path / "out", names)
    assert done.files == {}
    assert [failure.name for failure in done.failures] == names
    assert all("cannot be written" in failure.reason for failure in done.failures)


def test_workers_restore_the_same_files(
    small_archive: Path, back: tuple[Path, Restored], cluster: Any, tmp_path: Path
) -> None:
    steps = []
    with (
        Archive(small_archive) as archive,
        executor(scheduler=cluster.scheduler_address) as engine,
    ):
        names = list(archive)
        done = restore_clips(
            archive, names, tmp_path, engine=engine, progress=lambda *step: steps.append(step)
        )
    assert tree(tmp_path) == tree(back[0])
    assert list(done.files) == list(back[1].files) == names
    assert steps == [(16, 24), (24, 24)]


def test_a_large_archive_is_not_searched_for_each_clip(small_archive: Path, tmp_path: Path) -> None:
    import time

    with Archive(small_archive) as archive:
        names = list(archive)
        entry = archive.rows[names[0]]
        for number in range(20_000):
            archive.rows[f"more/{number:05d}.bvh"] = entry
        start = time.perf_counter()
        restore_clips(archive, names, tmp_path, engine=SerialExecutor())
    assert time.perf_counter() - start < 10
