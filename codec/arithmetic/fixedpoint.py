"""Whole-number arithmetic on rotations: the same result on every machine.

A quaternion is four int64, (w, x, y, z) × 2^30; a vector is three, in any unit. Decoder and
encoder both follow a clip in these numbers, so that neither the order of a sum nor a
processor's sines can set them apart. Products are rounded to the nearest; no intermediate
value passes 2^62 for the magnitudes named.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from ..clip import FloatArray, IntArray
from .compiled import compiled

Turn: TypeAlias = tuple[int, int, int, int]
Vector: TypeAlias = tuple[int, int, int]

TURN_BITS = 30
ONE = 1 << TURN_BITS
HALF = 1 << (TURN_BITS - 1)
ANGLE_BITS = 28  # of rotation vectors, radians
LARGEST_ANGLE = 1 << (ANGLE_BITS + 2)  # 4 radians a component
MATRIX_BITS = 15
LOG_BITS = 8
_LOG_TABLE: IntArray = np.rint(np.log2(1 + np.arange(256) / 256) * (1 << LOG_BITS)).astype(np.int64)


def to_turns(quaternions: FloatArray) -> IntArray:
    """Return unit quaternions (…, 4) as whole numbers."""
    return np.rint(quaternions * ONE).astype(np.int64)


@compiled
def product(a: Turn, b: Turn) -> Turn:
    """Return the rotation ``b`` followed by ``a``."""
    return (
        (a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3] + HALF) >> TURN_BITS,
        (a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2] + HALF) >> TURN_BITS,
        (a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1] + HALF) >> TURN_BITS,
        (a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0] + HALF) >> TURN_BITS,
    )


@compiled
def between(a: Turn, b: Turn) -> Turn:
    """Return the rotation that takes ``b``'s axes into ``a``'s: a⁻¹ b."""
    return product((a[0], -a[1], -a[2], -a[3]), b)


@compiled
def unit(a: Turn) -> Turn:
    """Return ``a``, which is near length 1, nearer to it: one step of Newton's method."""
    square = (a[0] * a[0] + a[1] * a[1] + a[2] * a[2] + a[3] * a[3] + HALF) >> TURN_BITS
    factor = (3 * ONE - square) >> 1
    return (
        (a[0] * factor + HALF) >> TURN_BITS,
        (a[1] * factor + HALF) >> TURN_BITS,
        (a[2] * factor + HALF) >> TURN_BITS,
        (a[3] * factor + HALF) >> TURN_BITS,
    )


@compiled
def turn_of(x: int, y: int, z: int) -> Turn:
    """Return the rotation of a rotation vector, radians × 2^28, clamped to ±4 a component.

    Sine and cosine by their Taylor series in Horner's form: good to 2^-26 up to half a turn.
    """
    x = min(max(x, -LARGEST_ANGLE), LARGEST_ANGLE)
    y = min(max(y, -LARGEST_ANGLE), LARGEST_ANGLE)
    z = min(max(z, -LARGEST_ANGLE), LARGEST_ANGLE)
    one = 1 << ANGLE_BITS
    half_square = (x * x + y * y + z * z) >> (ANGLE_BITS + 2)
    cosine, sine = one, one  # the latter is sin(h) / h
    for k in range(12, 0, -1):
        cosine = one - ((cosine * half_square) >> ANGLE_BITS) // (2 * k * (2 * k - 1))
        sine = one - ((sine * half_square) >> ANGLE_BITS) // (2 * k * (2 * k + 1))
    shift = 2 * ANGLE_BITS - TURN_BITS + 1
    half = 1 << (shift - 1)
    return unit(
        (
            cosine << (TURN_BITS - ANGLE_BITS),
            (x * sine + half) >> shift,
            (y * sine + half) >> shift,
            (z * sine + half) >> shift,
        )
    )


@compiled
def vector_of(a: Turn) -> Vector:
    """Return the rotation vector of ``a``, radians × 2^30.

    The arc sine's series in Horner's form, short of the true angle beyond a right angle: what
    joints turn in a few frames is well below.
    """
    square = (a[1] * a[1] + a[2] * a[2] + a[3] * a[3]) >> TURN_BITS
    factor = ONE
    for k in range(7, 0, -1):
        factor = ONE + ((factor * square) >> TURN_BITS) * ((2 * k - 1) ** 2) // (
            2 * k * (2 * k + 1)
        )
    if a[0] < 0:
        factor = -factor
    shift = TURN_BITS - 1
    return (a[1] * factor) >> shift, (a[2] * factor) >> shift, (a[3] * factor) >> shift


@compiled
def rotated(a: Turn, x: int, y: int, z: int) -> Vector:
    """Return a vector, components up to 2^45, turned by ``a``."""
    half, shift = 1 << (MATRIX_BITS - 1), TURN_BITS - MATRIX_BITS
    w, i, j, k = a
    xx, yy, zz = (i * i) >> TURN_BITS, (j * j) >> TURN_BITS, (k * k) >> TURN_BITS
    xy, xz, yz = (i * j) >> TURN_BITS, (i * k) >> TURN_BITS, (j * k) >> TURN_BITS
    wx, wy, wz = (w * i) >> TURN_BITS, (w * j) >> TURN_BITS, (w * k) >> TURN_BITS
    return (
        (
            ((ONE - 2 * (yy + zz)) >> shift) * x
            + ((2 * (xy - wz)) >> shift) * y
            + ((2 * (xz + wy)) >> shift) * z
            + half
        )
        >> MATRIX_BITS,
        (
            ((2 * (xy + wz)) >> shift) * x
            + ((ONE - 2 * (xx + zz)) >> shift) * y
            + ((2 * (yz - wx)) >> shift) * z
            + half
        )
        >> MATRIX_BITS,
        (
            ((2 * (xz - wy)) >> shift) * x
            + ((2 * (yz + wx)) >> shift) * y
            + ((ONE - 2 * (xx + yy)) >> shift) * z
            + half
        )
        >> MATRIX_BITS,
    )


@compiled
def log2_of(value: int) -> int:
    """Return the binary logarithm of a whole number >= 1, × 256."""
    bits = 0
    high = value
    while high > 1:
        high >>= 1
        bits += 1
    mantissa = (value << 8) >> bits if bits < 48 else value >> (bits - 8)
    fraction: int = _LOG_TABLE[mantissa & 255]
    return (bits << LOG_BITS) + fraction
