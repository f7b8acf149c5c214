"""Clips cut into segments, part by part."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clips import Recipe, marker_bench, recipes, skeleton_bench
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.errors import UsageError
from motifold.codec.patterns.segments import (
    MOST_SECONDS,
    SegmentRules,
    Segments,
    clip_segments,
    cut,
    most_frames,
)

METHODS = st.sampled_from(["threshold", "fisher"])


def assert_sound(part: Segments, frames: int, frame_time: float, channels: int) -> None:
    assert part.borders[0] == 0
    assert part.borders[-1] == frames
    lengths = np.diff(part.borders)
    assert (lengths > 0).all()
    assert lengths.max(initial=0) <= most_frames(frame_time)
    assert part.points.shape == (len(lengths), 16, channels)
    assert np.isfinite(part.points).all()


@given(recipes(most_joints=12, most_frames=120), METHODS)
@settings(max_examples=40, deadline=None)
def test_every_part_is_cut_from_end_to_end(recipe: Recipe, method: str) -> None:
    bench = skeleton_bench(recipe)
    rules = SegmentRules(method=method)  # type: ignore[arg-type]
    cuts = clip_segments(bench.clip, bench.codebook.family, rules)
    for part, made in zip(bench.rig.parts, cuts, strict=True):
        assert (made is None) == (part.parent < 0)
        if made is not None:
            frame_time = bench.clip.frame_time
            assert_sound(made, recipe.frames, frame_time, 3 * len(part.joints))


@given(st.integers(0, 2**32 - 1), st.integers(0, 100), METHODS)
@settings(max_examples=30, deadline=None)
def test_markers_with_gaps_are_cut_from_end_to_end(seed: int, frames: int, method: str) -> None:
    bench = marker_bench(seed, 9, frames, gaps=0.6)
    rules = SegmentRules(method=method)  # type: ignore[arg-type]
    for part, made in zip(
        bench.rig.parts, clip_segments(bench.clip, bench.codebook.family, rules), strict=True
    ):
        if made is not None:
            assert_sound(made, frames, bench.clip.frame_time, 3 * len(part.joints))


def test_points_are_the_segments_ends() -> None:
    bench = skeleton_bench(Recipe(2, joints=9, frames=100))
    signal = np.cumsum(np.random.default_rng(0).normal(size=(100, 6)), axis=0)
    made = cut(signal, 20.0, bench.clip.frame_time, SegmentRules())
    assert np.array_equal(made.points[:, 0], signal[made.borders[:-1]])
    assert np.array_equal(made.points[:, -1], signal[made.borders[1:] - 1])


def test_segments_are_neither_too_short_nor_too_long() -> None:
    rng = np.random.default_rng(1)
    signal = np.cumsum(rng.normal(size=(3000, 6)) * 3, axis=0)
    for rate in (30.0, 120.0):
        lengths = np.diff(cut(signal, 20.0, 1 / rate, SegmentRules()).borders)
        assert lengths.min() >= round(0.25 * rate)
        assert lengths.max() <= round(MOST_SECONDS * rate)
    still = np.diff(cut(np.zeros((3000, 6)), 20.0, 1 / 30, SegmentRules()).borders)
    assert still.max() == round(MOST_SECONDS * 30)


@pytest.mark.parametrize(
    ("frame_time", "most"), [(1 / 30, 48), (1 / 120, 192), (1e-6, 1024), (1.0, 8), (1e3, 8)]
)
def test_the_longest_segment_follows_the_frame_time(frame_time: float, most: int) -> None:
    assert most_frames(frame_time) == most


def test_unknown_methods_are_refused() -> None:
    with pytest.raises(UsageError, match="Use threshold or fisher"):
        replace(SegmentRules(), method="guess")  # type: ignore[arg-type]
