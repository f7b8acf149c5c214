"""Dynamic time warping over joint positions: the slow yardstick of `evaluate`, and phases."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..codec.arithmetic.compiled import compiled
from ..codec.clip import FloatArray, IntArray
from .kernels import inside

Frames = npt.NDArray[np.float32]
FAR = 1e30


def frame_distances(some: Frames, others: Frames) -> Frames:
    """Return the distances (some, others) of poses (frames, coordinates), centimetres."""
    square = np.square(some).sum(axis=1)[:, None] + np.square(others).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(square - 2.0 * (some @ others.T), 0.0)), np.float32)


def warped_frames(query: Frames, clip: Frames) -> float:
    """Return the mean distance of two motions (frames, coordinates) warped onto each other."""
    return float(_warp(frame_distances(query, clip))[0])


def warping_path(query: Frames, clip: Frames) -> IntArray:
    """Return (steps, 2) which frames of two motions lie on each other."""
    return np.asarray(_path(frame_distances(query, clip)), np.int64)


def warped_span(query: Frames, clip: Frames) -> tuple[float, int, int]:
    """Return distance, first and last frame (exclusive) of a motion inside a clip.

    Open ends in the clip, half to twice the speed; infinite where the clip is too short.
    """
    distance, first, last = inside(frame_distances(query, clip))
    return float(distance), int(first), int(last)


@compiled
def _warp(cost: Any) -> tuple[float, int]:
    wide, long = cost.shape
    before, now = np.full(long + 1, FAR), np.empty(long + 1)
    before[0] = 0.0
    for i in range(wide):
        now[0] = FAR
        for j in range(long):
            here = cost[i, j]
            now[j + 1] = min(before[j] + 2.0 * here, before[j + 1] + here, now[j] + here)
        before, now = now, before
    return before[long] / (wide + long), wide


@compiled
def _path(cost: Any) -> FloatArray:
    wide, long = cost.shape
    total = np.full((wide + 1, long + 1), FAR)
    total[0, 0] = 0.0
    for i in range(wide):
        for j in range(long):
            here = cost[i, j]
            total[i + 1, j + 1] = min(
                total[i, j] + 2.0 * here, total[i, j + 1] + here, total[i + 1, j] + here
            )
    out = np.empty((wide + long, 2), np.int64)
    count, i, j = 0, wide, long
    while i > 0 and j > 0:
        out[count, 0], out[count, 1] = i - 1, j - 1
        count += 1
        here = cost[i - 1, j - 1]
        if total[i, j] == total[i - 1, j - 1] + 2.0 * here:
            i, j = i - 1, j - 1
        elif total[i, j] == total[i - 1, j] + here:
            i -= 1
        else:
            j -= 1
    return out[:count][::-1]
