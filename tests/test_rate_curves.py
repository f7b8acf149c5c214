"""Sizes read off curves: power laws come out exactly, and searches end near what they seek."""

from __future__ import annotations

import math
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rate_curves import (
    MEAN_CLOSE,
    MEAN_TRIALS,
    Run,
    bytes_at_maximum,
    bytes_at_mean,
    interpolated,
    runs_near_mean,
)

SIZES = st.floats(1e-4, 1e4)


def run(value: float, index_bytes: list[float], largest: list[float], shared: float = 0.0) -> Run:
    sizes = np.array(index_bytes)
    whole = round(sizes.sum() + shared)
    return Run("max", value, sizes, np.array(largest), whole, 0, 0, 0.2 * value)


@given(st.lists(SIZES, min_size=2, max_size=9, unique=True), st.floats(-2, 2), SIZES, SIZES)
def test_a_power_law_is_read_exactly(
    x: list[float], slope: float, factor: float, at: float
) -> None:
    x = [value for n, value in enumerate(x) if all(abs(value / y - 1) > 1e-3 for y in x[:n])]
    if len(x) < 2:
        return
    values = np.array(x)
    inside = float(np.clip(at, values.min(), values.max()))
    found = interpolated(inside, values, factor * values**slope)
    assert found == pytest.approx(factor * inside**slope, rel=1e-9)


def test_the_outermost_line_goes_on() -> None:
    x, y = np.array([1.0, 2.0, 4.0]), np.array([8.0, 4.0, 3.0])
    assert interpolated(0.5, x, y) == pytest.approx(16.0)
    assert interpolated(8.0, x, y) == pytest.approx(2.25)


def test_order_does_not_matter_and_the_smallest_of_equals_counts() -> None:
    x, y = np.array([4.0, 1.0, 1.0]), np.array([2.0, 9.0, 8.0])
    assert interpolated(1.0, x, y) == pytest.approx(8.0)
    assert interpolated(2.0, x, y) == pytest.approx(4.0)
    assert interpolated(7.0, x[1:], y[1:]) == pytest.approx(8.0)
    with pytest.raises(ValueError, match="no points"):
        interpolated(1.0, x[:0], y[:0])


def test_each_clip_is_read_off_its_own_curve() -> None:
    coarse = run(1.0, [100.0, 50.0], [0.9, 0.8], shared=30.0)
    fine = run(0.1, [200.0, 100.0], [0.09, 0.08], shared=20.0)
    size, outside = bytes_at_maximum([coarse, fine], np.array([0.9, 0.08]))
    assert size == pytest.approx(100.0 + 100.0 + 30.0)  # the median 0.49 is nearer to 1
    assert outside == 0
    size, outside = bytes_at_maximum([fine, coarse], np.array([0.009, 0.08]))
    assert size == pytest.approx(400.0 + 100.0 + 20.0)
    assert outside == 1


def test_a_clip_without_error_has_a_size() -> None:
    still = [run(value, [10.0], [0.0]) for value in (0.1, 1.0)]
    size, outside = bytes_at_maximum(still, np.array([0.5]))
    assert size == pytest.approx(10.0)
    assert outside == 1


def test_whole_archives_are_read_at_their_mean_error() -> None:
    runs = [run(1.0, [100.0], [1.0]), run(0.25, [400.0], [0.25])]
    size, guessed = bytes_at_mean(runs, 0.1)
    assert size == pytest.approx(200.0)
    assert not guessed
    assert bytes_at_mean(runs, 0.3)[1]


@given(st.floats(1e-3, 1.0), st.floats(0.05, 5.0), st.floats(0.9, 1.1))
def test_the_search_for_a_mean_ends_beside_it(wanted: float, factor: float, power: float) -> None:
    def at(value: float) -> Run:
        made = run(value, [100.0 / value], [value])
        return Run(**{**vars(made), "joint_mean": factor * value**power})

    runs = runs_near_mean(at, wanted)
    assert 2 <= len(runs) <= MEAN_TRIALS
    assert len({made.joint_mean for made in runs}) >= 2  # a line can be drawn
    missed = min(abs(math.log(wanted / made.joint_mean)) for made in runs)
    assert missed <= MEAN_CLOSE
