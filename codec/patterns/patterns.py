"""Patterns: representative segments of a body part, and how a clip is laid out in them.

A segment becomes a point in pattern space: its signals, time-normalised to 16 frames
(Gu et al. 2009, Sections 3.2 and 3.3). Distances there are root mean squares over frames and
joints, so they read as centimetres of displacement of a typical joint at a typical moment.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..clip import FloatArray, IntArray
from ..figure.bodyparts import BodyPart
from ..figure.rig import Family

PATTERN_FRAMES = 16
PATTERN_STEP = 2.0  # centimetres; a power of two, so that products with it are exact
_COSINE_BITS = 12


def _cosines() -> IntArray:
    """Return the orthonormal cosine basis (courses, frames) × 4096, rounded to integers.

    Integers, so that a machine whose cosine differs in the last bit gets the same patterns.
    """
    course, frame = np.ogrid[:PATTERN_FRAMES, :PATTERN_FRAMES]
    basis = np.cos(np.pi * course * (frame + 0.5) / PATTERN_FRAMES) * np.sqrt(2 / PATTERN_FRAMES)
    basis[0] /= np.sqrt(2.0)
    return np.asarray(np.rint(basis * (1 << _COSINE_BITS)), np.int64)


COSINES = _cosines()


@dataclass(frozen=True, eq=False)
class Codebook:
    """A rig family with the patterns of its parts, as of one generation of the store.

    ``patterns``: per part (patterns, 16, channels) int16, coefficients of `COSINES` along
    time in `PATTERN_STEP`; a part without patterns (the root part, always) has none of them.
    """

    family: Family
    patterns: tuple[npt.NDArray[np.int16], ...]

    @classmethod
    def empty(cls, family: Family) -> Codebook:
        """Return the codebook of a family of which nothing is known yet."""
        return cls(family, tuple(no_patterns(part) for part in family.parts))

    @cached_property
    def centimetres(self) -> tuple[FloatArray, ...]:
        """The patterns per part in centimetres."""
        return tuple(to_centimetres(values) for values in self.patterns)


def no_patterns(part: BodyPart) -> npt.NDArray[np.int16]:
    """Return zero patterns of the shape that ``part`` has."""
    return np.zeros((0, PATTERN_FRAMES, pattern_channels(part)), np.int16)


def pattern_channels(part: BodyPart) -> int:
    """Return how many channels the patterns of ``part`` have; 0 for the root part.

    The root part follows the root path, which every clip carries in full.
    """
    return 0 if part.parent < 0 else 3 * len(part.joints)


def to_coefficients(points: FloatArray) -> npt.NDArray[np.int16]:
    """Round points (n, 16, channels) in centimetres to stored cosine coefficients."""
    exact = np.einsum("kt,ntc->nkc", COSINES / (1 << _COSINE_BITS), points) / PATTERN_STEP
    return np.asarray(np.clip(np.rint(exact), -32767, 32767), np.int16)


def to_centimetres(patterns: npt.NDArray[np.int16]) -> FloatArray:
    """Return stored patterns (n, 16, channels) as points in centimetres, exactly alike anywhere."""
    sums = np.einsum("kt,nkc->ntc", COSINES, patterns.astype(np.int64))
    return np.asarray(sums * (PATTERN_STEP / (1 << _COSINE_BITS)))


def distance_scale(channels: int) -> float:
    """Return what a Euclidean distance of flattened points is divided by to be an RMS."""
    return float(np.sqrt(PATTERN_FRAMES * max(channels, 3) / 3.0))


def unfold(patterns: FloatArray, borders: IntArray) -> FloatArray:
    """Lay patterns (segments, 16, channels), centimetres, along a clip: (frames, channels).

    Segment s takes the frames ``borders[s]`` to ``borders[s + 1]``; its pattern is stretched
    over them by Catmull-Rom interpolation. Elementwise IEEE arithmetic in a fixed order, so
    that every machine gets the same bits: the coder predicts from this.
    """
    lengths = np.diff(borders)
    segment = np.repeat(np.arange(len(lengths)), lengths)
    if not len(segment):
        return np.zeros((0, patterns.shape[2]))
    ticks = (np.arange(len(segment)) - borders[:-1][segment]) * (PATTERN_FRAMES - 1)
    spans = np.maximum(lengths[segment] - 1, 1)
    knot = np.minimum(ticks // spans, PATTERN_FRAMES - 2)
    along = ((ticks - knot * spans) / spans)[:, None]
    before, after = np.maximum(knot - 1, 0), np.minimum(knot + 2, PATTERN_FRAMES - 1)
    p0, p1, p2, p3 = (patterns[segment, index] for index in (before, knot, knot + 1, after))
    slope1, slope2, rise = (p2 - p0) * 0.5, (p3 - p1) * 0.5, p2 - p1
    cubic = slope1 + slope2 - 2.0 * rise
    square = 3.0 * rise - 2.0 * slope1 - slope2
    return np.asarray(p1 + along * (slope1 + along * (square + along * cubic)))
