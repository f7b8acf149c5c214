"""What a person allows, and what it means for the joints and frames of one clip."""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatchcase
from typing import TypeAlias

import numpy as np
import pytest
from clips import Recipe, marker_clip, recipes, skeleton_clip
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.clip import Clip, MarkerClip, SkeletonClip
from motifold.codec.geometry.limits import Bounds, Limits, limits_of, uniform_limits

Joints: TypeAlias = tuple[tuple[str, float], ...]
Spans: TypeAlias = tuple[tuple[float, float, float], ...]

TOLERANCES = st.floats(1e-4, 10.0)
PATTERNS = st.sampled_from(["joint0", "joint1*", "*", "nobody", "JOINT0", "joint[2-5]", "?oint3"])
JOINTS = st.lists(st.tuples(PATTERNS, TOLERANCES), max_size=4).map(tuple)
# times that no frame falls on, so that no rounding decides
TIMES = st.integers(0, 400).map(lambda tick: tick / 60 + 0.001)
SPANS = st.lists(st.tuples(TIMES, TIMES, TOLERANCES), max_size=4).map(tuple)


def owners_of(clip: Clip) -> list[str]:
    """The joint that each joint's, end site's or marker's limit goes with."""
    if isinstance(clip, MarkerClip):
        return list(clip.names)
    names = clip.skeleton.names
    return [*names, *(names[carrier] for carrier in clip.skeleton.end_parents)]


@given(recipes(12, 200), TOLERANCES, st.one_of(st.none(), TOLERANCES), JOINTS, SPANS)
def test_a_joint_s_own_bound_holds_and_in_a_span_the_narrower(
    recipe: Recipe, tolerance: float, mean: float | None, joints: Joints, spans: Spans
) -> None:
    """Against every joint and frame on its own."""
    clip = skeleton_clip(replace(recipe, rate=30.0))
    limits = limits_of(clip, Bounds(tolerance, mean, joints, spans))
    assert limits.mean == mean
    owners = owners_of(clip)
    assert limits.joints.shape == (len(owners),)
    for owner, limit in zip(owners, limits.joints.tolist(), strict=True):
        assert limit == min([w for p, w in joints if fnmatchcase(owner, p)], default=tolerance)
    widest = max([tolerance, *limits.joints.tolist()])
    assert limits.frames.shape == (clip.frames,)
    for frame, limit in enumerate(limits.frames.tolist()):
        seconds = frame / 30.0
        assert limit == min([widest, *(w for a, b, w in spans if a <= seconds <= b)])
    assert limits.least == min([*limits.joints, *limits.frames])
    wide = {*limits.joints.tolist(), *limits.frames.tolist()}
    assert limits.uniform == (len(wide) == 1)


@given(st.integers(0, 99), JOINTS)
def test_bounds_of_markers_go_by_their_names(seed: int, joints: Joints) -> None:
    clip = replace(marker_clip(seed, 4, 10), names=("joint0", "joint10", "nose", "joint3"))
    limits = limits_of(clip, Bounds(1.0, None, joints))
    for name, limit in zip(clip.names, limits.joints.tolist(), strict=True):
        assert limit == min([w for p, w in joints if fnmatchcase(name, p)], default=1.0)


def test_plain_bounds_are_uniform_limits() -> None:
    clip = skeleton_clip(Recipe())
    assert Bounds(0.3).plain
    assert not Bounds(0.3, None, (("a", 1.0),)).plain
    assert not Bounds(0.3, None, (), ((0.0, 1.0, 1.0),)).plain
    found, wanted = limits_of(clip, Bounds(0.3, 0.1)), uniform_limits(clip, 0.3, 0.1)
    assert found.uniform
    assert np.array_equal(found.joints, wanted.joints)
    assert np.array_equal(found.frames, wanted.frames)
    assert found.least == 0.3


def test_the_ends_of_a_span_are_inside() -> None:
    clip = skeleton_clip(Recipe(frames=40, rate=8.0))  # an eighth is exact
    frames = limits_of(clip, Bounds(1.0, None, (), ((1.0, 2.0, 0.1),))).frames
    assert np.flatnonzero(frames == 0.1).tolist() == list(range(8, 17))


def shifted(clip: SkeletonClip, by: float) -> SkeletonClip:
    """The clip with its root moved along x, centimetres."""
    moved = clip.translations.copy()
    moved[:, 0, 0] += by
    return replace(clip, translations=moved)


@given(recipes(12, 40), st.floats(1e-3, 5.0), JOINTS, SPANS)
def test_excess_of_a_clip_shifted_as_a_whole(
    recipe: Recipe, by: float, joints: Joints, spans: Spans
) -> None:
    """All errors are the same then, so that the narrowest limit tells."""
    clip = skeleton_clip(recipe)
    limits = limits_of(clip, Bounds(1.0, None, joints, spans))
    wanted = by / limits.least if clip.frames else 0.0
    assert limits.excess(clip, shifted(clip, by)) == pytest.approx(wanted, rel=1e-6, abs=1e-9)
    assert limits.excess(clip, clip) == 0.0


def test_excess_is_that_of_the_joint_and_frame_that_is_worst_for_its_limit() -> None:
    clip = skeleton_clip(Recipe(joints=4, tree="chain", frames=10, stretchy=0.0))
    points = 4 + len(clip.skeleton.end_parents)
    limits = Limits(np.full(points, 2.0), np.full(10, 4.0))
    limits.frames[7] = 0.5
    moved = clip.translations.copy()
    moved[2, 0, 1] += 3.0
    moved[7, 0, 1] += 1.0
    decoded = replace(clip, translations=moved)
    assert limits.excess(clip, decoded) == pytest.approx(2.0)
    limits.joints[3] = 0.1
    assert limits.excess(clip, decoded) == pytest.approx(30.0)


def test_a_turned_joint_counts_where_it_carries_nothing() -> None:
    clip = skeleton_clip(Recipe(joints=1, frames=3, motion="still", bone=0.0))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    decoded = replace(clip, rotations=clip.rotations @ turn)
    shell = 3.0 * np.sqrt(2.0)  # a quarter turn of points 3 cm off
    assert uniform_limits(clip, 0.5).excess(clip, decoded) == pytest.approx(shell / 0.5)


def test_excess_of_markers_leaves_gaps_out() -> None:
    clip = marker_clip(3, 3, 20, gaps=0.0)
    gappy = clip.positions.copy()
    gappy[5:8, 1] = np.nan
    original = replace(clip, positions=gappy)
    decoded = replace(clip, positions=clip.positions + np.array([0.0, 0.3, 0.4]))
    limits = limits_of(clip, Bounds(1.0, None, (("M1", 0.25),)))
    assert limits.excess(original, decoded) == pytest.approx(2.0)
    far = decoded.positions.copy()
    far[5:8, 1] += 1e6
    assert limits.excess(original, replace(decoded, positions=far)) == pytest.approx(2.0)


def test_a_clip_of_no_frames_is_inside_any_limits() -> None:
    clip = skeleton_clip(Recipe(frames=0))
    limits = limits_of(clip, Bounds(0.3, None, (("joint1", 0.1),), ((0.0, 9.0, 0.05),)))
    assert limits.least == 0.1
    assert limits.excess(clip, clip) == 0.0
