"""What was learned of a rig family's motion: prediction, basis and expected sizes, in integers.

A model has a *row* per joint's turn and one per joint's place. The numbers are integers, so
that every machine predicts the same; `learning` makes them from a sample of the library, and
`fixed_model` makes them from nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .blockcontext import feature_count
from .clip import IntArray

WEIGHT_BITS = 12
BASIS_BITS = 14
SIGNS = 10  # what expected sizes are linear in; see `blockcoder.signs_of`
GROUPS = 3  # coefficients of a block, by rank: each third has its own sensitivities


@dataclass(frozen=True, eq=False)
class MotionModel:
    """Prediction, basis and expected sizes of every row.

    ``span``: frames of a block; ``lags``: (4,) frames to look back; ``up``: vertical axis.
    ``weights``: (rows, features, channels) × 2^12, cm per cm. ``basis``: (rows, coefficients,
    channels) × 2^14, orthonormal but for rounding. ``base``: (rows, coefficients) and
    ``senses``: (rows, 3, 10), × 256: the binary logarithm of a coefficient's expected size in
    steps is base + senses · signs. ``starts``: (rows, 2, 3) the same of a first pose's
    difference, in cm, from the usual pose and from a reference clip's. ``still`` and
    ``sliding``: the joints that are so in most clips; see `nodes`.
    """

    span: int
    lags: IntArray
    up: int
    weights: IntArray
    basis: IntArray
    base: IntArray
    senses: IntArray
    starts: IntArray
    still: tuple[int, ...] = ()
    sliding: tuple[int, ...] = ()

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.weights)

    @property
    def channels(self) -> int:
        """Channels of a block: three a frame."""
        return 3 * self.span


def usual_span(frame_time: float) -> int:
    """Return how many frames a block has: about an eighth of a second, a power of two."""
    rate = 1.0 / frame_time
    return 4 if rate < 45.0 else 8 if rate < 180.0 else 16


def usual_lags(span: int) -> IntArray:
    """Return how many frames back of the last one a block's features look."""
    return np.array([1, 2, 3, 4] if span == 4 else [1, 2, 4, 8], np.int64)


def cosine_basis(span: int) -> npt.NDArray[np.float64]:
    """Return the orthonormal DCT-II of a block of three channels, (coefficients, channels).

    Coefficients are ordered by frequency, channels frame by frame.
    """
    k, t = np.meshgrid(np.arange(span), np.arange(span) + 0.5, indexing="ij")
    cosine = np.cos(np.pi * k * t / span) * np.sqrt(2.0 / span)
    cosine[0] *= np.sqrt(0.5)
    return np.kron(cosine, np.eye(3))


def fixed_model(rows: int, span: int, up: int = 1) -> MotionModel:
    """Return the model of a library too small to learn from.

    Prediction: a joint goes on turning as it did in the last frame, less and less, on top of
    what its guide does; basis: the cosine transform.
    """
    channels = 3 * span
    weights = np.zeros((rows, feature_count(span), channels))
    fade = np.cumsum(0.8 ** np.arange(1, span + 1))
    guide, past = 15, 15 + 3 * span
    for i in range(span):
        for c in range(3):
            weights[:, c, 3 * i + c] = -fade[i]  # the own way back one frame
            weights[:, guide + 3 * i + c, 3 * i + c] = 1.0
            weights[:, past + c, 3 * i + c] = fade[i]
    base = np.tile(-0.4 - 1.1 * np.log2(1.0 + np.arange(channels) // 3), (rows, 1))
    senses = np.zeros((rows, GROUPS, SIGNS))
    senses[:, :, 0] = 0.55
    senses[:, :, 1] = 0.2
    senses[:, :, 2] = 0.15
    return MotionModel(
        span,
        usual_lags(span),
        up,
        np.rint(weights * (1 << WEIGHT_BITS)).astype(np.int64),
        np.tile(np.rint(cosine_basis(span) * (1 << BASIS_BITS)).astype(np.int64), (rows, 1, 1)),
        np.rint(base * 256).astype(np.int64),
        np.rint(senses * 256).astype(np.int64),
        np.tile(np.array([3 * 256, 2 * 256], np.int64)[:, None], (rows, 1, 3)),
    )
