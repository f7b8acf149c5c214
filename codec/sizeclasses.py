"""Classes of expected size, and the probability tables that go with them.

A class stands for numbers whose mean absolute value is expected to be 2^(class/4 - 7) or so.
Its table is a two-sided geometric distribution in integer counts, with an escape; large classes
code their low bits as they are.
"""

from __future__ import annotations

from functools import lru_cache
from math import log2, sqrt
from typing import Any

import constriction
import numpy as np

from .clip import FloatArray
from .compiled import compiled

CLASSES = 120
PER_OCTAVE = 4
LEAST_OCTAVE = -7
SYMBOL_LIMIT = 60  # numbers beyond ±60, after the class's shift, are escaped
ESCAPE = 2 * SYMBOL_LIMIT + 1
_ESCAPE_COUNT = 16
_TOTAL = 1 << 20


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
    mean = class_mean(index) / (1 << class_shift(index))
    theta = (sqrt(1.0 + mean * mean) - 1.0) / mean
    weight, weights = 1.0, []
    for _ in range(SYMBOL_LIMIT + 1):
        weights.append(weight)
        weight *= theta
    total = sum(weights) * 2.0 - 1.0
    half = [int(value / total * _TOTAL) + 1 for value in weights]
    return (*half[:0:-1], *half, _ESCAPE_COUNT)


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
def class_costs() -> tuple[FloatArray, FloatArray]:
    """Return, by class, the bits of a zero and about those of one more in absolute value."""
    zeros, slopes = np.zeros(CLASSES), np.zeros(CLASSES)
    for index in range(CLASSES):
        counts, shift = class_counts(index), class_shift(index)
        zeros[index] = log2(sum(counts) / counts[SYMBOL_LIMIT]) + shift
        mean = class_mean(index)
        slopes[index] = -log2((sqrt(1.0 + mean * mean) - 1.0) / mean)
    return zeros, slopes
