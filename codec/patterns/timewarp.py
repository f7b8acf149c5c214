"""Segments brought to one length and back (Gu et al. 2009, Sections 3.2 and 3.5).

Decoders repeat these computations on other machines, so every value comes from elementwise
additions, subtractions, multiplications and divisions of doubles in a fixed order, with
weights from integers: the bits are the same on every platform. Signals are (frames, d) in any
unit; borders (segments + 1,) start at 0, end at the number of frames, and do not repeat.
"""

from __future__ import annotations

import numpy as np

from ..clip import FloatArray, IntArray


def normalise(segment: FloatArray, length: int) -> FloatArray:
    """Return a segment (n, d) of any length as one of (length, d) (see `normalise_batch`)."""
    return np.asarray(normalise_batch(segment, np.array([0, len(segment)]), length)[0])


def denormalise(pattern: FloatArray, frames: int) -> FloatArray:
    """Return a pattern (length, d) as a segment of (frames, d) (see `denormalise_batch`)."""
    return denormalise_batch(pattern[None], np.array([0, frames]))


def normalise_batch(signal: FloatArray, borders: IntArray, length: int) -> FloatArray:
    """Return the segments of a signal (frames, d) as (segments, length, d) (Section 3.2).

    Samples lie at evenly spaced times, the first and last on the segment's first and last
    frame. A shorter segment is interpolated linearly. A longer one is smoothed: an inner
    sample is the mean of the linear interpolant over the time that is nearer to it than to
    its neighbours. Constant and linear signals stay what they are. A single frame fills the
    whole segment; ``length`` 1 takes the mean of a longer segment.
    """
    starts, counts = borders[:-1], np.diff(borders)
    last = np.maximum(counts[:, None] - 1, 0)
    # sample times, in frames, are whole + part / over
    over = max(length - 1, 1)
    whole, part = np.divmod(np.arange(length) * last, over)
    base = starts[:, None]
    weight = (part / over)[..., None]
    out = _between(signal[base + whole], signal[base + np.minimum(whole + 1, last)], weight)

    # the window of an inner sample runs between two edges × (frames - 1) / unit
    edges = np.array([0, 1]) if length == 1 else np.arange(1, 2 * length - 2, 2)
    unit = 1 if length == 1 else 2 * over
    shrunk = np.flatnonzero(counts > length)
    inner = slice(0, 1) if length == 1 else slice(1, length - 1)
    if len(shrunk) and len(edges) > 1:
        out[shrunk, inner] = _window_means(signal, starts[shrunk], counts[shrunk], edges, unit)
    return out


def denormalise_batch(patterns: FloatArray, borders: IntArray) -> FloatArray:
    """Return patterns (segments, length, d) as a signal (frames, d) (Section 3.5).

    Each pattern is sampled, with linear interpolation, at evenly spaced times, of which the
    first and last are its first and last frame. A segment of a single frame takes the first.
    """
    counts = np.diff(borders)
    segment = np.repeat(np.arange(len(counts)), counts)
    frame = np.arange(len(segment)) - borders[segment]
    last = patterns.shape[1] - 1
    over = np.maximum(counts[segment] - 1, 1)
    whole, part = np.divmod(frame * last, over)
    after = np.minimum(whole + 1, last)
    return _between(patterns[segment, whole], patterns[segment, after], (part / over)[:, None])


def smooth_borders(signal: FloatArray, borders: IntArray, width: int) -> FloatArray:
    """Return a signal (frames, d) without the jumps at its inner borders (Section 3.5).

    The jump at a border is the step across it less the step that goes on smoothly there: the
    mean of the steps just before and just after. Half of it is added on the left and half
    taken away on the right, fading over ``width`` frames with the cubic 3t² - 2t³. Blends
    reach to the middle of a segment at most and leave the signal's first and last frame as
    they are; where one side has no frame to give, the other takes all of the jump. A jump
    between two single frames stays.
    """
    counts = np.diff(borders)
    inner = borders[1:-1]
    reach = np.minimum(counts // 2, width)
    if len(inner) == 0:
        return signal.copy()
    reach[0], reach[-1] = min(counts[0] - 1, width), min(counts[-1] - 1, width)
    left, right = reach[:-1, None], reach[1:, None]

    before = signal[inner - 1] - signal[np.maximum(inner - 2, borders[:-2])]
    after = signal[np.minimum(inner + 1, borders[2:] - 1)] - signal[inner]
    known = (counts[:-1] > 1).astype(np.int64) + (counts[1:] > 1)
    smooth = (before + after) / np.maximum(known, 1)[:, None]
    jump = signal[inner] - signal[inner - 1] - smooth
    share = np.where(right == 0, 1.0, 0.5) * (left > 0)  # of the jump, taken by the left side

    out = signal.copy()
    for away in range(int(reach.max(initial=0))):
        for side, part, step in ((left, share, -1 - away), (right, share - 1.0, away)):
            reached = np.flatnonzero(side[:, 0] > away)
            t = (side[reached] - away) / side[reached]
            fade = t * t * (3.0 - 2.0 * t)
            out[inner[reached] + step] += jump[reached] * (part[reached] * fade)
    return out


def _between(first: FloatArray, second: FloatArray, weight: FloatArray) -> FloatArray:
    return np.asarray(first + (second - first) * weight)


def _window_means(
    signal: FloatArray, starts: IntArray, counts: IntArray, edges: IntArray, unit: int
) -> FloatArray:
    """Return the means (segments, windows, d) of the linear interpolant between the edges."""
    bounds = edges * (counts[:, None] - 1)
    low, high = bounds[:, :-1], bounds[:, 1:]
    first = low // unit
    taps = (-(-high // unit) - first).max(axis=1) + 1  # frames whose hats meet the window
    out = np.zeros((len(starts), len(edges) - 1, signal.shape[1]))
    for tap in range(int(taps.max())):
        rows = np.flatnonzero(taps > tap)
        frame = first[rows] + tap
        centre = frame * unit
        weight = _hat_area((high[rows] - centre) / unit) - _hat_area((low[rows] - centre) / unit)
        weight = weight / ((high[rows] - low[rows]) / unit)
        seen = starts[rows, None] + np.minimum(frame, counts[rows, None] - 1)
        out[rows] += signal[seen] * weight[..., None]
    return out


def _hat_area(x: FloatArray) -> FloatArray:
    """Return the area under the hat 1 - |t|, -1 <= t <= 1, from its left end up to ``x``."""
    x = np.minimum(np.maximum(x, -1.0), 1.0)
    rising, falling = 1.0 + x, 1.0 - x
    return np.where(x <= 0.0, 0.5 * rising * rising, 1.0 - 0.5 * falling * falling)
