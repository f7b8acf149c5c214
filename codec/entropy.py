"""Entropy coding: one range-coder stream of whole numbers under exact probability tables.

Thin over ``constriction``'s range coder (a queue: symbols come back in the order they went
in, so a prefix of a stream decodes). All probabilities come from integer counts that are the
same on every machine; see `CLASS_TABLES` for the one family of tables that version 1 uses.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from math import isqrt, sqrt
from typing import Any

import constriction
import numpy as np

from .clip import IntArray
from .errors import DamagedError

CLASSES = 48
ESCAPE_LIMIT = 60  # symbols beyond ±60 (after their class's shift) are escaped
FIXED_POINT = 256  # activities are mean |difference| in 1/256

# Class c holds activities from CLASS_FLOORS[c]; each class is √2 wider than the last.
CLASS_FLOORS: IntArray = np.array([0] + [isqrt(36 << c) for c in range(1, CLASSES)], np.int64)


def _class_mean(index: int) -> float:
    """Return the mean |difference| that the class stands for."""
    low = float(CLASS_FLOORS[index])
    return 0.016 if index == 0 else sqrt(low * low * sqrt(2.0)) / FIXED_POINT


def _class_shift(index: int) -> int:
    """Return how many low bits of a difference are coded as they are, without a table."""
    return max(0, int(_class_mean(index) / 4.0).bit_length() - 1)


CLASS_SHIFTS: IntArray = np.array([_class_shift(index) for index in range(CLASSES)], np.int64)


@lru_cache(maxsize=CLASSES)
def class_probabilities(index: int) -> tuple[float, ...]:
    """Return the probabilities of -60 … 60 and of the escape in a class.

    Two-sided geometric, p(k) ~ theta^|k|, with the class's mean |k|. Built from square roots,
    products and integer counts only, all of which IEEE 754 rounds the same everywhere.
    """
    mean = _class_mean(index) / (1 << int(CLASS_SHIFTS[index]))
    theta = (sqrt(1.0 + mean * mean) - 1.0) / mean
    weight, weights = 1.0, []
    for _ in range(ESCAPE_LIMIT + 1):
        weights.append(weight)
        weight *= theta
    total = sum(weights) * 2.0 - 1.0
    half = [int(value / total * (1 << 20)) + 1 for value in weights]
    counts = [*half[:0:-1], *half, 16]
    return tuple(count / sum(counts) for count in counts)


@lru_cache(maxsize=CLASSES)
def _class_model(index: int) -> Any:
    table = np.array(class_probabilities(index))
    return constriction.stream.model.Categorical(table, perfect=False)


@lru_cache(maxsize=4096)
def _uniform_model(size: int) -> Any:
    return constriction.stream.model.Uniform(size)


class SymbolWriter:
    """Writes whole numbers into one stream of bytes."""

    def __init__(self) -> None:
        self._encoder: Any = constriction.stream.queue.RangeEncoder()

    def uniform(self, values: Iterable[int] | IntArray, size: int) -> None:
        """Write values that are each 0 … size - 1 (size up to 2^48), all equally likely."""
        array = np.asarray(values, np.int64)
        if size > 1 << 16:
            self.uniform(array >> 16, ((size - 1) >> 16) + 1)
            array, size = array & 0xFFFF, 1 << 16
        if size > 1 and array.size:
            self._encoder.encode(array.astype(np.int32), _uniform_model(size))

    def number(self, value: int) -> None:
        """Write one whole number from 0 to 2^47: its bit length, then its bits."""
        length = (value + 1).bit_length() - 1
        self.uniform([length], 48)
        self.uniform([value + 1 - (1 << length)], 1 << length)

    def differences(self, values: IntArray, class_index: int) -> None:
        """Write signed numbers (n,) under one class's table, with escapes."""
        shift = int(CLASS_SHIFTS[class_index])
        high = values >> shift
        symbols = high + ESCAPE_LIMIT
        far = np.abs(high) > ESCAPE_LIMIT
        symbols[far] = 2 * ESCAPE_LIMIT + 1
        self._encoder.encode(symbols.astype(np.int32), _class_model(class_index))
        if shift:
            self.uniform(values & ((1 << shift) - 1), 1 << shift)
        for value in high[far].tolist():
            self.number(2 * (abs(value) - ESCAPE_LIMIT - 1) + (value < 0))

    def to_bytes(self) -> bytes:
        """Return the stream: little-endian 32-bit words without the zero bytes at the end."""
        words = self._encoder.get_compressed()
        return bytes(np.asarray(words).astype("<u4").tobytes().rstrip(b"\0"))


class SymbolReader:
    """Reads what a `SymbolWriter` wrote; the calls must be the same, in the same order."""

    def __init__(self, data: bytes) -> None:
        words = np.frombuffer(data + b"\0" * (-len(data) % 4), "<u4").astype(np.uint32)
        self._decoder: Any = constriction.stream.queue.RangeDecoder(words)

    def _decode(self, model: Any, count: int) -> IntArray:
        try:
            return np.asarray(self._decoder.decode(model, count), np.int64)
        except AssertionError as problem:  # constriction's way to say "not made by this model"
            raise DamagedError("the coded stream does not fit its tables") from problem

    def uniform(self, count: int, size: int) -> IntArray:
        """Read ``count`` values that are each 0 … size - 1."""
        high = np.zeros(count, np.int64)
        if size > 1 << 16:
            high = self.uniform(count, ((size - 1) >> 16) + 1) << 16
            size = 1 << 16
        if size > 1 and count:
            high += self._decode(_uniform_model(size), count)
        return high

    def number(self) -> int:
        """Read one whole number."""
        length = int(self.uniform(1, 48)[0])
        return (1 << length) + int(self.uniform(1, 1 << length)[0]) - 1

    def differences(self, count: int, class_index: int) -> IntArray:
        """Read ``count`` signed numbers of one class."""
        shift = int(CLASS_SHIFTS[class_index])
        symbols = self._decode(_class_model(class_index), count)
        high = symbols - ESCAPE_LIMIT
        low = self.uniform(count, 1 << shift) if shift else 0
        for position in np.flatnonzero(symbols == 2 * ESCAPE_LIMIT + 1):
            code = self.number()
            size = (code >> 1) + ESCAPE_LIMIT + 1
            high[position] = -size if code & 1 else size
        return (high << shift) + low
