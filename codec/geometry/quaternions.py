"""Products of quaternions (w, x, y, z) in arrays."""

from __future__ import annotations

import numpy as np

from ..clip import FloatArray


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the rotations (…, 4) ``b`` followed by ``a``."""
    w, x, y, z = (a[..., i] for i in range(4))
    p, q, r, s = (b[..., i] for i in range(4))
    return np.stack(
        [
            w * p - x * q - y * r - z * s,
            w * q + x * p + y * s - z * r,
            w * r - x * s + y * p + z * q,
            w * s + x * r - y * q + z * p,
        ],
        axis=-1,
    )
