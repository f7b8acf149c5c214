"""How the legs of a walk, a run and steps on the spot move over a stride.

Drawn by hand after what gait laboratories report for healthy adults (Winter 1991, The
Biomechanics and Motor Control of Human Gait), with the foot's pitch in place of the ankle's
angle, so that a loaded foot lies flat.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..codec.clip import FloatArray


class Gait(NamedTuple):
    """One way to go. Angles in degrees, curves at every twentieth of a stride from heel strike."""

    strides: float  # per second
    freedom: float  # how much of a style the legs show
    contact: float  # phase at which a foot begins to carry the body
    stance: float  # part of the stride that a foot carries the body
    shift: float  # part of the stride in which the weight is handed over
    swing: float  # arm swing to each side
    elbow: float
    lean: float
    rests: float  # how often it starts, and ends, standing
    thigh: tuple[float, ...]  # forwards of vertical
    knee: tuple[float, ...]
    foot: tuple[float, ...]  # toes up


# fmt: off
WALK = Gait(
    0.92, 1.0, 0.04, 0.5, 0.09, 21.0, 20.0, 2.0, 0.4,
    (24, 22.5, 19.5, 15, 10, 5, 0, -5, -10, -15, -18, -16.5, -10, 0, 10, 18, 24.5, 27.5, 27.5, 26),
    (5, 10, 15, 17, 15.5, 12.5, 9, 7, 6, 8, 13.5, 25, 40, 54, 61, 59, 48, 32, 15, 6),
    (20, 8, 1, 0, 0, 0, 0, 0, -3, -9, -19, -37, -58, -64, -56, -37, -16, 2, 14, 21),
)
RUN = Gait(
    1.28, 0.45, 0.0, 0.31, 0.05, 33.0, 78.0, 9.0, 0.0,
    (27, 23, 17, 10, 2, -6, -13, -18, -18, -13, -5, 5, 17, 28, 37, 42, 44, 42, 38, 32),
    (16, 31, 41, 43, 39, 31, 24, 24, 33, 53, 71, 86, 95, 95, 84, 63, 43, 26, 16, 12),
    (9, 2, 0, 0, -3, -12, -30, -48, -69, -84, -91, -93, -87, -73, -51, -23, 1, 16, 22, 20),
)
SHUFFLE = Gait(  # steps on the spot, to turn
    0.78, 1.0, 0.05, 0.5, 0.09, 5.0, 16.0, 1.0, 1.0,
    (4, 3, 2, 2, 2, 2, 2, 2, 2, 2, 3, 6, 12, 19, 25, 28, 26, 19, 10, 5),
    (8, 9, 9, 8, 7, 7, 7, 7, 7, 8, 11, 19, 32, 44, 50, 50, 43, 29, 15, 9),
    (0, 0, 0, 0, 0, 0, 0, 0, 0, 0, -1, -6, -14, -20, -20, -15, -8, -2, 1, 1),
)
# fmt: on
_HARMONICS = 8


def leg_angles(gait: Gait, phase: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return thigh, knee and foot angles in degrees at every ``phase`` (any shape), strides."""
    waves = np.exp(2j * np.pi * phase[..., None] * np.arange(_HARMONICS))
    thigh, knee, foot = np.moveaxis((waves @ _harmonics(gait)).real, -1, 0)
    return thigh, knee, foot


@lru_cache(maxsize=8)
def _harmonics(gait: Gait) -> npt.NDArray[np.complex128]:
    """Return Fourier coefficients (harmonics, 3) of the thigh, knee and foot curves."""
    curves = np.array([gait.thigh, gait.knee, gait.foot], float)
    found = np.fft.rfft(curves, axis=1)[:, :_HARMONICS].T / curves.shape[1]
    found[1:] *= 2.0
    return np.asarray(found)
