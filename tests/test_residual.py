"""The residual layer gives back any integers, and adapts to what it codes."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.clip import IntArray
from motifold.codec.errors import DamagedError
from motifold.codec.streams.entropy import (
    CLASS_FLOORS,
    CLASS_SHIFTS,
    CLASSES,
    SymbolReader,
    SymbolWriter,
    class_probabilities,
)
from motifold.codec.streams.envelope import LEAST_BITS
from motifold.codec.version1.residual import read_residual, write_residual


def coded(left: IntArray, groups: list[int]) -> bytes:
    writer = SymbolWriter()
    write_residual(writer, left, groups)
    return writer.to_bytes()


def integers(seed: int, frames: int, channels: int) -> IntArray:
    """Channels of all sizes, some still, with outliers up to the format's limit."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-2, rng.choice([1, 6, 12]), channels)
    left = np.rint(rng.laplace(size=(frames, channels)) * scale).astype(np.int64)
    outliers = rng.random(left.shape) < rng.choice([0.0, 0.01])
    left[outliers] = rng.integers(-(2**46), 2**46, int(outliers.sum()))
    return left


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0, 1, 2, 8, 9, 10, 17, 60]),
    st.lists(st.integers(0, 4), max_size=5),
)
@settings(max_examples=150, deadline=None)
def test_residuals_come_back(seed: int, frames: int, thirds: list[int]) -> None:
    groups = [3 * third for third in thirds]
    left = integers(seed, frames, sum(groups))
    data = coded(left, groups)
    assert np.array_equal(read_residual(SymbolReader(data), frames, groups), left)


@pytest.mark.parametrize("value", [2**46, -(2**46), 2**46 - 1, 1, 0])
def test_jumps_to_the_limit_come_back(value: int) -> None:
    left = np.zeros((40, 6), np.int64)
    left[0, 0] = left[20, 3] = left[39, 5] = value
    data = coded(left, [3, 3])
    assert np.array_equal(read_residual(SymbolReader(data), 40, [3, 3]), left)


def test_still_channels_cost_next_to_nothing_but_more_than_the_bound() -> None:
    left = np.zeros((3000, 60), np.int64)
    data = coded(left, [30, 30])
    bits = 8 * len(data) / left.size
    assert LEAST_BITS < bits < 0.025


def test_channels_cost_what_their_size_deserves() -> None:
    """Within 6 % of the entropy of two-sided geometric numbers, over 5 orders of magnitude."""
    rng = np.random.default_rng(0)
    for theta in (0.3, 0.9, 0.99, 0.9999):
        numbers = rng.geometric(1 - theta, (2, 2000, 12)) - 1
        left = numbers[0] - numbers[1]
        p = np.array([theta ** abs(k) for k in range(-100000, 100001)]) * (1 - theta) / (1 + theta)
        entropy = -(p[p > 0] * np.log2(p[p > 0])).sum()
        assert 8 * len(coded(left, [12])) / left.size < 1.06 * entropy


def expected_bits(left: IntArray) -> float:
    """What the format's rules cost, channel by channel in plain numbers; one group."""

    def class_of(activity: int) -> int:
        return max(c for c in range(CLASSES) if CLASS_FLOORS[c] <= activity)

    def cost(value: int, index: int) -> float:
        shift = int(CLASS_SHIFTS[index])
        high = value >> shift
        if abs(high) <= 60:
            return shift - math.log2(class_probabilities(index)[60 + high])
        number = 2 * (abs(high) - 61) + (high < 0)
        length = math.log2(48) + (number + 1).bit_length() - 1
        return shift - math.log2(class_probabilities(index)[121]) + length

    bits, previous = 0.0, 12
    blocks = [left[:1], *(left[at : at + 8] for at in range(1, len(left), 8))]
    activity: list[int] = []
    for number, block in enumerate(blocks):
        sums = [int(np.abs(channel).sum()) for channel in block.T]
        if number < 2:
            opening = class_of(sum(sums) * 256 // block.size)
            bits += cost(opening - previous if number == 0 else opening - 12, class_of(3 * 256))
            classes = [opening] * len(sums)
        else:
            joints = [sum(activity[at : at + 3]) for at in range(0, len(activity), 3)]
            classes = [class_of((9 * a + 2 * joints[c // 3]) // 15) for c, a in enumerate(activity)]
        bits += sum(
            cost(value, index)
            for channel, index in zip(block.T.tolist(), classes, strict=True)
            for value in channel
        )
        now = [total * 256 // len(block) for total in sums]
        if number == 1:
            activity = now
        elif number > 1:
            activity = [(a + b + 1) // 2 for a, b in zip(activity, now, strict=True)]
    return bits


@pytest.mark.parametrize("seed", range(6))
def test_the_cost_is_that_of_the_rules(seed: int) -> None:
    """So that a change of how classes follow the data, which breaks old files, shows."""
    rng = np.random.default_rng(seed)
    course = 1 + np.sin(np.arange(150) / 9)[:, None]
    left = np.rint(rng.normal(size=(150, 12)) * course * 10.0 ** rng.uniform(-1, 3, 12))
    left = left.astype(np.int64)
    assert abs(8 * len(coded(left, [12])) - expected_bits(left)) < 70


def test_a_class_that_does_not_exist_is_damage() -> None:
    writer = SymbolWriter()
    writer.differences(np.array([40], np.int64), 1)  # 12 + 40
    for data in (writer.to_bytes(), b"\xff" * 30):
        with pytest.raises(DamagedError):
            read_residual(SymbolReader(data), 5, [3])


@given(st.integers(0, 2**32 - 1), st.integers(0, 200))
@settings(max_examples=60, deadline=None)
def test_any_bytes_are_integers_or_damage(seed: int, size: int) -> None:
    data = np.random.default_rng(seed).integers(0, 256, size, np.uint8).tobytes()
    with contextlib.suppress(DamagedError):
        assert read_residual(SymbolReader(data), 30, [6, 3]).shape == (30, 9)
