"""Integer prediction loses nothing, whatever the runs, patterns and orders."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.clip import BoolArray, IntArray
from motifold.codec.version1.prediction import differences, innovations_of, restore, run_starts

ORDERS = pytest.mark.parametrize("order", [1, 2])
SEEDS = st.integers(0, 2**32 - 1)


def course(seed: int, frames: int, channels: int, bits: int) -> tuple[IntArray, BoolArray]:
    rng = np.random.default_rng(seed)
    values = rng.integers(-(2**bits), 2**bits, (frames, channels), dtype=np.int64)
    return values, run_starts(rng.random((frames, channels)) < rng.choice([0.0, 0.1, 0.6]))


@ORDERS
@given(SEEDS, st.integers(0, 30), st.integers(0, 5), st.sampled_from([3, 40, 62]))
def test_restore_inverts_differences(
    order: int, seed: int, frames: int, channels: int, bits: int
) -> None:
    values, starts = course(seed, frames, channels, bits)
    expected, _ = course(seed + 1, frames, channels, bits)
    left = differences(values, expected, starts, order)
    assert np.array_equal(restore(left, expected, starts, order), values)


@ORDERS
@given(SEEDS, st.integers(1, 30))
def test_differences_are_what_the_formulas_say(order: int, seed: int, frames: int) -> None:
    values, starts = course(seed, frames, 3, 20)
    left = differences(values, np.zeros_like(values), starts, order)
    for channel in range(3):
        run = 0
        for frame in range(frames):
            run = frame if starts[frame, channel] else run
            past = values[run : frame + 1, channel].tolist()
            guess = 0
            if order == 2 and len(past) > 2:
                guess = 2 * past[-2] - past[-3]
            elif len(past) > 1:
                guess = past[-2]
            assert left[frame, channel] == past[-1] - guess


@ORDERS
def test_still_and_steady_channels_leave_nothing(order: int) -> None:
    frame = np.arange(20)[:, None]
    values = np.where(np.arange(4) < 2, 7, 7 + 3 * frame)
    left = differences(values, np.zeros_like(values), run_starts(values < 0), order)
    assert (left[1:, :2] == 0).all()
    assert (left[2:, 2:] == (0 if order == 2 else 3)).all()


@ORDERS
def test_a_clip_that_is_its_pattern_leaves_nothing_inside_segments(order: int) -> None:
    rng = np.random.default_rng(0)
    pattern = rng.integers(-50, 50, (30, 6))
    borders = np.array([0, 12, 30])
    starts = run_starts(np.zeros((30, 6), bool))
    values = pattern.copy()
    values[12:] += 1000  # where a segment starts matters to its border only
    expected = innovations_of(pattern, np.array([True, True]), borders, starts, order)
    left = differences(values, expected, starts, order)
    assert (left[order:12] == 0).all()
    assert (left[0] == 0).all()
    assert (left[12 + order :] == 0).all()


@ORDERS
@given(SEEDS, st.integers(1, 40))
def test_segments_without_pattern_are_predicted_plainly(order: int, seed: int, frames: int) -> None:
    rng = np.random.default_rng(seed)
    values, starts = course(seed, frames, 3, 10)
    cuts = np.flatnonzero(rng.random(frames - 1) < 0.2) + 1
    borders = np.array([0, *cuts, frames])
    used = rng.random(len(borders) - 1) < 0.5
    expected = innovations_of(values, used, borders, starts, order)
    assert (expected[~np.repeat(used, np.diff(borders))] == 0).all()
    heads = borders[1:-1]
    assert (expected[heads] == 0).all()


def test_the_first_frame_always_starts_a_run() -> None:
    assert run_starts(np.zeros((3, 2), bool)).tolist() == [[True] * 2, [False] * 2, [False] * 2]
    assert run_starts(np.zeros((0, 2), bool)).shape == (0, 2)
