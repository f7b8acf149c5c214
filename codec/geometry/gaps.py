"""Gaps of marker data: the mask that survives the round trip, and what fills the holes."""

from __future__ import annotations

import numpy as np

from ..clip import BoolArray, FloatArray, IntArray


def filled(positions: FloatArray) -> FloatArray:
    """Return positions (frames, markers, 3) without NaN.

    A gap is bridged in a straight line, held at the clip's ends, and a marker that is never
    seen stays at the origin: the cheapest courses to code; the mask takes them out again.
    """
    out = positions.copy()
    seen = np.asarray(~np.isnan(positions).any(axis=2))
    frames = np.arange(len(positions))
    for marker in np.flatnonzero(~seen.all(axis=0)):
        known = seen[:, marker]
        for axis in range(3):
            out[~known, marker, axis] = (
                np.interp(frames[~known], frames[known], positions[known, marker, axis])
                if known.any()
                else 0.0
            )
    return out


def to_runs(seen: BoolArray) -> list[IntArray]:
    """Return, per marker, the frames (ascending) at which seen turns to unseen or back.

    A marker counts as seen before the first frame.
    """
    flips = np.diff(seen.astype(np.int8), axis=0, prepend=np.ones((1, seen.shape[1]), np.int8))
    return [np.flatnonzero(flips[:, marker]) for marker in range(seen.shape[1])]


def from_runs(runs: list[IntArray], frames: int) -> BoolArray:
    """Return the mask (frames, markers) of `to_runs`' frames."""
    flips = np.zeros((frames, len(runs)), np.int64)
    for marker, turns in enumerate(runs):
        flips[turns, marker] = 1
    return np.asarray(np.cumsum(flips, axis=0) % 2 == 0)
