"""Optimal cuts of a sequence of frames into constant pieces: Fisher's optimal partition.

Fisher 1958, as "Temporal clustering of motion capture data with optimal partitioning", Section
3, Equations 3 to 7, uses it. A segment costs the summed squared distances of its frames from
their mean (its diameter, Eq. 5); WSSSE is the sum of that over the segments (Eq. 3).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from ..clip import FloatArray, IntArray
from ..errors import UsageError


def optimal_partition(frames: FloatArray, segments: int) -> IntArray:
    """Return the borders (segments + 1,) of the segments that minimise WSSSE exactly (Eq. 7).

    ``frames``: (n, d). Every segment has one frame at least; of equally good partitions the
    one whose last segments start the earliest is taken. Time O(n² (d + segments)), memory
    O(n (d + segments)). Raises `UsageError` unless 1 <= ``segments`` <= n (0 for n = 0).
    """
    n = len(frames)
    _check(n, segments)
    # best[k, t]: the least WSSSE of the first t frames in k segments
    best = np.full((segments + 1, n + 1), np.inf)
    best[0, 0] = 0.0
    start = np.zeros((segments + 1, n + 1), dtype=np.int64)
    for end, diameters in enumerate(_diameters(frames), start=1):
        totals = best[:-1, :end] + diameters
        choice = totals.argmin(axis=1)
        start[1:, end] = choice
        best[1:, end] = totals[np.arange(segments), choice]
    borders = np.empty(segments + 1, dtype=np.int64)
    borders[segments] = n
    for segment in range(segments, 0, -1):
        borders[segment - 1] = start[segment, borders[segment]]
    return borders


def paa(frames: FloatArray, segments: int) -> IntArray:
    """Return the borders (segments + 1,) of segments of equal length, give or take one frame.

    The partition of piecewise aggregate approximation (Keogh et al. 2001), to compare with.
    Raises `UsageError` unless 1 <= ``segments`` <= n (0 for n = 0).
    """
    n = len(frames)
    _check(n, segments)
    return np.arange(segments + 1, dtype=np.int64) * n // max(segments, 1)


def wssse(frames: FloatArray, borders: IntArray) -> float:
    """Return the within-segment sum of squared errors (Eq. 3) of frames (n, d)."""
    total = 0.0
    for start, stop in pairwise(borders):
        segment = frames[start:stop]
        total += float(((segment - segment.mean(axis=0)) ** 2).sum())
    return total


def _diameters(frames: FloatArray) -> Iterator[FloatArray]:
    """Yield, for every end, the diameters (Eq. 5) of the segments from each start to that end.

    Welford's recurrence over all starts together: a new frame adds its squared distance from
    the old mean × m / (m + 1). Every term is positive, so nothing cancels, however far from
    the origin the frames lie.
    """
    n, d = frames.shape
    means = np.zeros((n, d))
    diameters = np.zeros(n)
    for end in range(n):
        lengths = np.arange(end, -1, -1.0)  # of the segments before this frame joins them
        away = frames[end] - means[: end + 1]
        diameters[: end + 1] += np.einsum("sd,sd->s", away, away) * (lengths / (lengths + 1))
        away /= (lengths + 1)[:, None]
        means[: end + 1] += away
        yield diameters[: end + 1]


def _check(n: int, segments: int) -> None:
    if not min(n, 1) <= segments <= n:
        raise UsageError(f"{n} frames cannot be cut into {segments} segments")
