"""What is kept for later jobs: it comes back about as it was, and nothing needs it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from libraries import copied, short_specs, write_clips

from motifold.codec.learned.landmarks import NUMBERS, Landmarks
from motifold.codec.learned.sketch import SKETCH_NUMBERS
from motifold.pipeline.archive import Archive
from motifold.pipeline.layout import TRAITS, archive_bytes
from motifold.pipeline.plan import Settings
from motifold.pipeline.run import archive_library
from motifold.pipeline.traits import POSE_UNITS, Trait, read_traits, write_traits

CLIPS = 6


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("traits")
    write_clips(folder / "library", short_specs(CLIPS))
    archive_library(folder / "library", folder / "archive", Settings(), workers=0)
    return folder / "archive"


def some_trait(rng: np.random.Generator, size: float) -> Trait:
    moments, landmarks = rng.integers(0, 9, 2).tolist()
    sketch = np.rint(size * rng.standard_cauchy((moments, SKETCH_NUMBERS))).astype(np.float32)
    poses = rng.normal(0.0, 80.0, (landmarks, NUMBERS)).astype(np.float32)
    frames = np.sort(rng.choice(500, landmarks, replace=False))
    return Trait(sketch, Landmarks(frames, poses, 500, 1 / 30), int(rng.integers(0, 6)))


@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 1e3))
@settings(max_examples=30)
def test_what_is_kept_is_about_what_was(archive: Path, seed: int, size: float) -> None:
    rng = np.random.default_rng(seed)
    traits = [some_trait(rng, size) for _ in range(CLIPS)]
    with Archive(archive) as opened:
        folder = copied(archive, archive.parent / f"copy {seed}")
        write_traits(folder, 1, [row.name for row in opened.numbered], traits)
    with Archive(folder) as opened:
        found = read_traits(opened)
    shutil.rmtree(folder)
    assert list(found) == list(range(CLIPS))
    largest = max((float(np.abs(t.sketch).max(initial=0.0)) for t in traits), default=0.0)
    for number, trait in enumerate(traits):
        kept = found[number]
        assert kept.depth == trait.depth
        assert kept.landmarks.length == 500
        np.testing.assert_array_equal(kept.landmarks.frames, trait.landmarks.frames)
        off = np.abs(kept.landmarks.poses - trait.landmarks.poses)
        assert off.max(initial=0.0) <= 0.5 / POSE_UNITS + 1e-3
        # roots are kept in steps of 1/127: so much of a number, and of the largest
        bound = np.sqrt(np.abs(trait.sketch) * max(largest, 1.0)) / 127 + max(largest, 1.0) / 127**2
        assert (np.abs(kept.sketch - trait.sketch) <= bound + 0.5).all()
        np.testing.assert_array_equal(kept.sketch, np.rint(kept.sketch))


def test_a_job_keeps_what_it_sketched(archive: Path) -> None:
    with Archive(archive) as opened:
        found = read_traits(opened)
        assert list(found) == list(range(CLIPS))
        for number, row in enumerate(opened.numbered):
            assert found[number].landmarks.length == row.frames
            file = opened[row.name].index()
            assert found[number].depth == opened.shelf.depth(file)  # type: ignore[arg-type]


@pytest.mark.parametrize("damage", ["gone", "torn", "changed", "other names"])
def test_without_what_was_kept_a_job_goes_on(archive: Path, damage: str, tmp_path: Path) -> None:
    folder = copied(archive, tmp_path / "archive")
    (path,) = (folder / TRAITS).iterdir()
    data = path.read_bytes()
    if damage == "gone":
        path.unlink()
    elif damage == "other names":  # of a job that was never published
        with Archive(folder) as opened:
            traits = list(read_traits(opened).values())
            write_traits(folder, 1, [f"{row.name} " for row in opened.numbered], traits)
    else:
        middle = len(data) // 2
        path.write_bytes(data[:middle] if damage == "torn" else data[:-9] + bytes(9))
    with Archive(folder) as opened:
        assert read_traits(opened) == {}
    library = tmp_path / "library"
    write_clips(library, short_specs(CLIPS + 2))
    report = archive_library(library, folder, Settings(), workers=0)
    assert (report.clips, report.unchanged, report.failures) == (2, CLIPS, [])
    with Archive(folder) as opened:
        assert all(clip.decode() for clip in opened.values())
        assert list(read_traits(opened)) == [CLIPS, CLIPS + 1]


def test_it_is_not_counted_and_not_needed(archive: Path, tmp_path: Path) -> None:
    folder = copied(archive, tmp_path / "archive")
    whole = archive_bytes(folder)
    shutil.rmtree(folder / TRAITS)
    assert archive_bytes(folder) == whole
    with Archive(folder) as opened:
        assert all(clip.decode() for clip in opened.values())
