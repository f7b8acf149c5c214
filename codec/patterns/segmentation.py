"""Cutting the motion of one body part into segments (Gu et al. 2009, Section 3.2, Algorithm 1)."""

from __future__ import annotations

import numpy as np

from ..clip import FloatArray, IntArray
from ..errors import UsageError

# Section 5: the paper's default for the key-frame threshold, in head diagonals (ADDH).
KEY_COEFFICIENT = 0.1
# Frame differences below this many head diagonals count as rest: about 0.4 mm, a little above
# the static noise of optical capture (0.15 mm per frame, so 0.2 mm between two frames).
STILL_COEFFICIENT = 0.002


def partition(
    points: FloatArray,
    weights: FloatArray,
    *,
    ratio: float,
    key_threshold: float,
    min_frames: int,
    max_frames: int,
    still: float = 0.04,
) -> IntArray:
    """Return the borders (segments + 1,) of a part's segments, 0 first and the frames last.

    ``points``: (frames, points, 3) centimetres, relative to the parent part's reference; NaN
    where a point was not seen. ``weights``: (points,), how much each point counts.
    A segment ends before frame i when one of these holds:

    - Algorithm 1, line 4: the step |F_i - F_{i-1}| exceeds ``ratio`` times the average step of
      the segment so far;
    - Section 5: the distance of F_i from the segment's first frame, its key frame, exceeds
      ``key_threshold`` centimetres (`KEY_COEFFICIENT` head diagonals).

    Readings taken where the paper is silent: |.| is the Euclidean length per point, and the
    weights are brought to sum 1, so that all thresholds are centimetres of a point. A segment
    of one frame has no average step, so only the key frame can end it. The average counts as
    ``still`` centimetres at least (`STILL_COEFFICIENT` head diagonals), so that noise does not
    cut a pose at rest. A step from or to an unseen point counts as none.

    Segments have ``max_frames`` at most, cut by force, and ``min_frames`` at least: before that
    nothing cuts. A shorter remainder at the clip's end joins the last segment, or takes frames
    from it where the two are too long together. Only a clip shorter than ``min_frames``, or a
    ``max_frames`` under 2 ``min_frames`` - 1, can leave a shorter last segment.

    Raises `UsageError` for weights or bounds that make no sense.
    """
    frames = len(points)
    weights = np.asarray(weights, dtype=np.float64)
    if not 1 <= min_frames <= max_frames:
        raise UsageError(f"segments of {min_frames} to {max_frames} frames cannot be made")
    if weights.shape != points.shape[1:2] or not (weights >= 0).all() or not weights.sum() > 0:
        raise UsageError("segmentation needs one weight per point, none negative, not all 0")
    weights = weights / weights.sum()

    steps = np.zeros(frames)
    steps[1:] = _distance(points[1:], points[:-1], weights)
    travelled = np.cumsum(steps)

    def next_border(start: int) -> int:
        stop = min(start + max_frames, frames)
        first = start + min_frames
        window = 32  # grows, so that a long segment costs no more than its length
        while first < stop:
            last = min(first + window, stop)
            cuts = _distance(points[first:last], points[start], weights) > key_threshold
            counts = np.maximum(np.arange(first, last) - start - 1, 1)
            average = (travelled[first - 1 : last - 1] - travelled[start]) / counts
            sharp = steps[first:last] > ratio * np.maximum(average, still)
            sharp[0] &= first > start + 1
            cuts |= sharp
            hit = int(cuts.argmax())
            if cuts[hit]:
                return first + hit
            first = last
            window *= 2
        return stop

    borders = [0]
    while borders[-1] < frames:
        borders.append(next_border(borders[-1]))
    if len(borders) > 2 and borders[-1] - borders[-2] < min_frames:
        if borders[-1] - borders[-3] <= max_frames:
            del borders[-2]
        else:
            borders[-2] = max(borders[-1] - min_frames, borders[-3] + min_frames)
    return np.array(borders, dtype=np.int64)


def _distance(first: FloatArray, second: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the weighted mean distance (frames,) of points, an unseen point counting 0."""
    away = first - second
    lengths = np.sqrt(np.einsum("fpi,fpi->fp", away, away))
    return np.asarray(np.where(np.isnan(lengths), 0.0, lengths) @ weights)
