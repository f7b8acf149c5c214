"""Whole-number rotations of index files of version 2, from docs/format.md alone.

Follows the section "Whole-number rotations", and holds the small functions that several sections
use. Shares no code with ``motifold``.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import log2
from typing import TypeAlias

Four: TypeAlias = tuple[int, int, int, int]
Three: TypeAlias = tuple[int, int, int]
ONE = 1 << 30
HALF = 1 << 29
SAME: Four = (ONE, 0, 0, 0)
LOGARITHMS = [round(256 * log2(1 + i / 256)) for i in range(256)]


def clamped(value: int, limit: int) -> int:
    return max(-limit, min(value, limit))


def product(a: Four, b: Four) -> Four:
    w, x, y, z = a
    p, q, r, s = b
    return (
        (w * p - x * q - y * r - z * s + HALF) >> 30,
        (w * q + x * p + y * s - z * r + HALF) >> 30,
        (w * r - x * s + y * p + z * q + HALF) >> 30,
        (w * s + x * r - y * q + z * p + HALF) >> 30,
    )


def inverse(a: Four) -> Four:
    return (a[0], -a[1], -a[2], -a[3])


def between(a: Four, b: Four) -> Four:
    return product(inverse(a), b)


def unit(a: Four) -> Four:
    w, x, y, z = a
    n = (w * w + x * x + y * y + z * z + HALF) >> 30
    g = (3 * ONE - n) >> 1
    return ((w * g + HALF) >> 30, (x * g + HALF) >> 30, (y * g + HALF) >> 30, (z * g + HALF) >> 30)


def turn_of(vector: Three) -> Four:
    """Return the turn of a rotation vector in radians × 2^28."""
    x, y, z = (clamped(component, 1 << 30) for component in vector)
    h = (x * x + y * y + z * z) >> 30
    c = e = 1 << 28
    for k in range(12, 0, -1):
        c = (1 << 28) - ((c * h) >> 28) // (2 * k * (2 * k - 1))
        e = (1 << 28) - ((e * h) >> 28) // (2 * k * (2 * k + 1))
    half = 1 << 26
    return unit((c << 2, (x * e + half) >> 27, (y * e + half) >> 27, (z * e + half) >> 27))


def vector_of(a: Four) -> Three:
    """Return the rotation vector of a turn in radians × 2^30."""
    w, x, y, z = a
    n = (x * x + y * y + z * z) >> 30
    g = ONE
    for k in range(7, 0, -1):
        g = ONE + (((g * n) >> 30) * (2 * k - 1) ** 2) // (2 * k * (2 * k + 1))
    if w < 0:
        g = -g
    return ((x * g) >> 29, (y * g) >> 29, (z * g) >> 29)


def rotated(a: Four, v: Three) -> Three:
    w, x, y, z = a
    xx, yy, zz = (x * x) >> 30, (y * y) >> 30, (z * z) >> 30
    xy, xz, yz = (x * y) >> 30, (x * z) >> 30, (y * z) >> 30
    wx, wy, wz = (w * x) >> 30, (w * y) >> 30, (w * z) >> 30

    def component(p: int, q: int, r: int) -> int:
        return ((p >> 15) * v[0] + (q >> 15) * v[1] + (r >> 15) * v[2] + (1 << 14)) >> 15

    return (
        component(ONE - 2 * (yy + zz), 2 * (xy - wz), 2 * (xz + wy)),
        component(2 * (xy + wz), ONE - 2 * (xx + zz), 2 * (yz - wx)),
        component(2 * (xz - wy), 2 * (yz + wx), ONE - 2 * (xx + yy)),
    )


def log(v: int) -> int:
    """Return the logarithm to base 2 of v >= 1, × 256."""
    b = v.bit_length() - 1
    m = v >> (b - 8) if b >= 48 else (v << 8) >> b
    return 256 * b + LOGARITHMS[m % 256]


def class_of(v: int) -> int:
    return max(0, min((v >> 6) + 28, 119))


def refined(step: int, f: int) -> int:
    """Return s(f): the step refined by f quarter octaves."""
    return max(((step >> (f // 4)) * (256, 215, 181, 152)[f % 4]) >> 8, 1)


def added(a: Sequence[int], v: Three) -> Four:
    """Return a place, moved by a vector."""
    return (a[0] + v[0], a[1] + v[1], a[2] + v[2], 0)


def difference(a: Sequence[int], b: Sequence[int]) -> Three:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
