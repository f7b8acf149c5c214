"""Rotation vectors in centimetres: scaled by what a turn about each axis displaces.

With M the inertia of a joint (cm², see `kinematics.inertia`) and M = Rᵀ R, the length of R v is
the displacement that a small turn v causes. A step of a quantiser then means the same for every
direction of every joint's signal: a twist about a long bone, which moves little, costs little.
"""

from __future__ import annotations

from math import isqrt

import numpy as np

from ..clip import FloatArray, IntArray
from ..geometry.kinematics import SHELL_INERTIA
from .compiled import compiled
from .fixedpoint import ANGLE_BITS, TURN_BITS, Vector

LENGTH_BITS = 20  # signals and features: 2^-20 cm
ROOT_BITS = 12  # the root: 2^-12 cm per radian
INERTIA_BITS = 8  # 1/256 cm²
INVERSE_BITS = 30  # its inverse: 2^-30 radians per cm
SCALE_COLUMNS = 12  # of a node's row: six of the root (by rows), six of its inverse
LARGEST_INERTIA = 1e6  # cm²: longer limbs than ten metres weigh no more


def bounded(inertia: FloatArray) -> FloatArray:
    """Return inertia tensors (joints, 3, 3) of the shell's 12 cm² and of at most 10^6 more."""
    beyond = inertia - SHELL_INERTIA * np.eye(3)
    traces = np.trace(beyond, axis1=1, axis2=2)
    factors = np.minimum(1.0, LARGEST_INERTIA / np.maximum(traces, 1.0))
    return np.asarray(SHELL_INERTIA * np.eye(3) + beyond * factors[:, None, None])


def scale_columns(inertia: list[int]) -> list[int]:
    """Return the upper triangular root, 2^-12 cm per radian, and its inverse × 2^30.

    ``inertia``: xx, xy, xz, yy, yz, zz in 1/256 cm². Whole numbers throughout: the Cholesky
    decomposition, row by row. A pivot is at least 1 cm.
    """
    shift = 2 * ROOT_BITS - INERTIA_BITS
    xx, xy, xz, yy, yz, zz = (value << shift for value in inertia)
    least = 1 << ROOT_BITS
    a = max(isqrt(max(xx, 0)), least)
    b, c = xy // a, xz // a
    d = max(isqrt(max(yy - b * b, 0)), least)
    e = (yz - b * c) // d
    f = max(isqrt(max(zz - c * c - e * e, 0)), least)
    one = 1 << (INVERSE_BITS + ROOT_BITS)
    return [
        *(a, b, c, d, e, f),
        *(one // a, -one * b // (a * d), one * (b * e - c * d) // (a * d * f)),
        *(one // d, -one * e // (d * f), one // f),
    ]


@compiled
def to_lengths(scale: IntArray, x: int, y: int, z: int, shift: int) -> Vector:
    """Return a rotation vector as a signal, 2^-20 cm; ``shift``: its bits after the point - 8.

    ``scale``: (12,) as by `scale_columns`.
    """
    return (
        (scale[0] * x + scale[1] * y + scale[2] * z) >> shift,
        (scale[3] * y + scale[4] * z) >> shift,
        (scale[5] * z) >> shift,
    )


@compiled
def to_angles(scale: IntArray, x: int, y: int, z: int) -> Vector:
    """Return a signal as a rotation vector, radians × 2^28."""
    shift = INVERSE_BITS + LENGTH_BITS - ANGLE_BITS
    return (
        (scale[6] * x + scale[7] * y + scale[8] * z) >> shift,
        (scale[9] * y + scale[10] * z) >> shift,
        (scale[11] * z) >> shift,
    )


@compiled
def signal_of(scale: IntArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the signal, 2^-20 cm, that `to_angles` makes a rotation vector (radians) of."""
    unit = float(1 << (INVERSE_BITS + LENGTH_BITS))
    third = z * unit / scale[11]
    second = (y * unit - scale[10] * third) / scale[9]
    return (x * unit - scale[7] * second - scale[8] * third) / scale[6], second, third


# what `to_lengths` shifts by, for the rotation vectors of `vector_of` and of `to_angles`
FROM_TURNS = TURN_BITS + ROOT_BITS - LENGTH_BITS
FROM_ANGLES = ANGLE_BITS + ROOT_BITS - LENGTH_BITS
