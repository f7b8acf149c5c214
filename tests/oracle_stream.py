"""Streams of symbols of index files of version 2, from docs/format.md alone.

Follows the section "Streams of symbols". Shares no code with ``motifold``.
"""

from __future__ import annotations

from bisect import bisect_right
from functools import cache
from math import floor, sqrt

TOP = 1 << 64
WHOLE = 1 << 24
LARGEST = 60  # of the high parts that have a symbol of their own
NOT_ZERO = (
    *(0.0006, 0.0046, 0.007, 0.010, 0.0157, 0.0247, 0.0405, 0.062, 0.1086, 0.1694, 0.2528),
    *(0.3558, 0.4708, 0.5882, 0.6857, 0.7652, 0.8277, 0.8709, 0.9062, 0.9299, 0.9509),
)  # N of the text
AGAIN = (
    *(0.06, 0.06, 0.06, 0.06, 0.06, 0.06, 0.06, 0.06, 0.0604, 0.0721, 0.1008),
    *(0.1473, 0.2271, 0.3321, 0.4437, 0.5504, 0.6452, 0.7273, 0.7965, 0.8527, 0.8957),
)  # A of the text


class SymbolReader:
    """A range decoder over the bytes of one stream."""

    def __init__(self, stream: bytes) -> None:
        self.stream = stream
        self.at = 0
        self.low = 0
        self.range = TOP - 1
        self.point = self.word() << 32
        self.point += self.word()

    def word(self) -> int:
        """Return the next word; beyond the end there are zero bytes."""
        found = self.stream[self.at : self.at + 4].ljust(4, b"\0")
        self.at += 4
        return int.from_bytes(found, "big")

    def symbol(self, table: tuple[int, ...]) -> int:
        """Return a symbol; ``table`` holds 0 = L[0] < … < L[n] = 2^24."""
        scale = self.range >> 24
        x = ((self.point - self.low) % TOP) // scale
        assert x < WHOLE, "no stream of symbols"
        k = bisect_right(table, x) - 1
        self.low = (self.low + scale * table[k]) % TOP
        self.range = scale * (table[k + 1] - table[k])
        if self.range < 1 << 32:
            self.low = (self.low << 32) % TOP
            self.range <<= 32
            self.point = ((self.point << 32) + self.word()) % TOP
        return k

    def uniform(self, n: int) -> int:
        return self.uniforms(n, 1)[0]

    def uniforms(self, n: int, count: int) -> list[int]:
        """Return an array of numbers below n: all high parts come before the low ones."""
        if n > 1 << 16:
            high = self.uniforms(((n - 1) >> 16) + 1, count)
            return [(part << 16) + self.symbol(even(1 << 16)) for part in high]
        if n == 1:
            return [0] * count
        return [self.symbol(even(n)) for _ in range(count)]

    def number(self) -> int:
        bits = self.uniform(48)
        return (1 << bits) + self.uniform(1 << bits) - 1

    def sized(self, c: int) -> int:
        """Return one signed number under table c."""
        shift, table = signed(c)
        high = self.symbol(table) - LARGEST
        if high > LARGEST:
            escaped = self.number()
            high = (escaped >> 1) + LARGEST + 1
            if escaped & 1:
                high = -high
        return (high << shift) + (self.uniform(1 << shift) if shift else 0)


@cache
def even(n: int) -> tuple[int, ...]:
    """Return the table of n equally likely symbols."""
    return (*(k * (WHOLE // n) for k in range(n)), WHOLE)


def counted(counts: list[int]) -> tuple[int, ...]:
    """Return the table of symbols with counts."""
    total = sum(counts)
    shares = [count / total for count in counts]
    below = [0.0]
    for share in shares:
        below.append(below[-1] + share)
    n = len(counts)
    scale = (WHOLE - n) / below[n]
    return (*(floor(below[k] * scale) + k for k in range(n)), WHOLE)


@cache
def signed(c: int) -> tuple[int, tuple[int, ...]]:
    """Return the shift of sized(c) and the table of its high parts."""
    mean = 2.0 ** (c // 4 - 7)
    for _ in range(c % 4):
        mean *= sqrt(sqrt(2.0))
    mean *= sqrt(sqrt(sqrt(2.0)))
    shift = max(0, floor(mean / 4).bit_length() - 1)
    mean /= 1 << shift
    again = (sqrt(1 + mean * mean) - 1) / mean
    zero = (1 - again) / (1 + again)
    if c < 40:
        j = c // 2
        i = j + 1 if c % 2 else max(j - 1, 0)
        zero = 1 - (0.75 * NOT_ZERO[j] + 0.25 * NOT_ZERO[i])
        again = 0.75 * AGAIN[j] + 0.25 * AGAIN[i]
    weight = (1 - zero) * (1 - again) / 2
    half = []
    for _ in range(LARGEST):
        half.append(floor(weight * 2**20) + 1)
        weight *= again
    return shift, counted([*half[::-1], floor(zero * 2**20) + 1, *half, 16])
