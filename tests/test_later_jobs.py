"""What later jobs make of what earlier ones left: empty clips, replaced ones, dead jobs."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from libraries import short_specs, write_clips

from motifold.codec.clip import SkeletonClip
from motifold.codec.errors import DamagedError
from motifold.codec.formats.bvh import format_bvh
from motifold.codec.learned.landmarks import NUMBERS, Landmarks
from motifold.codec.version2.motionhead import Named
from motifold.pipeline import archived_clip
from motifold.pipeline.archive import Archive
from motifold.pipeline.copies import find_copies
from motifold.pipeline.executors import SerialExecutor
from motifold.pipeline.layout import TRAITS, traits_path
from motifold.pipeline.plan import Settings
from motifold.pipeline.run import archive_library
from motifold.pipeline.traits import read_traits
from motifold.pipeline.verify import verify_archive
from motifold.workflows.synthetic import synthetic_clip


def take(number: int) -> SkeletonClip:
    return synthetic_clip(7, "walk-turn", 1, "normal", number, seconds=15.0)


def write(path: Path, clip: SkeletonClip) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(format_bvh(clip))


@pytest.mark.parametrize("keep", [True, False], ids=["traits kept", "traits lost"])
def test_clips_without_frames_stop_no_job(keep: bool, tmp_path: Path) -> None:
    """Neither one that learns a model, nor one that looks for references among them."""
    library, folder = tmp_path / "library", tmp_path / "archive"
    write(library / "walk.bvh", take(1))
    write(library / "empty.bvh", take(1).slice(0, 0))
    assert not archive_library(library, folder, Settings(), workers=0).failures
    if not keep:
        shutil.rmtree(folder / TRAITS)
    write(library / "more.bvh", take(2))
    assert not archive_library(library, folder, Settings(), workers=0).failures
    with Archive(folder) as archive:
        assert archive["empty.bvh"].frames == 0
        engine = SerialExecutor()
        assert verify_archive(archive, engine=engine, library=library).problems == []


@pytest.fixture
def followed(tmp_path: Path) -> Path:
    """An archive of a clip, an excerpt of it, and the excerpt once more."""
    library = tmp_path / "library"
    write(library / "long.bvh", take(1))
    for name in ("cut.bvh", "cut_twin.bvh"):
        write(library / name, take(1).slice(60, 260))
    archive_library(library, tmp_path / "archive", Settings(), workers=0)
    return tmp_path / "archive"


def test_twins_are_as_deep_as_each_other(followed: Path) -> None:
    with Archive(followed) as archive:
        traits = read_traits(archive)
        depths = {row.name: traits[at].depth for at, row in enumerate(archive.numbered)}
    assert depths["long.bvh"] < depths["cut.bvh"] == depths["cut_twin.bvh"]


def test_a_clip_may_follow_a_version_that_was_replaced(followed: Path) -> None:
    with Archive(followed) as archive:
        (follow,) = archive["cut.bvh"].follows
        assert not follow.replaced
    write(followed.parent / "library" / "long.bvh", take(2))
    archive_library(followed.parent / "library", followed, Settings(), workers=0)
    with Archive(followed) as archive:
        (follow,) = archive["cut.bvh"].follows
        assert follow == (*follow[:-1], True)
        assert follow.clip == "long.bvh"


def test_a_clip_that_follows_one_that_is_not_there(
    followed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(archived_clip, "read_references", lambda file: (Named(3),))
    with Archive(followed) as archive, pytest.raises(DamagedError, match="clip 3 of 3"):
        _ = archive["cut.bvh"].follows


def test_traits_of_a_dead_job_are_no_others(tmp_path: Path) -> None:
    """A job that died before it was published left some; the next one keeps none."""
    library, folder = tmp_path / "library", tmp_path / "archive"
    write_clips(library, short_specs(4))
    archive_library(library, folder, Settings(), workers=0)
    shutil.copy(traits_path(folder, 1), traits_path(folder, 2))
    write_clips(library, short_specs(2, start=4))
    archive_library(library, folder, Settings(codec="patterns"), workers=0)
    assert not traits_path(folder, 2).exists()


def test_a_frame_time_in_a_wrong_unit_makes_no_copies() -> None:
    """Each landmark of it would agree with all of the original's about the shift."""
    poses = np.random.default_rng(0).normal(0.0, 50.0, (12, NUMBERS)).astype(np.float32)
    original = Landmarks(20 * np.arange(12), poses, 300, 1 / 30)
    assert [len(each) for each in find_copies([original, original])] == [0, 1]
    slow = replace(original, frame_time=1e5 / 30)
    assert [len(each) for each in find_copies([original, slow])] == [0, 0]
