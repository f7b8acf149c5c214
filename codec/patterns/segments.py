"""A clip as the paper sees it: every body part cut into segments, each a point in pattern space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..clip import Clip, FloatArray, IntArray, MarkerClip
from ..errors import UsageError
from ..figure.rig import Family
from ..geometry.gaps import filled
from ..geometry.kinematics import world_rotations
from .fisher import optimal_partition
from .patterns import PATTERN_FRAMES, pattern_channels
from .segmentation import STILL_COEFFICIENT, partition
from .signals import marker_signals, turn_signals
from .timewarp import normalise_batch

# A border of the format, not a taste: segment lengths are coded as numbers up to it.
MOST_SECONDS = 1.6

Method = Literal["threshold", "fisher"]


@dataclass(frozen=True)
class SegmentRules:
    """How clips are cut.

    ``method``: ``threshold`` is Algorithm 1 of Gu et al. 2009, ``fisher`` the optimal partition
    with as many segments as fit ``usual_seconds``. ``ratio`` and ``key_coefficient`` (in head
    diagonals) are the thresholds of Algorithm 1 and of its key frames; segments last from
    ``least_seconds`` to `MOST_SECONDS`.
    """

    method: Method = "threshold"
    ratio: float = 4.0
    key_coefficient: float = 2.0
    least_seconds: float = 0.25
    usual_seconds: float = 0.8

    def __post_init__(self) -> None:
        if self.method not in ("threshold", "fisher"):
            raise UsageError(
                f"unknown segmentation {self.method!r}", advice="Use threshold or fisher"
            )


@dataclass(frozen=True, eq=False)
class Segments:
    """The segments of one part: ``borders`` (segments + 1,) frames, ``points`` (segments, 16,
    channels) time-normalised signals in centimetres.
    """

    borders: IntArray
    points: FloatArray


def most_frames(frame_time: float) -> int:
    """Return how many frames a segment may have at the most, for a frame time in seconds."""
    return max(8, min(round(MOST_SECONDS / frame_time), 1024))


def clip_segments(clip: Clip, family: Family, rules: SegmentRules) -> list[Segments | None]:
    """Return the segments of every part of ``clip``; None for parts that have no patterns."""
    if isinstance(clip, MarkerClip):
        positions = filled(clip.positions)
        signals = [
            marker_signals(family, part, positions) if pattern_channels(part) else None
            for part in family.parts
        ]
    else:
        world = world_rotations(clip.skeleton, clip.rotations)
        signals = [
            turn_signals(family, part, world) if pattern_channels(part) else None
            for part in family.parts
        ]
    return [
        None if signal is None else cut(signal, family.head_diagonal, clip.frame_time, rules)
        for signal in signals
    ]


def cut(
    signal: FloatArray, head_diagonal: float, frame_time: float, rules: SegmentRules
) -> Segments:
    """Cut one part's signal (frames, channels), centimetres, into segments.

    Channels come in threes, one three a joint, whose displacement they measure. A joint's
    weight W is its share of the part's motion budget: all joints weigh the same, because the
    signals are scaled by the joints' levers already.
    """
    frames, channels = signal.shape
    most = most_frames(frame_time)
    least = max(2, min(round(rules.least_seconds / frame_time), most // 2))
    if rules.method == "fisher":
        wanted = max(1, round(frames * frame_time / rules.usual_seconds), -(-frames // most))
        borders = _no_longer_than(optimal_partition(signal, min(wanted, frames)), most)
    else:
        borders = partition(
            signal.reshape(frames, channels // 3, 3),
            np.ones(channels // 3),
            ratio=rules.ratio,
            key_threshold=rules.key_coefficient * head_diagonal,
            min_frames=least,
            max_frames=most,
            still=STILL_COEFFICIENT * head_diagonal,
        )
    return Segments(borders, normalise_batch(signal, borders, PATTERN_FRAMES))


def _no_longer_than(borders: IntArray, most: int) -> IntArray:
    """Add borders so that no segment is longer than ``most`` frames."""
    out = [0]
    for stop in borders[1:].tolist():
        start = out[-1]
        pieces = -(-(stop - start) // most)
        out += [start + (stop - start) * piece // pieces for piece in range(1, pieces + 1)]
    return np.array(out, np.int64)
