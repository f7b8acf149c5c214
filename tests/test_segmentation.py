from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from motifold.codec.errors import UsageError
from motifold.codec.patterns.segmentation import partition

VALUES = st.floats(-50, 50, width=32)


@st.composite
def cases(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    frames, points = draw(st.integers(0, 90)), draw(st.integers(1, 3))
    signal = draw(arrays(np.float64, (frames, points, 3), elements=VALUES))
    if draw(st.booleans()):
        signal = np.cumsum(signal, axis=0) / 20
    weights = draw(arrays(np.float64, points, elements=st.floats(0.125, 4)))
    least = draw(st.integers(1, 6))
    limits = {
        "ratio": draw(st.floats(1, 8)),
        "key_threshold": draw(st.floats(0.5, 200)),
        "min_frames": least,
        "max_frames": draw(st.integers(least, 80)),
        "still": draw(st.floats(0.01, 5)),
    }
    return signal, weights, limits


def algorithm_1(
    points: np.ndarray, weights: np.ndarray, limits: dict[str, Any]
) -> list[int] | None:
    """Algorithm 1 frame by frame, up to the clip's end; None where rounding could decide."""
    w = weights / weights.sum()
    borders = [0]
    steps: list[float] = []
    for i in range(1, len(points)):
        step = float(w @ np.linalg.norm(points[i] - points[i - 1], axis=1))
        key = float(w @ np.linalg.norm(points[i] - points[borders[-1]], axis=1))
        limit = limits["ratio"] * max(float(np.mean(steps)), limits["still"]) if steps else np.inf
        if np.isclose(step, limit) or np.isclose(key, limits["key_threshold"]):
            return None
        length = i - borders[-1]
        cut = step > limit or key > limits["key_threshold"]
        if length >= limits["max_frames"] or (cut and length >= limits["min_frames"]):
            borders.append(i)
            steps = []
        else:
            steps.append(step)
    return [*borders, len(points)]


@given(cases())
def test_borders_are_those_of_the_algorithm(case: tuple[Any, ...]) -> None:
    points, weights, limits = case
    found = partition(points, weights, **limits).tolist()
    expected = algorithm_1(points, weights, limits)
    if expected is None or len(points) == 0:
        return
    if expected[-1] - expected[-2] >= limits["min_frames"]:
        assert found == expected
    else:  # only the last two segments differ
        assert found[:-2] == expected[: len(found) - 2]


@given(cases())
def test_lengths_are_bounded(case: tuple[Any, ...]) -> None:
    points, weights, limits = case
    borders = partition(points, weights, **limits)
    assert borders[0] == 0
    assert borders[-1] == len(points)
    counts = np.diff(borders)
    assert (counts >= 1).all()
    assert (counts <= limits["max_frames"]).all()
    assert (counts[:-1] >= limits["min_frames"]).all()
    if limits["max_frames"] >= 2 * limits["min_frames"] - 1 and len(points):
        assert counts[-1] >= min(limits["min_frames"], len(points))


@given(cases(), st.floats(0.25, 16))
def test_only_the_proportions_of_the_weights_matter(case: tuple[Any, ...], factor: float) -> None:
    points, weights, limits = case
    even = np.ones(len(weights))
    once = partition(points, even, **limits)
    np.testing.assert_array_equal(once, partition(points, even * 2.0, **limits))
    lone = np.concatenate([[factor], np.zeros(len(weights) - 1)])
    np.testing.assert_array_equal(
        partition(points, lone, **limits), partition(points[:, :1], np.ones(1), **limits)
    )


@given(cases())
def test_gaps_count_as_no_motion(case: tuple[Any, ...]) -> None:
    points, weights, limits = case
    gone = np.concatenate([points, np.full((len(points), 1, 3), np.nan)], axis=1)
    more = np.concatenate([weights, [weights.sum()]])
    doubled = limits | {key: 2 * limits[key] for key in ("key_threshold", "still")}
    np.testing.assert_array_equal(
        partition(gone, more, **limits), partition(points, weights, **doubled)
    )


def line(speeds: list[float]) -> np.ndarray:
    x = np.concatenate([[0.0], np.cumsum(speeds)])
    return np.stack([x, 0 * x, 0 * x], axis=1)[:, None]


def test_a_sharp_change_cuts_where_it_happens() -> None:
    points = line([0.1] * 19 + [1.0] * 20)
    borders = partition(
        points, np.ones(1), ratio=3, key_threshold=1e9, min_frames=1, max_frames=1000
    )
    assert borders.tolist() == [0, 20, 40]


def test_noise_at_rest_does_not_cut() -> None:
    noise = np.random.default_rng(5).normal(0, 0.004, (400, 1, 3))
    limits: dict[str, Any] = {
        "ratio": 1.5,
        "key_threshold": 2.0,
        "min_frames": 2,
        "max_frames": 400,
    }
    assert partition(noise, np.ones(1), **limits).tolist() == [0, 400]
    assert len(partition(noise, np.ones(1), **limits, still=1e-9)) > 20


def test_the_key_frame_cuts_slow_drift() -> None:
    points = line([0.125] * 99)
    borders = partition(
        points, np.ones(1), ratio=10, key_threshold=1.0, min_frames=1, max_frames=1000
    )
    assert np.diff(borders)[:-1].tolist() == [9] * (len(borders) - 2)


def test_small_clips() -> None:
    limits: dict[str, Any] = {"ratio": 2.0, "key_threshold": 2.0, "min_frames": 4, "max_frames": 16}
    for frames, expected in ((0, [0]), (1, [0, 1]), (3, [0, 3])):
        points = np.zeros((frames, 1, 3))
        assert partition(points, np.ones(1), **limits).tolist() == expected


@pytest.mark.parametrize("weights", [[], [1.0], [0.0, 0.0], [-1.0, 2.0], [np.nan, 1.0]])
def test_senseless_weights(weights: list[float]) -> None:
    with pytest.raises(UsageError, match="weight"):
        partition(
            np.zeros((5, 2, 3)),
            np.array(weights),
            ratio=2.0,
            key_threshold=1.0,
            min_frames=1,
            max_frames=9,
        )


@pytest.mark.parametrize(("least", "most"), [(0, 5), (6, 5)])
def test_senseless_bounds(least: int, most: int) -> None:
    with pytest.raises(UsageError, match="segments of"):
        partition(
            np.zeros((5, 1, 3)),
            np.ones(1),
            ratio=2.0,
            key_threshold=1.0,
            min_frames=least,
            max_frames=most,
        )
