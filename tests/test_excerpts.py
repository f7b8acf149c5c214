"""Excerpts of clips as files: some body parts, some seconds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from libraries import CLIPS

from motifold.codec.clip import MarkerClip, SkeletonClip
from motifold.codec.errors import UsageError
from motifold.codec.formats.files import read_clip
from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import SerialExecutor
from motifold.pipeline.restore import Excerpt, Restored, restore_clips


def restored(archive: Path, out: Path, excerpt: Excerpt, **options: Any) -> Restored:
    with Archive(archive) as opened:
        return restore_clips(
            opened, list(opened), out, engine=SerialExecutor(), excerpt=excerpt, **options
        )


def test_excerpts_are_files_of_their_own(small_archive: Path, tmp_path: Path) -> None:
    done = restored(small_archive, tmp_path, Excerpt(("left_arm",), 0.5, 1.0))
    assert not done.failures
    with Archive(small_archive) as archive:
        for name, path in done.files.items():
            clip = archive[name]
            names = {part.name: part for part in clip.rig.parts}
            with np.load(path) as arrays:
                found = list(arrays["names"])
                joints = [clip.skeleton.names.index(joint) for joint in found]
                assert joints == sorted(joints)
                assert {*names["left_arm"].joints, 0} < set(joints)
                assert not {*names["right_leg"].joints, *names["right_arm"].joints} & set(joints)
                np.testing.assert_allclose(
                    arrays["positions"], clip.positions[15:31, joints], rtol=0, atol=1e-9
                )
                above = [found[parent] if parent >= 0 else "" for parent in arrays["parents"]]
                parents = [int(clip.skeleton.parents[joint]) for joint in joints]
                assert above == [clip.skeleton.names[j] if j >= 0 else "" for j in parents]
                assert set(arrays["end_parents"]) <= set(range(len(joints)))


def test_a_time_range_may_be_a_bvh_file(small_archive: Path, tmp_path: Path) -> None:
    done = restored(small_archive, tmp_path, Excerpt((), 0.5))
    with Archive(small_archive) as archive:
        for name, path in done.files.items():
            assert path.endswith(".bvh")
            found, whole = read_clip(path), archive[name].clip
            assert isinstance(found, SkeletonClip)
            assert isinstance(whole, SkeletonClip)
            np.testing.assert_allclose(found.rotations, whole.rotations[15:], rtol=0, atol=1e-4)
    late = restored(small_archive, tmp_path, Excerpt((), 99.0))
    assert len(late.failures) == CLIPS
    assert "it ends after 2" in late.failures[0].reason


def test_parts_of_markers_are_trc_files(odd_archive: Path, tmp_path: Path) -> None:
    with Archive(odd_archive) as archive:
        clip = archive["markers/sway.trc"]
        part = clip.rig.parts[-1]
        wanted = clip.decode(parts=[part.name], stop=11)
        assert isinstance(wanted, MarkerClip)
        seen = np.flatnonzero(~np.isnan(wanted.positions).all(axis=(0, 2)))
        done = restored(odd_archive, tmp_path, Excerpt((part.name,), None, 0.1))
        found = read_clip(done.files[clip.name])
        assert isinstance(found, MarkerClip)
        assert found.names == tuple(wanted.names[marker] for marker in seen)
        assert 0 < len(seen) < len(wanted.names)
        np.testing.assert_allclose(found.positions, wanted.positions[:, seen], atol=1e-5)
        assert all("no body part" in failure.reason for failure in done.failures)


def test_excerpts_that_cannot_be_are_refused(small_archive: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="BVH file cannot hold"):
        restored(small_archive, tmp_path, Excerpt(("left_arm",)), format="bvh")
    with pytest.raises(UsageError, match="between 2 s and 1 s"):
        Excerpt((), 2.0, 1.0)
    done = restored(small_archive, tmp_path, Excerpt(("tail",)))
    assert len(done.failures) == CLIPS
    assert "no body part tail" in done.failures[0].reason
