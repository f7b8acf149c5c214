"""What was learned of a rig family's motion: prediction, basis and expected sizes, in integers.

A model has a *row* per joint's turn and one per joint's place. The numbers are integers, so
that every machine predicts the same; `learning` makes them from a sample of the library, and
`fixed_model` makes them from nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from ..clip import FloatArray, IntArray
from ..figure.rig import Rig
from .blockcontext import feature_count

WEIGHT_BITS = 16
BASIS_BITS = 14
SIGNS = 10  # what expected sizes are linear in; see `blockcoder.expect`
GROUPS = 3  # coefficients of a block, by rank: each third has its own sensitivities


# Expected sizes of the fixed model, × 256: by course of its sine transform, and what they are
# sensitive to. Fitted once to clips of many sources, rates and tolerances, and rounded.
_FIXED_BASE = (-716, -1409, -1814, -2038, -1882, -1970, -2036, -2008, -1817)
_FIXED_SENSES = (145, 27, 50, -6, -132, 209, 0, 0, 0, 0)


@dataclass(frozen=True, eq=False)
class MotionModel:
    """Prediction, basis and expected sizes of every row.

    ``span``: frames of a block; ``lags``: (4,) frames to look back; ``up``: vertical axis.
    ``folded_weights``: (rows, features, channels) × 2^16, cm per cm; ``folded_basis``: (rows,
    coefficients, channels) × 2^14, what each coefficient adds to the block; both with every
    course along a block as its cosine transform, in which most of them are near zero.
    ``base``: (rows, coefficients) and ``senses``: (rows, 3, 10), × 256: the binary logarithm
    of a coefficient's expected size in steps is base + senses · signs. ``starts``: (rows, 2,
    3) the same of a first pose's difference, in cm, from the usual pose and from a reference
    clip's. ``still`` and ``sliding``: the joints that are so in most clips; see `nodes`.
    ``hinged``: those of the family, whose rows of the fixed model differ.
    """

    span: int
    lags: IntArray
    up: int
    folded_weights: IntArray
    folded_basis: IntArray
    base: IntArray
    senses: IntArray
    starts: IntArray
    still: tuple[int, ...] = ()
    sliding: tuple[int, ...] = ()
    hinged: tuple[int, ...] = ()

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.folded_weights)

    @cached_property
    def weights(self) -> IntArray:
        """(rows, features, channels) weights × 2^16 of frames as they are."""
        over = _cosines(self.span)
        half = 1 << (BASIS_BITS - 1)
        features = fold_features(self.span)
        once = (features.T @ self.folded_weights + half) >> BASIS_BITS
        return (once @ over + half) >> BASIS_BITS

    @cached_property
    def basis(self) -> IntArray:
        """(rows, coefficients, channels) the basis × 2^14 of frames as they are."""
        half = 1 << (BASIS_BITS - 1)
        return (self.folded_basis @ _cosines(self.span) + half) >> BASIS_BITS

    @cached_property
    def analysis(self) -> FloatArray:
        """(rows, coefficients, channels) × 2^14: what finds the coefficients of signals.

        The basis need not be orthonormal; where it were, this would be the basis itself. Only
        encoders use it.
        """
        inverse = np.linalg.pinv(self.basis / float(1 << BASIS_BITS))
        return np.ascontiguousarray(inverse.transpose(0, 2, 1) * float(1 << BASIS_BITS))

    @property
    def channels(self) -> int:
        """Channels of a block: three a frame."""
        return 3 * self.span


def usual_span(frame_time: float) -> int:
    """Return how many frames a block has: about an eighth of a second, a power of two."""
    rate = 1.0 / frame_time
    return 4 if rate < 45.0 else 8 if rate < 180.0 else 16


def model_key(rig: Rig) -> str:
    """Return the key of the model that a rig's clips share: its family and its frame rate."""
    return f"{rig.family_key}-{usual_span(rig.frame_time)}"


def usual_lags(span: int) -> IntArray:
    """Return how many frames back of the last one a block's features look."""
    return np.array([1, 2, 3, 4] if span == 4 else [1, 2, 4, 8], np.int64)


def cosine_basis(span: int) -> npt.NDArray[np.float64]:
    """Return the orthonormal DCT-II of a block of three channels, (coefficients, channels).

    Coefficients are ordered by frequency, channels frame by frame. Rounded to 2^-40: machines
    differ in the last bits of cosines, and models are fitted with these.
    """
    k, t = np.meshgrid(np.arange(span), np.arange(span) + 0.5, indexing="ij")
    cosine = np.cos(np.pi * k * t / span) * np.sqrt(2.0 / span)
    cosine[0] *= np.sqrt(0.5)
    return np.kron(np.rint(cosine * 2.0**40) * 2.0**-40, np.eye(3))


def sine_basis(span: int) -> npt.NDArray[np.float64]:
    """Return the orthonormal DST-VII of a block of three channels, (coefficients, channels).

    What prediction leaves over is next to nothing beside the last decoded frame, and grows: so
    do these sines (Han, Saxena, Melkote & Rose, Jointly optimized spatial prediction and block
    transform for video and image coding, 2012, for pictures beside decoded borders).
    """
    k, t = np.meshgrid(2 * np.arange(span) + 1, np.arange(span) + 1, indexing="ij")
    sine = np.sin(np.pi * k * t / (2 * span + 1)) * 2.0 / np.sqrt(2 * span + 1)
    return np.kron(sine, np.eye(3))


@lru_cache(maxsize=8)
def _folded_sines(span: int) -> IntArray:
    """Return the fixed model's folded basis: `sine_basis`, folded, × 2^14."""
    fine = sine_basis(span) @ cosine_basis(span).T
    return np.rint(fine * (1 << BASIS_BITS)).astype(np.int64)


@lru_cache(maxsize=8)
def _cosines(span: int) -> IntArray:
    """Return `cosine_basis` × 2^14."""
    return np.rint(cosine_basis(span) * (1 << BASIS_BITS)).astype(np.int64)


@lru_cache(maxsize=8)
def fold_features(span: int) -> IntArray:
    """Return what folds features: (folded, features) × 2^14, orthonormal but for rounding.

    The guide's and the carrier's frames of the block become their cosine transforms.
    """
    features = feature_count(span)
    fold = np.eye(features, dtype=np.int64) << BASIS_BITS
    for at in (15, 15 + 3 * span + 6):
        fold[at : at + 3 * span, at : at + 3 * span] = _cosines(span)
    return fold


def folded(weights: FloatArray, span: int, bits: FloatArray) -> IntArray:
    """Return weights (…, features, channels) folded, with ``bits`` (features,) low bits zero."""
    fold = fold_features(span) / float(1 << BASIS_BITS)
    fine = fold @ weights @ cosine_basis(span).T * (1 << WEIGHT_BITS)
    grain = np.exp2(bits)[:, None]
    return np.asarray(np.rint(fine / grain) * grain, np.int64)


def fixed_model(rows: int, span: int, up: int = 1, hinged: tuple[int, ...] = ()) -> MotionModel:
    """Return the model of a library too small to learn from.

    Prediction: a joint goes on turning as it did in the last frame, less and less, on top of
    what its guide does (but one that is ``hinged``, for its guide sees it at rest); basis: a
    sine transform.
    """
    channels = 3 * span
    weights = np.zeros((1, feature_count(span), channels))
    fade = np.cumsum(0.8 ** np.arange(1, span + 1))
    guide, past = 15, 15 + 3 * span
    for i in range(span):
        for c in range(3):
            weights[:, c, 3 * i + c] = -fade[i]  # the own way back one frame
            weights[:, guide + 3 * i + c, 3 * i + c] = 1.0
            weights[:, past + c, 3 * i + c] = fade[i]
    folded_weights = np.repeat(folded(weights, span, np.zeros(feature_count(span))), rows, axis=0)
    folded_weights[list(hinged), guide : past + 6] = 0
    course = np.minimum(np.arange(channels) // 3, len(_FIXED_BASE) - 1)
    base = np.tile(np.array(_FIXED_BASE, np.int64)[course], (rows, 1))
    senses = np.tile(np.array(_FIXED_SENSES, np.int64), (rows, GROUPS, 1))
    return MotionModel(
        span,
        usual_lags(span),
        up,
        folded_weights,
        np.tile(_folded_sines(span), (rows, 1, 1)),
        base,
        senses,
        np.tile(np.array([3 * 256, 2 * 256], np.int64)[:, None], (rows, 1, 3)),
        hinged=hinged,
    )
