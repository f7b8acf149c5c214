"""What motifold calls of the package constriction, in plain Python: slow, and the same bytes.

For machines that it has no wheel for and that have no Rust to build it. A range coder of 32-bit
words with a 64-bit state, and two models, from docs/format.md ("Streams of symbols").
"""

from __future__ import annotations

from bisect import bisect_right
from math import floor
from types import SimpleNamespace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

STATE, MASK, WHOLE = 1 << 64, (1 << 64) - 1, 1 << 24


class Model(Protocol):
    """How probable each symbol is, in parts of 2^24."""

    def bounds(self, symbol: int) -> tuple[int, int]:
        """Return where a symbol's share begins, and its width."""
        ...

    def find(self, point: int) -> int:
        """Return the symbol whose share holds a point."""
        ...


class Uniform:
    """Symbols that are equally likely."""

    def __init__(self, size: int) -> None:
        if not 2 <= size <= WHOLE:
            raise ValueError(size)
        self._size, self._each = size, WHOLE // size

    def bounds(self, symbol: int) -> tuple[int, int]:
        """Return where a symbol's share begins, and its width."""
        if not 0 <= symbol < self._size:
            raise ValueError(symbol)
        low = symbol * self._each
        return low, WHOLE - low if symbol == self._size - 1 else self._each

    def find(self, point: int) -> int:
        """Return the symbol whose share holds a point."""
        return min(point // self._each, self._size - 1)


class Categorical:
    """Symbols whose probabilities are given."""

    def __init__(self, probabilities: npt.ArrayLike, perfect: bool) -> None:
        if perfect:
            raise NotImplementedError("motifold does not ask for perfect models")
        shares: list[float] = np.asarray(probabilities, np.float64).tolist()
        total = 0.0
        for share in shares:  # one by one: np.sum adds in pairs, and may round otherwise
            total += share
        scale = (WHOLE - len(shares)) / total
        below, self._table = 0.0, list[int]()
        for symbol, share in enumerate(shares):
            self._table.append(floor(below * scale) + symbol)
            below += share
        self._table.append(WHOLE)

    def bounds(self, symbol: int) -> tuple[int, int]:
        """Return where a symbol's share begins, and its width."""
        if not 0 <= symbol < len(self._table) - 1:
            raise ValueError(symbol)
        return self._table[symbol], self._table[symbol + 1] - self._table[symbol]

    def find(self, point: int) -> int:
        """Return the symbol whose share holds a point."""
        return bisect_right(self._table, point) - 1


class RangeEncoder:
    """Writes symbols, to be read in the order that they were written."""

    def __init__(self) -> None:
        self._words: list[int] = []
        self._low, self._range = 0, MASK

    def encode(self, symbols: Any, model: Model) -> None:
        """Write a symbol, or an array of them."""
        for symbol in np.atleast_1d(symbols).tolist():
            low, width = model.bounds(symbol)
            scale = self._range >> 24
            self._low += scale * low
            self._range = scale * width
            if self._low > MASK:
                self._low -= STATE
                _carry(self._words)
            if self._range < 1 << 32:
                self._words.append(self._low >> 32)
                self._low = (self._low << 32) & MASK
                self._range <<= 32

    def pos(self) -> tuple[int, tuple[int, int]]:
        """Return how many words there are, and the state."""
        return len(self._words), (self._low, self._range)

    def get_compressed(self) -> npt.NDArray[np.uint32]:
        """Return the words of all symbols so far."""
        words = list(self._words)
        if self._range != MASK:
            point = self._low + (1 << 32) - 1
            if point > MASK:
                point -= STATE
                _carry(words)
            words.append(point >> 32)
            if ((self._low + self._range) & MASK) >> 32 == point >> 32:
                words.append(0)
        return np.array(words, np.uint32)


class RangeDecoder:
    """Reads what a `RangeEncoder` wrote."""

    def __init__(self, words: npt.ArrayLike) -> None:
        self._words: list[int] = np.asarray(words, np.uint32).tolist()
        self._at, self._low, self._range = 0, 0, MASK
        self._point = (self._word() << 32) + self._word()

    def decode(self, model: Model, count: int | None = None) -> Any:
        """Return a symbol, or ``count`` of them (count,)."""
        if count is None:
            return self._one(model)
        return np.array([self._one(model) for _ in range(count)], np.int32)

    def _one(self, model: Model) -> int:
        scale = self._range >> 24
        point = ((self._point - self._low) & MASK) // scale
        if point >= WHOLE:
            raise AssertionError("invalid for the employed entropy model")  # as constriction does
        symbol = model.find(point)
        low, width = model.bounds(symbol)
        self._low = (self._low + scale * low) & MASK
        self._range = scale * width
        if self._range < 1 << 32:
            self._low = (self._low << 32) & MASK
            self._range <<= 32
            self._point = ((self._point << 32) & MASK) + self._word()
        return symbol

    def _word(self) -> int:
        self._at += 1
        return self._words[self._at - 1] if self._at <= len(self._words) else 0


def _carry(words: list[int]) -> None:
    at = len(words) - 1
    while words[at] == 0xFFFFFFFF:
        words[at] = 0
        at -= 1
    words[at] += 1


stream = SimpleNamespace(
    queue=SimpleNamespace(RangeEncoder=RangeEncoder, RangeDecoder=RangeDecoder),
    model=SimpleNamespace(Uniform=Uniform, Categorical=Categorical),
)
