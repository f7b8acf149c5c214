"""The exact rotation vector of a whole-number quaternion, for the encoder only."""

from __future__ import annotations

import math

from .compiled import compiled
from .fixedpoint import Turn


@compiled
def vector_to(a: Turn) -> tuple[float, float, float]:
    """Return the rotation vector (radians) of ``a``, at most half a turn long."""
    sine = math.sqrt(float(a[1]) * a[1] + float(a[2]) * a[2] + float(a[3]) * a[3])
    if sine == 0.0:
        return 0.0, 0.0, 0.0
    factor = 2.0 * math.atan2(sine, abs(float(a[0]))) / sine
    if a[0] < 0:
        factor = -factor
    return a[1] * factor, a[2] * factor, a[3] * factor
