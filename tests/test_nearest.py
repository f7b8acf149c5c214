"""The look-up of patterns against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.clip import FloatArray
from motifold.codec.patterns.nearest import NearestPatterns, slow_coordinates

SEEDS = st.integers(0, 2**32 - 1)


def brute(stored: FloatArray, points: FloatArray, radius: float) -> list[tuple[int, float]]:
    """The nearest by root mean square over frames and joints; the first of equals."""
    out = []
    for point in points:
        joints = point.shape[1] // 3
        away = np.square(stored - point).sum(axis=(1, 2)) / (16 * joints)
        distances = np.sqrt(away)
        best = int(distances.argmin()) if len(distances) else -1
        inside = best >= 0 and distances[best] <= radius
        out.append((best, float(distances[best])) if inside else (-1, np.inf))
    return out


def cloud(seed: int, count: int, joints: int, spread: float = 5.0) -> FloatArray:
    rng = np.random.default_rng(seed)
    centres = rng.normal(size=(5, 16, 3 * joints)) * 20
    return np.asarray(
        centres[rng.integers(0, 5, count)] + spread * rng.normal(size=(count, 16, 3 * joints))
    )


@given(SEEDS, st.integers(0, 80), st.integers(0, 600), st.integers(1, 3), st.floats(0.1, 40))
@settings(max_examples=25, deadline=None)
def test_nearest_is_brute_force_after_any_adds(
    seed: int, start: int, adds: int, joints: int, radius: float
) -> None:
    points = cloud(seed, start + adds + 12, joints)
    searcher = NearestPatterns(points[:start])
    for number in range(start, start + adds):
        assert searcher.add(points[number]) == number
    assert len(searcher) == start + adds
    found, distances = searcher.within(points[-12:], radius)
    expected = brute(points[: start + adds], points[-12:], radius)
    for ours, how_far, (theirs, exact) in zip(found, distances, expected, strict=True):
        if ours >= 0 and theirs >= 0:
            assert how_far == pytest.approx(exact, rel=1e-12)
        else:  # a distance of just the radius may fall on either side
            assert ours == theirs or min(how_far, exact) == pytest.approx(radius, rel=1e-9)
        if ours != theirs:
            assert how_far == pytest.approx(exact, rel=1e-12)


@given(SEEDS, st.integers(1, 40), st.integers(0, 40))
@settings(max_examples=40, deadline=None)
def test_of_equals_the_lowest_number_wins(seed: int, start: int, adds: int) -> None:
    """Duplicates in the tree, in the short list, and in both."""
    rng = np.random.default_rng(seed)
    kinds = rng.normal(size=(4, 16, 3))
    order = rng.integers(0, 4, start + adds)
    searcher = NearestPatterns(kinds[order[:start]])
    for kind in order[start:]:
        searcher.add(kinds[kind])
    found, distances = searcher.within(kinds, 0.5)
    for kind in range(4):
        where = np.flatnonzero(order == kind)
        if len(where):
            assert (found[kind], distances[kind]) == (where[0], 0.0)


def test_a_whole_store_of_equals_gives_the_first() -> None:
    point = np.ones((16, 3))
    searcher = NearestPatterns(np.repeat(point[None], 3, axis=0))
    for _ in range(1500):
        searcher.add(point)
    assert searcher.within(point[None] + 0.01, 1.0)[0].tolist() == [0]


def test_nothing_is_near_in_an_empty_store() -> None:
    searcher = NearestPatterns(np.zeros((0, 16, 3)))
    found, distances = searcher.within(np.zeros((2, 16, 3)), 1e9)
    assert found.tolist() == [-1, -1]
    assert np.isinf(distances).all()
    assert searcher.within(np.zeros((0, 16, 3)), 1.0)[0].tolist() == []
    searcher.add(np.zeros((16, 3)))
    assert searcher.within(np.zeros((1, 16, 3)), 0.0)[0].tolist() == [0]


@given(SEEDS)
def test_slow_coordinates_never_exceed_the_distance(seed: int) -> None:
    points = cloud(seed, 20, 2)
    slow = slow_coordinates(points)
    assert slow.shape == (20, 12)
    near = np.linalg.norm(slow[:, None] - slow[None], axis=2)
    far = np.linalg.norm((points[:, None] - points[None]).reshape(20, 20, -1), axis=2)
    assert (near <= far * (1 + 1e-12)).all()
