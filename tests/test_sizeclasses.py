"""Classes of expected size: their tables are exact, sum up, and cost what they should."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from exact_doubles import geometric_counts, root, to_double
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.fixedpoint import log2_of
from motifold.codec.sizeclasses import (
    CLASSES,
    ESCAPE,
    LEAST_OCTAVE,
    PER_OCTAVE,
    SYMBOL_LIMIT,
    class_costs,
    class_counts,
    class_floors,
    class_mean,
    class_of,
    class_shift,
)

EVERY = range(CLASSES)


def exact_mean(index: int) -> Fraction:
    """The mean of a class, every step rounded to a double."""
    fourth = root(root(Fraction(2)))
    size = Fraction(2) ** (index // PER_OCTAVE + LEAST_OCTAVE)
    for _ in range(index % PER_OCTAVE):
        size = to_double(size * fourth)
    return to_double(size * root(fourth))


def exact_shift(index: int) -> int:
    whole = int(exact_mean(index) / 4)
    return max(0, whole.bit_length() - 1)


@pytest.mark.parametrize("index", EVERY)
def test_tables_are_those_of_exact_arithmetic(index: int) -> None:
    assert Fraction(class_mean(index)) == exact_mean(index)
    assert class_shift(index) == exact_shift(index)
    counts = list(class_counts(index))
    assert counts == geometric_counts(exact_mean(index) / (1 << exact_shift(index)))
    assert len(counts) == ESCAPE + 1 == 2 * SYMBOL_LIMIT + 2
    assert counts[:-1] == counts[-2::-1]  # + and - alike
    assert counts[SYMBOL_LIMIT:ESCAPE] == sorted(counts[SYMBOL_LIMIT:ESCAPE], reverse=True)
    assert min(counts) >= 1
    assert 2**20 - 122 <= sum(counts) <= 2**20 + 140


@pytest.mark.parametrize("index", EVERY)
def test_a_class_has_the_mean_size_that_it_stands_for(index: int) -> None:
    """What lies beyond ±60 is cut off, and the low bits that are coded as they are blur it."""
    counts = np.array(class_counts(index)[:-1], np.float64)
    sizes = np.abs(np.arange(-SYMBOL_LIMIT, SYMBOL_LIMIT + 1)) * float(1 << class_shift(index))
    mean = float((counts * sizes).sum() / counts.sum())
    assert mean == pytest.approx(class_mean(index), rel=0.01, abs=0.004)


@given(st.floats(-6.5, 9.0))
def test_the_chosen_class_costs_little_more_than_the_best_table(octave: float) -> None:
    """Quarter octaves are fine enough: under 1 % over the entropy of a geometric source."""
    mean = 2.0**octave
    theta = (math.sqrt(1.0 + mean * mean) - 1.0) / mean
    values = np.arange(1 + int(40 * (1.0 + mean)))
    p = theta**values * (1.0 - theta) / (1.0 + theta)
    weights = np.where(values == 0, 1.0, 2.0) * p
    entropy = -(weights * np.log2(np.maximum(p, 1e-300))).sum()
    index = class_of(math.floor(octave * 256))
    counts, shift = np.array(class_counts(index), np.float64), class_shift(index)
    cost = 0.0
    for signed in (values, -values):
        high = np.minimum(np.abs(signed >> shift), SYMBOL_LIMIT + 1)
        symbol = np.where(high > SYMBOL_LIMIT, ESCAPE, (signed >> shift) + SYMBOL_LIMIT)
        bits = -np.log2(counts[symbol] / counts.sum()) + shift
        cost += float((0.5 * weights * bits).sum())
    assert cost <= 1.01 * entropy + 0.03


@given(st.integers(-(10**5), 10**5))
def test_classes_are_quarter_octaves(level: int) -> None:
    index = class_of(level)
    assert 0 <= index < CLASSES
    assert index <= class_of(level + 1) <= index + 1
    if 0 < index < CLASSES - 1:
        octave = level / 256
        assert index == math.floor(PER_OCTAVE * octave) - PER_OCTAVE * LEAST_OCTAVE
        # a class's mean is the middle of the sizes that it serves
        assert abs(math.log2(class_mean(index)) - octave) <= 0.5 / PER_OCTAVE + 1e-9


@given(st.integers(1, 2**22))
def test_the_class_of_a_number_as_large_as_expected(size: int) -> None:
    index = class_of(log2_of(size))
    assert abs(math.log2(class_mean(index) / size)) < 0.14


def test_shifts_leave_a_few_bits_to_the_table() -> None:
    for index in EVERY:
        left = class_mean(index) / (1 << class_shift(index))
        assert left < 16.0
        assert class_shift(index) == 0 or left >= 4.0


def test_costs_are_those_of_the_tables() -> None:
    zeros, slopes = class_costs()
    floors = class_floors()
    for index in EVERY:
        counts, shift = class_counts(index), class_shift(index)
        bits = [-math.log2(count / sum(counts)) for count in counts]
        assert floors[index] == pytest.approx(min(bits), abs=1e-12)
        assert zeros[index] == pytest.approx(bits[SYMBOL_LIMIT] + shift, abs=1e-12)
        if class_mean(index) > 0.2:  # tables of smaller sizes end in counts of 1
            one = (bits[SYMBOL_LIMIT + 2] - bits[SYMBOL_LIMIT]) / (2 << shift)
            assert slopes[index] == pytest.approx(one, rel=0.05)
    assert (np.diff(slopes) < 0).all()
