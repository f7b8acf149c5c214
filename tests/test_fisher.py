from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from motifold.codec.errors import UsageError
from motifold.codec.patterns.fisher import optimal_partition, paa, wssse

VALUES = st.floats(-100, 100, width=32)


def signals(most: int) -> st.SearchStrategy[np.ndarray]:
    shapes = st.tuples(st.integers(1, most), st.integers(1, 3))
    return shapes.flatmap(lambda shape: arrays(np.float64, shape, elements=VALUES))


def all_partitions(n: int, segments: int) -> list[np.ndarray]:
    return [np.array([0, *cuts, n]) for cuts in combinations(range(1, n), segments - 1)]


def variance_sum(frames: np.ndarray, borders: np.ndarray) -> float:
    """WSSSE by NumPy's own variance."""
    pieces = np.split(frames, borders[1:-1])
    return float(sum(piece.var(axis=0).sum() * len(piece) for piece in pieces))


@given(signals(9), st.data())
def test_no_partition_is_better(frames: np.ndarray, data: st.DataObject) -> None:
    segments = data.draw(st.integers(1, len(frames)))
    best = min(variance_sum(frames, borders) for borders in all_partitions(len(frames), segments))
    found = optimal_partition(frames, segments)
    assert found.shape == (segments + 1,)
    assert found[0] == 0
    assert found[-1] == len(frames)
    assert (np.diff(found) >= 1).all()
    assert variance_sum(frames, found) == pytest.approx(best, rel=1e-9, abs=1e-9)


@given(signals(40), st.data())
def test_never_worse_than_equal_lengths_and_better_with_more(
    frames: np.ndarray, data: st.DataObject
) -> None:
    segments = data.draw(st.integers(1, len(frames)))
    slack = 1e-9 * (1 + (frames**2).sum())
    found = wssse(frames, optimal_partition(frames, segments))
    assert found <= wssse(frames, paa(frames, segments)) + slack
    if segments > 1:
        assert found <= wssse(frames, optimal_partition(frames, segments - 1)) + slack


@given(signals(30), st.data())
def test_segments_together_are_the_input(frames: np.ndarray, data: st.DataObject) -> None:
    segments = data.draw(st.integers(1, len(frames)))
    for borders in (optimal_partition(frames, segments), paa(frames, segments)):
        pieces = [frames[a:b] for a, b in pairwise(borders)]
        assert all(len(piece) for piece in pieces)
        np.testing.assert_array_equal(np.concatenate(pieces), frames)


@given(signals(30), st.data())
def test_wssse_is_the_variance(frames: np.ndarray, data: st.DataObject) -> None:
    borders = paa(frames, data.draw(st.integers(1, len(frames))))
    assert wssse(frames, borders) == pytest.approx(variance_sum(frames, borders), abs=1e-6)


@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_steps_are_found_far_from_the_origin(offset: float) -> None:
    steps = np.repeat([0.0, 5.0, 1.0, 3.0], [7, 2, 11, 4])[:, None]
    noise = np.random.default_rng(1).normal(0, 0.01, steps.shape)
    found = optimal_partition(steps + noise + offset, 4)
    np.testing.assert_array_equal(found, [0, 7, 9, 20, 24])


@given(signals(20))
def test_one_frame_each_costs_nothing(frames: np.ndarray) -> None:
    assert wssse(frames, optimal_partition(frames, len(frames))) == 0.0


def test_counts_that_cannot_be() -> None:
    frames = np.zeros((3, 2))
    for segments in (0, 4, -1):
        for cut in (optimal_partition, paa):
            with pytest.raises(UsageError, match="3 frames"):
                cut(frames, segments)
    empty = np.zeros((0, 2))
    assert optimal_partition(empty, 0).tolist() == [0]
    assert paa(empty, 0).tolist() == [0]
