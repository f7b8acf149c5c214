"""Entropy coding: one range-coder stream of whole numbers under exact probability tables.

Thin over ``constriction``'s range coder (a queue: symbols come back in the order they went
in, so a prefix of a stream decodes). All probabilities come from integer counts that are the
same on every machine; see `CLASS_TABLES` for the one family of tables that version 1 uses.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from math import isqrt, log2, sqrt
from typing import Any

import constriction
import numpy as np

from ..clip import IntArray
from ..errors import DamagedError, GuaranteeError
from .sizeclasses import ESCAPE, SYMBOL_LIMIT, class_floors, class_models, class_shifts

CLASSES = 48
ESCAPE_LIMIT = 60  # symbols beyond ±60 (after their class's shift) are escaped
FIXED_POINT = 256  # activities are mean |difference| in 1/256
LONGEST_NUMBER = 47  # bits
WHOLE_BITS = 16  # of a number whose values are equally likely, coded at once
STATE_MASK = (1 << 64) - 1  # of the range coder

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


@lru_cache(maxsize=CLASSES)
def least_bits(index: int) -> float:
    """Return what a difference of a class costs at the least, without its low bits."""
    return -log2(max(class_probabilities(index)))


@lru_cache(maxsize=4096)
def _uniform_model(size: int) -> Any:
    return constriction.stream.model.Uniform(size)


# More than all that a writer gets for nothing: symbols that come first in their tables, at the
# end of a stream, are zero bytes, which are cut off.
_CREDIT_BITS = 4096.0


class SymbolWriter:
    """Writes whole numbers into one stream of bytes."""

    def __init__(self) -> None:
        self._encoder: Any = constriction.stream.queue.RangeEncoder()

    def uniform(self, values: Iterable[int] | IntArray, size: int) -> None:
        """Write values that are each 0 … size - 1 (size up to 2^48), all equally likely."""
        array = np.asarray(values, np.int64)
        if size > 1 << WHOLE_BITS:
            self.uniform(array >> WHOLE_BITS, ((size - 1) >> WHOLE_BITS) + 1)
            array, size = array & ((1 << WHOLE_BITS) - 1), 1 << WHOLE_BITS
        if size > 1 and array.size:
            self._encoder.encode(array.astype(np.int32), _uniform_model(size))

    def number(self, value: int) -> None:
        """Write one whole number from 0 to 2^48 - 2: its bit length, then its bits.

        Raises `GuaranteeError` for a larger one: a jump of 2^46 steps and more.
        """
        length = (value + 1).bit_length() - 1
        if length > LONGEST_NUMBER:
            raise GuaranteeError(
                "a jump is too large for so small a tolerance", advice="Ask for a larger tolerance"
            )
        self.uniform([length], LONGEST_NUMBER + 1)
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

    def sized(self, values: IntArray, classes: IntArray) -> None:
        """Write signed numbers (n,), each under the table of its own class of `sizeclasses`."""
        models, shifts, encode = class_models(), class_shifts(), self._encoder.encode
        for value, index in zip(values.tolist(), classes.tolist(), strict=True):
            shift = shifts[index]
            high = value >> shift
            if -SYMBOL_LIMIT <= high <= SYMBOL_LIMIT:
                encode(high + SYMBOL_LIMIT, models[index])
            else:
                encode(ESCAPE, models[index])
                self.number(2 * (abs(high) - SYMBOL_LIMIT - 1) + (high < 0))
            if shift > WHOLE_BITS:
                self.uniform([value & ((1 << shift) - 1)], 1 << shift)
            elif shift:
                encode(value & ((1 << shift) - 1), _uniform_model(1 << shift))

    def to_bytes(self) -> bytes:
        """Return the stream in the fewest bytes that mean it.

        A range coder's stream is a number; any one of an interval will do, and bytes that are
        missing at its end are read as zeros. So it is the one of the interval that ends in the
        most zero bytes, without them.
        """
        words = [int(word) for word in self._encoder.get_compressed()]
        position: tuple[int, tuple[int, int]] = self._encoder.pos()
        whole, (lower, width) = position
        count = whole + 2  # the coder's state is two words more
        words += [0] * (count - len(words))
        sealed = int.from_bytes(np.array(words, ">u4").tobytes(), "big")
        first = sealed - ((sealed - lower) & STATE_MASK)
        value, zeros = first, 0
        while zeros < 32 * count:
            zeros += 8
            rounded = -(-first >> zeros) << zeros
            if rounded >= first + width:
                break
            value = rounded
        return value.to_bytes(4 * count, "big").rstrip(b"\0")

    def to_words(self) -> bytes:
        """Return the stream as in version 1: little-endian words without zero bytes at the end."""
        words = self._encoder.get_compressed()
        return bytes(np.asarray(words).astype("<u4").tobytes().rstrip(b"\0"))


class SymbolReader:
    """Reads what a `SymbolWriter` wrote; the calls must be the same, in the same order.

    A stream decodes for ever, whatever it holds. So that time and memory stay in proportion to
    its bytes, every symbol is charged what it must have cost at the least, and a stream that is
    overdrawn raises `DamagedError`.
    """

    def __init__(self, data: bytes, words: str = ">u4") -> None:
        """``words``: how the stream's words are written, "<u4" in version 1."""
        self._bits_left = 8.0 * len(data) + _CREDIT_BITS
        whole = np.frombuffer(data + b"\0" * (-len(data) % 4), words).astype(np.uint32)
        self._decoder: Any = constriction.stream.queue.RangeDecoder(whole)

    def _charge(self, bits: float) -> None:
        self._bits_left -= 0.99 * bits  # what rounding of the tables may gain
        if self._bits_left < 0.0:
            raise DamagedError("the coded stream ends before its symbols do")

    def _decode(self, model: Any, count: int) -> IntArray:
        try:
            return np.asarray(self._decoder.decode(model, count), np.int64)
        except AssertionError as problem:  # constriction's way to say "not made by this model"
            raise DamagedError("the coded stream does not fit its tables") from problem

    def uniform(self, count: int, size: int) -> IntArray:
        """Read ``count`` values that are each 0 … size - 1."""
        # the last of many values may be more likely than the others, but costs 8 bits at least
        self._charge(count * min(log2(size), 8.0))
        values = self._uniform(count, size)
        if size > 1 << WHOLE_BITS and count and values.max() >= size:
            raise DamagedError(f"the coded stream names number {values.max()} of {size}")
        return values

    def _uniform(self, count: int, size: int) -> IntArray:
        high = np.zeros(count, np.int64)
        if size > 1 << WHOLE_BITS:
            high = self._uniform(count, ((size - 1) >> WHOLE_BITS) + 1) << WHOLE_BITS
            size = 1 << WHOLE_BITS
        if size > 1 and count:
            high += self._decode(_uniform_model(size), count)
        return high

    def number(self) -> int:
        """Read one whole number."""
        length = int(self.uniform(1, LONGEST_NUMBER + 1)[0])
        return (1 << length) + int(self.uniform(1, 1 << length)[0]) - 1

    def differences(self, count: int, class_index: int) -> IntArray:
        """Read ``count`` signed numbers of one class."""
        shift = int(CLASS_SHIFTS[class_index])
        self._charge(count * least_bits(class_index))
        symbols = self._decode(_class_model(class_index), count)
        high = symbols - ESCAPE_LIMIT
        # not charged: low bits that are 0 cost nothing at the end of a stream
        low = self._uniform(count, 1 << shift) if shift else 0
        for position in np.flatnonzero(symbols == 2 * ESCAPE_LIMIT + 1):
            code = self.number()
            size = (code >> 1) + ESCAPE_LIMIT + 1
            high[position] = -size if code & 1 else size
        return (high << shift) + low

    def sized(self, classes: IntArray) -> IntArray:
        """Read signed numbers (n,), each of its own class."""
        models, shifts, floors = class_models(), class_shifts(), class_floors()
        decode = self._decoder.decode
        out, spent = [], 0.0
        try:
            for index in classes.tolist():
                high = decode(models[index]) - SYMBOL_LIMIT
                spent += floors[index]
                if high == ESCAPE - SYMBOL_LIMIT:
                    code = self.number()
                    size = (code >> 1) + SYMBOL_LIMIT + 1
                    high = -size if code & 1 else size
                shift = shifts[index]
                if shift > WHOLE_BITS:
                    high = (high << shift) + int(self._uniform(1, 1 << shift)[0])
                elif shift:
                    high = (high << shift) + decode(_uniform_model(1 << shift))
                out.append(high)
            numbers = np.array(out, np.int64)
        # constriction's way to say "not made by this model"; an escape beyond 64 bits
        except (AssertionError, OverflowError) as problem:
            raise DamagedError("the coded stream does not fit its tables") from problem
        self._charge(spent)
        return numbers
