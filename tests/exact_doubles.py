"""IEEE 754 doubles in exact arithmetic: what any machine must get, from integers only."""

from __future__ import annotations

from fractions import Fraction
from math import isqrt


def to_double(value: Fraction) -> Fraction:
    """The nearest IEEE 754 double, ties to even, as int / int in Python promises it."""
    return Fraction(value.numerator / value.denominator)


def root(value: Fraction) -> Fraction:
    """The nearest double to a square root, from integers only."""
    shift = 400  # far more digits than a double has, so that no tie is mistaken
    floor = isqrt((value.numerator << (2 * shift)) // value.denominator)
    sticky = Fraction(0) if Fraction(floor, 1 << shift) ** 2 == value else Fraction(1, 2)
    return to_double((floor + sticky) / (1 << shift))


def geometric_counts(scaled: Fraction) -> list[int]:
    """The counts of -60 … 60 and of the escape in a two-sided geometric table of a mean."""
    theta = _theta(scaled)
    weights = [Fraction(1)]
    for _ in range(60):
        weights.append(to_double(weights[-1] * theta))
    total = Fraction(0)
    for weight in weights:
        total = to_double(total + weight)
    total = to_double(total * 2 - 1)
    half = [int(to_double(weight / total) * 2**20) + 1 for weight in weights]
    return [*half[:0:-1], *half, 16]


def sized_counts(scaled: Fraction) -> list[int]:
    """The same in version 2, whose tables are not stretched for what is cut off."""
    theta = _theta(scaled)
    zero = to_double(to_double(1 - theta) / to_double(1 + theta))
    weight = to_double(to_double(to_double(1 - zero) * to_double(1 - theta)) / 2)
    weights = [zero]
    for _ in range(60):
        weights.append(weight)
        weight = to_double(weight * theta)
    half = [int(to_double(weight * 2**20)) + 1 for weight in weights]
    return [*half[:0:-1], *half, 16]


def _theta(scaled: Fraction) -> Fraction:
    above = to_double(root(to_double(1 + to_double(scaled * scaled))) - 1)
    return to_double(above / scaled)
