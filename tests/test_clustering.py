"""Clustering: the bound holds when measured by brute force, and patterns are only ever added."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.patterns.nearest import NearestPatterns
from motifold.codec.patterns.patterns import to_centimetres
from motifold.pipeline.clustering import ClusterRules, Representatives, grow, within_clip
from motifold.pipeline.executors import one_thread

FRAMES, CHANNELS = 16, 6
RADIUS = 12.0
AVERAGE = ClusterRules("average")
Points = npt.NDArray[np.float64]


def segments(seed: int, count: int, spread: float, kinds: int = 5) -> Points:
    """Draw smooth segments (count, 16, 6), centimetres, around a few kinds of motion."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0, np.pi, FRAMES)[:, None]
    kind = rng.integers(0, kinds, count)
    rest, swing = np.random.default_rng(99).normal(0, 25, (2, kinds, 1, CHANNELS))
    shapes = rest[kind] + swing[kind] * np.sin(phase)
    own = rng.normal(0, spread, (count, 1, CHANNELS)) + rng.normal(
        0, spread, (count, 1, CHANNELS)
    ) * np.cos(phase)
    return np.asarray(shapes + own)


def distances(points: Points, patterns: Points) -> Points:
    """Root mean square over frames and joints, (points, patterns), from its definition."""
    away = points[:, None] - patterns[None]
    joints = away.reshape(*away.shape[:2], FRAMES, CHANNELS // 3, 3)
    return np.asarray(np.sqrt(np.square(joints).sum(axis=4).mean(axis=(2, 3))))


def grown(
    clips: list[Points], rules: ClusterRules, known: Any = None, seed: int = 0
) -> npt.NDArray[np.int16]:
    start = np.zeros((0, FRAMES, CHANNELS), np.int16) if known is None else known
    groups = [within_clip(clip, RADIUS) for clip in clips]
    searcher = NearestPatterns(to_centimetres(start))
    return one_thread(grow, searcher, groups, RADIUS, rules, seed)


cases = st.builds(
    lambda seed, sizes, spread: [segments(seed + n, size, spread) for n, size in enumerate(sizes)],
    st.integers(0, 10_000),
    st.lists(st.integers(1, 40), min_size=1, max_size=5),
    st.sampled_from([0.0, 1.0, 5.0, 30.0]),
)


@settings(max_examples=40)
@given(cases)
def test_a_clip_is_left_with_representatives_of_all_its_segments(clips: list[Points]) -> None:
    for points in clips:
        left = within_clip(points, RADIUS)
        assert left.counts.sum() == len(points)
        assert (left.counts >= 1).all()
        gaps = distances(points, left.points.astype(float))
        assert (gaps.min(axis=1) <= RADIUS / 4 + 1e-4).all()
        between = distances(left.points.astype(float), left.points.astype(float))
        np.fill_diagonal(between, np.inf)
        assert (between > RADIUS / 4 - 1e-4).all()
        assert (gaps.min(axis=0) < 1e-4).all(), "a representative is one of the segments"
        np.testing.assert_array_equal(left.points[0], points[0].astype(np.float32))


@settings(max_examples=40)
@given(cases)
def test_every_segment_is_within_the_radius_of_a_pattern(clips: list[Points]) -> None:
    patterns = to_centimetres(grown(clips, ClusterRules()))
    for points in clips:
        assert (distances(points, patterns).min(axis=1) <= RADIUS + 1e-4).all()


@settings(max_examples=30)
@given(cases, cases)
def test_more_clips_only_add_patterns_and_the_bound_goes_on_holding(
    first: list[Points], second: list[Points]
) -> None:
    before = grown(first, ClusterRules())
    added = grown(second, ClusterRules(), before)
    np.testing.assert_array_equal(grown(second, ClusterRules(), before), added)
    assert len(grown(first, ClusterRules(), before)) == 0, "what is known needs nothing new"
    patterns = to_centimetres(np.concatenate([before, added]))
    for points in first + second:
        assert (distances(points, patterns).min(axis=1) <= RADIUS + 1e-4).all()


@settings(max_examples=25)
@given(cases, st.integers(0, 3))
def test_the_average_error_is_bounded_when_asked_for(clips: list[Points], seed: int) -> None:
    groups = [within_clip(clip, RADIUS) for clip in clips]
    patterns = to_centimetres(grown(clips, AVERAGE, seed=seed))
    points = np.concatenate([group.points for group in groups]).astype(float)
    weights = np.concatenate([group.counts for group in groups])
    nearest = distances(points, patterns).min(axis=1)
    rounding = 2.0  # of the stored coefficients, at the most, in RMS centimetres
    assert np.sqrt(np.average(nearest**2, weights=weights)) <= 0.75 * RADIUS + rounding
    np.testing.assert_array_equal(
        grown(clips, AVERAGE, seed=seed), grown(clips, AVERAGE, seed=seed)
    )


def test_the_average_bound_needs_fewer_patterns() -> None:
    clips = [segments(seed, 60, 6.0) for seed in range(4)]
    assert 0 < len(grown(clips, AVERAGE)) < len(grown(clips, ClusterRules()))


def test_the_seed_counts_for_the_average_bound_alone() -> None:
    clips = [segments(seed, 60, 6.0) for seed in range(4)]
    assert not np.array_equal(grown(clips, AVERAGE, seed=1), grown(clips, AVERAGE, seed=2))
    np.testing.assert_array_equal(
        grown(clips, ClusterRules(), seed=1), grown(clips, ClusterRules(), seed=2)
    )


def test_heavier_representatives_pull_the_mean() -> None:
    point = segments(0, 1, 0.0)
    pair = np.concatenate([point, point + 2.0]).astype(np.float32)
    patterns = []
    for counts in ([99, 1], [1, 99]):
        group = Representatives(pair, np.array(counts))
        empty = NearestPatterns(np.zeros((0, FRAMES, CHANNELS)))
        patterns.append(to_centimetres(grow(empty, [group], RADIUS, ClusterRules())))
    assert [len(found) for found in patterns] == [1, 1]
    assert (patterns[1] - patterns[0]).mean() == pytest.approx(2.0, abs=0.5)


def test_nothing_makes_nothing() -> None:
    none = np.zeros((0, FRAMES, CHANNELS))
    assert len(within_clip(none, RADIUS).points) == 0
    for rules in (ClusterRules(), AVERAGE):
        assert len(grown([none], rules)) == 0


def test_the_radius_follows_the_body_but_not_into_the_noise() -> None:
    rules = ClusterRules(radius_coefficient=0.5, least_tolerances=4.0)
    assert rules.radius(20.0, 0.1) == 10.0
    assert rules.radius(20.0, 5.0) == 20.0


def test_the_cost_of_a_clip_does_not_grow_with_the_store(monkeypatch: pytest.MonkeyPatch) -> None:
    candidates = 0
    nearer = NearestPatterns._nearer

    def counted(self: Any, point: Any, found: Any, *rest: Any) -> None:
        nonlocal candidates
        candidates += len(found)
        nearer(self, point, found, *rest)

    monkeypatch.setattr(NearestPatterns, "_nearer", counted)
    rng = np.random.default_rng(0)
    searcher = NearestPatterns(np.zeros((0, FRAMES, CHANNELS)))
    work, sizes = [], []
    for number in range(150):  # ever new motion: the worst that can come
        points = segments(number, 60, 0.5) + rng.normal(0, 90.0, (60, 1, CHANNELS))
        before = candidates
        group = within_clip(points, RADIUS)
        grow(searcher, [group], RADIUS, ClusterRules())
        work.append(candidates - before)
        sizes.append(len(searcher))
    assert sizes[-1] > 20 * sizes[1], "the store must have grown"
    early, late = np.mean(work[10:30]), np.mean(work[-20:])
    assert late < 2.5 * early, "exact distances a clip"
