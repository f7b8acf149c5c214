"""Classes of expected size, and the probability tables that go with them.

A class stands for numbers whose mean absolute value is expected to be 2^(class/4 - 7) or so.
Its table is a two-sided geometric distribution in integer counts, with an escape; large classes
code their low bits as they are. Small classes have a zero of its own probability, because what
a rate-distortion optimised quantiser leaves is no geometric distribution.
"""

from __future__ import annotations

from functools import lru_cache
from math import log2, sqrt
from typing import Any

import constriction
import numpy as np

from ..arithmetic.compiled import compiled, lean
from ..clip import FloatArray

CLASSES = 120
PER_OCTAVE = 4
LEAST_OCTAVE = -7
SYMBOL_LIMIT = 60  # numbers beyond ±60, after the class's shift, are escaped
ESCAPE = 2 * SYMBOL_LIMIT + 1
_ESCAPE_COUNT = 16
_TOTAL = 1 << 20
# Small classes, two by two: how likely a number is not 0, and how much less likely one more is.
# Counted once over four archives from 0.1 mm to 1 cm at 30 and 120 frames a second.
_NONZERO = (
    *(0.0006, 0.0046, 0.007, 0.010, 0.0157, 0.0247, 0.0405, 0.062, 0.1086, 0.1694, 0.2528),
    *(0.3558, 0.4708, 0.5882, 0.6857, 0.7652, 0.8277, 0.8709, 0.9062, 0.9299, 0.9509),
)
_TAIL = (
    *(0.06, 0.06, 0.06, 0.06, 0.06, 0.06, 0.06, 0.06, 0.0604, 0.0721, 0.1008),
    *(0.1473, 0.2271, 0.3321, 0.4437, 0.5504, 0.6452, 0.7273, 0.7965, 0.8527, 0.8957),
)
_SMALL_CLASSES = 40  # below the first that codes a low bit as it is


@compiled
def class_of(level: int) -> int:
    """Return the class of an expected size's binary logarithm × 256."""
    return min(max((level >> 6) - PER_OCTAVE * LEAST_OCTAVE, 0), CLASSES - 1)


def class_mean(index: int) -> float:
    """Return the mean absolute value that a class stands for."""
    octave, quarter = divmod(index, PER_OCTAVE)
    root = sqrt(sqrt(2.0))
    size = 2.0 ** (octave + LEAST_OCTAVE)
    for _ in range(quarter):
        size *= root
    return size * sqrt(root)  # the middle of the class


def class_shift(index: int) -> int:
    """Return how many low bits of a number are coded as they are."""
    return max(0, int(class_mean(index) / 4.0).bit_length() - 1)


@lru_cache(maxsize=CLASSES)
def class_counts(index: int) -> tuple[int, ...]:
    """Return the counts of -60 … 60 and of the escape.

    Built from square roots, products and quotients only, which IEEE 754 rounds the same on
    every machine.
    """
    zero, theta = _zero_and_tail(index)
    weight, weights = (1.0 - zero) * (1.0 - theta) / 2.0, [zero]
    for _ in range(SYMBOL_LIMIT):
        weights.append(weight)
        weight *= theta
    half = [int(value * _TOTAL) + 1 for value in weights]
    return (*half[:0:-1], *half, _ESCAPE_COUNT)


def _zero_and_tail(index: int) -> tuple[float, float]:
    """Return how likely a class's 0 is, and how much less likely one more is than one less."""
    if index < _SMALL_CLASSES:
        at, odd = divmod(index, 2)
        other = max(at + (1 if odd else -1), 0)
        nonzero = 0.75 * _NONZERO[at] + 0.25 * _NONZERO[other]
        return 1.0 - nonzero, 0.75 * _TAIL[at] + 0.25 * _TAIL[other]
    mean = class_mean(index) / (1 << class_shift(index))
    theta = (sqrt(1.0 + mean * mean) - 1.0) / mean
    return (1.0 - theta) / (1.0 + theta), theta


@lru_cache(maxsize=1)
def class_models() -> list[Any]:
    """Return the entropy coder's model of every class."""
    models = []
    for index in range(CLASSES):
        counts = np.array(class_counts(index), np.float64)
        models.append(constriction.stream.model.Categorical(counts / counts.sum(), perfect=False))
    return models


@lru_cache(maxsize=1)
def class_shifts() -> list[int]:
    """Return `class_shift` of every class."""
    return [class_shift(index) for index in range(CLASSES)]


@lru_cache(maxsize=1)
def class_floors() -> list[float]:
    """Return, by class, what a number costs at the least, without its low bits."""
    return [-log2(max(class_counts(i)) / sum(class_counts(i))) for i in range(CLASSES)]


@lru_cache(maxsize=1)
def class_costs() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return, by class, about the bits of a zero, of ±1 beyond those, and of each one more."""
    zeros, ones, more = np.zeros(CLASSES), np.zeros(CLASSES), np.zeros(CLASSES)
    for index in range(CLASSES):
        shift = class_shift(index)
        zero, theta = _zero_and_tail(index)
        zeros[index] = shift - log2(zero)
        more[index] = -log2(theta) / (1 << shift)
        one = (1.0 - zero) * (1.0 - theta) / 2.0
        ones[index] = more[index] if shift else log2(zero / one)
    return zeros, ones, more


@lean
def bits_of(kind: int, size: int, zeros: FloatArray, ones: FloatArray, more: FloatArray) -> float:
    """Return about the bits of a number of absolute value ``size``, of class ``kind``."""
    bits: float = zeros[kind]
    if size > 0:
        bits += ones[kind] + (size - 1) * more[kind]
    return bits
