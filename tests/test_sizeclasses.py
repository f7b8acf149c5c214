"""Classes of expected size: their tables are exact, sum up, and cost what they should."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from exact_doubles import root, sized_counts, to_double
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.arithmetic.fixedpoint import log2_of
from motifold.codec.streams.sizeclasses import (
    CLASSES,
    ESCAPE,
    LEAST_OCTAVE,
    PER_OCTAVE,
    SYMBOL_LIMIT,
    bits_of,
    class_costs,
    class_counts,
    class_floors,
    class_mean,
    class_of,
    class_shift,
)

EVERY = range(CLASSES)
# As docs/format.md has them: how likely a number of two small classes is not 0, and the tail.
NONZERO = (
    "0.0006 0.0046 0.007 0.010 0.0157 0.0247 0.0405 0.062 0.1086 0.1694 0.2528 "
    "0.3558 0.4708 0.5882 0.6857 0.7652 0.8277 0.8709 0.9062 0.9299 0.9509"
)
TAIL = (
    "0.06 0.06 0.06 0.06 0.06 0.06 0.06 0.06 0.0604 0.0721 0.1008 "
    "0.1473 0.2271 0.3321 0.4437 0.5504 0.6452 0.7273 0.7965 0.8527 0.8957"
)
SMALL = 40


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
    if index >= SMALL:
        assert counts == sized_counts(exact_mean(index) / (1 << exact_shift(index)))
    assert len(counts) == ESCAPE + 1 == 2 * SYMBOL_LIMIT + 2
    assert counts[:-1] == counts[-2::-1]  # + and - alike
    assert counts[SYMBOL_LIMIT:ESCAPE] == sorted(counts[SYMBOL_LIMIT:ESCAPE], reverse=True)
    assert min(counts) >= 1
    cut_off = 0.03 if index >= SMALL else 0.01  # what is beyond ±60
    assert (1 - cut_off) * 2**20 - 122 <= sum(counts) <= 2**20 + 140


@pytest.mark.parametrize("index", range(SMALL))
def test_small_classes_lie_between_the_counted_ones(index: int) -> None:
    """Two classes a count, each a quarter of the way to the next: exact from the docs' numbers."""
    counted = [[Fraction(text) for text in row.split()] for row in (NONZERO, TAIL)]
    at = [Fraction(2 * pair) + Fraction(1, 2) for pair in range(len(counted[0]))]
    place = max(Fraction(index), at[0])
    low = max(pair for pair in range(len(at) - 1) if at[pair] <= place)
    part = (place - at[low]) / 2
    nonzero, tail = (float(values[low] * (1 - part) + values[low + 1] * part) for values in counted)
    counts = np.array(class_counts(index), np.float64)
    shares = counts / 2**20
    assert shares[SYMBOL_LIMIT] == pytest.approx(1 - nonzero, abs=1e-5)
    assert shares[SYMBOL_LIMIT + 1] == pytest.approx(nonzero * (1 - tail) / 2, abs=2e-6)
    assert shares[SYMBOL_LIMIT + 2] == pytest.approx(nonzero * (1 - tail) * tail / 2, abs=2e-6)


def test_small_classes_go_over_into_geometric_ones() -> None:
    """The last of them is as a geometric table would be, and none jumps."""
    last = np.array(class_counts(SMALL - 1), np.float64)
    geometric = np.array(sized_counts(exact_mean(SMALL - 1)), np.float64)
    assert last[45:76] == pytest.approx(geometric[45:76], rel=0.15)
    likely = [class_counts(index)[SYMBOL_LIMIT] for index in range(SMALL)]
    assert likely == sorted(likely, reverse=True)


@pytest.mark.parametrize("index", EVERY)
def test_a_class_has_the_mean_size_that_it_stands_for(index: int) -> None:
    """What lies beyond ±60 is cut off, and the low bits that are coded as they are blur it."""
    counts = np.array(class_counts(index)[:-1], np.float64)
    sizes = np.abs(np.arange(-SYMBOL_LIMIT, SYMBOL_LIMIT + 1)) * float(1 << class_shift(index))
    mean = float((counts * sizes).sum() / counts.sum())
    if index >= SMALL:
        assert mean == pytest.approx(class_mean(index), rel=0.06, abs=0.004)
    else:  # expectations are made for a geometric source; small ones are too large by this much
        assert mean < 1.1 * class_mean(index) + 0.01
        assert mean > 0.6 * class_mean(index) - 0.02


@given(st.floats(3.5, 9.0))
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
    zeros, ones, more = class_costs()
    floors = class_floors()
    for index in EVERY:
        counts, shift = class_counts(index), class_shift(index)
        bits = [-math.log2(count / sum(counts)) for count in counts]
        assert floors[index] == pytest.approx(min(bits), abs=1e-12)
        assert zeros[index] == pytest.approx(bits[SYMBOL_LIMIT] + shift, abs=0.05)
        if class_mean(index) > 0.2:  # tables of smaller sizes end in counts of 1
            one = (bits[SYMBOL_LIMIT + 1] - bits[SYMBOL_LIMIT]) / (1 << shift)
            assert ones[index] == pytest.approx(one, rel=0.05)
            next_one = (bits[SYMBOL_LIMIT + 2] - bits[SYMBOL_LIMIT + 1]) / (1 << shift)
            assert more[index] == pytest.approx(next_one, rel=0.05, abs=1e-4)
        for size in (0, 1, 3):
            wanted = zeros[index] + (size > 0) * ones[index] + max(size - 1, 0) * more[index]
            assert bits_of(index, size, zeros, ones, more) == pytest.approx(wanted)
    assert (np.diff(zeros) > 0).all()
