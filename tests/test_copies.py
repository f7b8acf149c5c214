"""Libraries with copies in them: what is there already costs next to nothing once more."""

from __future__ import annotations

from pathlib import Path

import pytest
from clips import elsewhere, every_second, in_mirror
from libraries import short_specs

from motifold.codec.clip import SkeletonClip
from motifold.codec.formats.bvh import format_bvh
from motifold.codec.version2.motionfile import MotionFile
from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import SerialExecutor
from motifold.pipeline.plan import Settings
from motifold.pipeline.restore import restore_clips
from motifold.pipeline.run import archive_library
from motifold.pipeline.verify import verify_archive
from motifold.workflows.synthetic import synthetic_clip


def long_clip() -> SkeletonClip:
    return synthetic_clip(7, "walk-turn", 1, "normal", 1, seconds=10.0)


COPIES = {
    "copy_cut.bvh": long_clip().slice(33, 190),
    "copy_turned.bvh": elsewhere(long_clip()).slice(0, 250),
    "copy_mirrored.bvh": elsewhere(in_mirror(long_clip())).slice(20, 250),
}
LATER = {
    "later_cut.bvh": long_clip().slice(100, 290),
    "later_mirrored.bvh": in_mirror(long_clip()).slice(100, 290),
}
BEGUN = {
    "copy_cut.bvh": 33,
    "copy_turned.bvh": 0,
    "copy_mirrored.bvh": 20,
    "later_cut.bvh": 100,
    "later_mirrored.bvh": 100,
}


def sizes(archive: Archive) -> dict[str, int]:
    return {name: archive[name].path.stat().st_size for name in archive}


@pytest.mark.parametrize("streams", ["runs", "parts"])
def test_copies_of_a_library_cost_next_to_nothing(streams: str, tmp_path: Path) -> None:
    """In one job and in a later one; and they come back as exact as all others."""
    library, folder = tmp_path / "library", tmp_path / "archive"
    library.mkdir()
    for spec in short_specs(8):
        (library / f"{spec.name}.bvh").write_bytes(format_bvh(spec.clip()))
    (library / "long.bvh").write_bytes(format_bvh(long_clip()))
    for name, clip in COPIES.items():
        (library / name).write_bytes(format_bvh(clip))
    settings = Settings(tolerance=0.1, streams=streams)  # type: ignore[arg-type]
    archive_library(library, folder, settings, workers=0)
    for name, clip in LATER.items():
        (library / name).write_bytes(format_bvh(clip))
    archive_library(library, folder, settings, workers=0)
    with Archive(folder) as archive:
        found = sizes(archive)
        rate = found["long.bvh"] / archive["long.bvh"].frames
        for name, clip in {**COPIES, **LATER}.items():
            index = archive[name].index()
            assert isinstance(index, MotionFile)
            assert index.led != index.mirrored
            assert index.mirrored or "mirrored" not in name
            assert found[name] < 0.2 * rate * clip.frames, name
            assert archive.shelf.depth(index) > 0
            (follow,) = archive[name].follows
            assert follow.clip == "long.bvh"
            assert follow.begun == pytest.approx(BEGUN[name] * clip.frame_time, abs=1e-6)
            assert follow.start == 0.0
            assert follow.stop == pytest.approx(archive[name].seconds)
            assert follow.moved == (name in ("copy_turned.bvh", "copy_mirrored.bvh"))
            assert follow.mirrored == ("mirrored" in name)
        for name in found.keys() - COPIES.keys() - LATER.keys():
            index = archive[name].index()
            assert isinstance(index, MotionFile)
            assert not index.led
            assert archive[name].follows == []
        engine = SerialExecutor()
        assert verify_archive(archive, engine=engine, library=library).problems == []
        restored = restore_clips(archive, [*found], tmp_path / "back", engine=engine)
        assert not restored.failures


def test_without_references_there_are_no_copies(tmp_path: Path) -> None:
    library, folder = tmp_path / "library", tmp_path / "archive"
    library.mkdir()
    (library / "long.bvh").write_bytes(format_bvh(long_clip()))
    (library / "cut.bvh").write_bytes(format_bvh(COPIES["copy_cut.bvh"]))
    archive_library(library, folder, Settings(tolerance=0.1, references=0), workers=0)
    with Archive(folder) as archive:
        found = sizes(archive)
        assert found["cut.bvh"] > 0.4 * found["long.bvh"]


def test_two_clips_are_enough(tmp_path: Path) -> None:
    """The original is encoded first, whatever the lots say and whatever the names are."""
    library = tmp_path / "library"
    library.mkdir()
    (library / "a_cut.bvh").write_bytes(format_bvh(every_second(long_clip())))
    (library / "b_long.bvh").write_bytes(format_bvh(long_clip()))
    for seed in range(3):
        folder = tmp_path / f"archive {seed}"
        archive_library(library, folder, Settings(tolerance=0.1, seed=seed), workers=0)
        with Archive(folder) as archive:
            rates = {archive.rig(clip.row.rig).frame_time for clip in archive.values()}
            assert len(rates) == 2
            found = sizes(archive)
            assert found["a_cut.bvh"] < 0.15 * found["b_long.bvh"]
