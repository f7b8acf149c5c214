"""Rotation matrices, their logarithms, and Euler angles, vectorised over leading axes."""

from __future__ import annotations

import numpy as np

from ..clip import FloatArray


def from_axis_angle(vectors: FloatArray) -> FloatArray:
    """Return the rotation matrices (..., 3, 3) of rotation vectors (..., 3) in radians.

    Rodrigues' formula, with its series where the angle is small.
    """
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    square = x * x + y * y + z * z
    small = square < 1e-12
    safe = np.where(small, 1.0, square)
    angle = np.sqrt(safe)
    a = np.where(small, 1.0 - square / 6.0, np.sin(angle) / angle)
    b = np.where(small, 0.5 - square / 24.0, (1.0 - np.cos(angle)) / safe)
    out = np.empty((*vectors.shape[:-1], 3, 3))
    bx, by, bz = b * x, b * y, b * z
    ax, ay, az = a * x, a * y, a * z
    c = 1.0 - b * square
    out[..., 0, 0] = c + bx * x
    out[..., 1, 1] = c + by * y
    out[..., 2, 2] = c + bz * z
    out[..., 0, 1] = bx * y - az
    out[..., 1, 0] = bx * y + az
    out[..., 0, 2] = bx * z + ay
    out[..., 2, 0] = bx * z - ay
    out[..., 1, 2] = by * z - ax
    out[..., 2, 1] = by * z + ax
    return out


def to_axis_angle(matrices: FloatArray) -> FloatArray:
    """Return the rotation vectors (..., 3), radians, |v| <= pi, of matrices (..., 3, 3).

    Goes through the quaternion whose largest component is computed first (Shepperd 1978), so
    that it is accurate near 0 and near pi alike.
    """
    q = to_quaternions(matrices)
    w = q[..., 0]
    v = q[..., 1:]
    length = np.sqrt((v * v).sum(axis=-1))
    angle = 2.0 * np.arctan2(length, w)
    scale = np.where(length < 1e-9, 2.0, angle / np.where(length < 1e-9, 1.0, length))
    return np.asarray(v * scale[..., None])


def to_quaternions(matrices: FloatArray) -> FloatArray:
    """Return unit quaternions (..., 4) as (w, x, y, z) with w >= 0 of matrices (..., 3, 3)."""
    m = matrices
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    squares = np.stack(
        [1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz], axis=-1
    )
    sw = m[..., 2, 1] - m[..., 1, 2], m[..., 0, 2] - m[..., 2, 0], m[..., 1, 0] - m[..., 0, 1]
    xy = m[..., 0, 1] + m[..., 1, 0]
    xz = m[..., 0, 2] + m[..., 2, 0]
    yz = m[..., 1, 2] + m[..., 2, 1]
    rows = np.stack(
        [
            np.stack([squares[..., 0], sw[0], sw[1], sw[2]], axis=-1),
            np.stack([sw[0], squares[..., 1], xy, xz], axis=-1),
            np.stack([sw[1], xy, squares[..., 2], yz], axis=-1),
            np.stack([sw[2], xz, yz, squares[..., 3]], axis=-1),
        ],
        axis=-2,
    )
    best = squares.argmax(axis=-1)
    q = np.take_along_axis(rows, best[..., None, None], axis=-2)[..., 0, :]
    q /= np.sqrt((q * q).sum(axis=-1, keepdims=True))
    return np.where(q[..., :1] < 0, -q, q)


def from_quaternions(quaternions: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of quaternions (..., 4) as (w, x, y, z), of any length."""
    q = quaternions / np.sqrt(np.square(quaternions).sum(axis=-1, keepdims=True))
    w, x, y, z = (q[..., part] for part in range(4))
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = 1 - 2 * (y * y + z * z)
    out[..., 1, 1] = 1 - 2 * (x * x + z * z)
    out[..., 2, 2] = 1 - 2 * (x * x + y * y)
    out[..., 0, 1] = 2 * (x * y - w * z)
    out[..., 1, 0] = 2 * (x * y + w * z)
    out[..., 0, 2] = 2 * (x * z + w * y)
    out[..., 2, 0] = 2 * (x * z - w * y)
    out[..., 1, 2] = 2 * (y * z - w * x)
    out[..., 2, 1] = 2 * (y * z + w * x)
    return out


def about_axis(axis: int, angles: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of turns by ``angles`` (...) radians about X, Y or Z."""
    out = np.zeros((*angles.shape, 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    cos, sin = np.cos(angles), np.sin(angles)
    out[..., axis, axis] = 1.0
    out[..., i, i] = cos
    out[..., j, j] = cos
    out[..., i, j] = -sin
    out[..., j, i] = sin
    return out


def from_euler(order: str, angles: FloatArray) -> FloatArray:
    """Return the matrices (..., 3, 3) of intrinsic turns about ``order``, radians.

    ``order`` names the axes in the order of the file's channels (``"ZXY"``): R = Rz Rx Ry.
    ``angles``: (..., len(order)). Any number of axes, in any order, with repetition.
    """
    out = np.broadcast_to(np.eye(3), (*angles.shape[:-1], 3, 3))
    for position, letter in enumerate(order):
        turn = about_axis("XYZ".index(letter), angles[..., position])
        out = turn if position == 0 else out @ turn
    return np.asarray(out)


def to_euler(order: str, matrices: FloatArray) -> FloatArray:
    """Return the angles (..., len(order)), radians, whose `from_euler` comes nearest to R.

    Exact for three axes of which neighbours differ (Tait-Bryan and proper Euler); the middle
    angle of a Tait-Bryan order lies in [-pi/2, pi/2]. One or two axes give the best fit, and
    at gimbal lock the last angle is 0.
    """
    if len(order) == 3:
        return _three_angles(order, matrices)
    out = np.zeros((*matrices.shape[:-2], len(order)))
    rest = matrices
    if len(order) == 2:  # fit the first so that what is left is a turn about the second
        first, second = "XYZ".index(order[0]), "XYZ".index(order[1])
        column = matrices[..., :, second]
        i, j = (first + 1) % 3, (first + 2) % 3
        home = (np.arange(3) == second).astype(float)
        out[..., 0] = np.arctan2(
            column[..., j] * home[i] - column[..., i] * home[j],
            column[..., i] * home[i] + column[..., j] * home[j],
        )
        rest = np.swapaxes(about_axis(first, out[..., 0]), -1, -2) @ matrices
    if order:
        last = "XYZ".index(order[-1])
        i, j = (last + 1) % 3, (last + 2) % 3
        sine, cosine = rest[..., j, i] - rest[..., i, j], rest[..., i, i] + rest[..., j, j]
        out[..., -1] = np.arctan2(sine, cosine)
    return out


_LOCKED = 1e-8  # radians from gimbal lock, where rounding takes over


def _three_angles(order: str, m: FloatArray) -> FloatArray:
    i, j, k = ("XYZ".index(letter) for letter in order)
    out = np.empty((*m.shape[:-2], 3))
    if i == k:  # proper Euler: the third axis that does not appear completes the frame
        k = 3 - i - j
        sign = 1.0 if (j - i) % 3 == 1 else -1.0
        sine = np.hypot(m[..., i, j], m[..., i, k])
        out[..., 1] = np.arctan2(sine, m[..., i, i])
        locked = sine < _LOCKED
        out[..., 0] = np.where(
            locked,
            np.arctan2(sign * m[..., k, j], m[..., j, j]),
            np.arctan2(m[..., j, i], -sign * m[..., k, i]),
        )
        out[..., 2] = np.where(locked, 0.0, np.arctan2(m[..., i, j], sign * m[..., i, k]))
        return out
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    sine = np.clip(sign * m[..., i, k], -1.0, 1.0)
    cosine = np.hypot(m[..., i, i], m[..., i, j])
    out[..., 1] = np.arctan2(sine, cosine)
    locked = cosine < _LOCKED
    out[..., 0] = np.where(
        locked,
        np.arctan2(sign * m[..., k, j], m[..., j, j]),
        np.arctan2(-sign * m[..., j, k], m[..., k, k]),
    )
    out[..., 2] = np.where(locked, 0.0, np.arctan2(-sign * m[..., i, j], m[..., i, i]))
    return out
