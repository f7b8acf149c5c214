"""Integer prediction: a channel's integers become small differences, and back, without loss.

Within a *run* (a stretch of frames of one channel that shares a base, see `signals`), frame
t is predicted from the decoded past,

    order 1:  q[t-1] + (p[t] - p[t-1])
    order 2:  2 q[t-1] - q[t-2] + (p[t] - 2 p[t-1] + p[t-2])

where p is the pattern's own course on the same grid inside a segment that uses its pattern,
and zero elsewhere. The first frame of a run is predicted by p alone, the second by order 1.
All of it is integer arithmetic on whole arrays: differences one way, running sums the other.
"""

from __future__ import annotations

import numpy as np

from ..clip import BoolArray, IntArray


def differences(values: IntArray, innovations: IntArray, starts: BoolArray, order: int) -> IntArray:
    """Return what prediction leaves of ``values``, (frames, channels).

    ``innovations``: what the patterns say the differences will be, from `innovations_of`;
    ``starts``: (frames, channels) True where a run starts (all of frame 0). Order 1 or 2.
    """
    left = values
    for degree in range(order):
        steps = np.diff(left, axis=0, prepend=np.zeros((1, values.shape[1]), np.int64))
        left = np.where(_frozen(starts, degree), left, steps)
    return left - innovations


def restore(left: IntArray, innovations: IntArray, starts: BoolArray, order: int) -> IntArray:
    """Return the values whose `differences` are ``left``: the inverse, same shapes."""
    values = left + innovations
    for degree in reversed(range(order)):
        values = _sum_from(values, _frozen(starts, degree))
    return values


def _frozen(starts: BoolArray, degree: int) -> BoolArray:
    """Return where a difference of this degree is not taken: a run's first ``degree + 1`` frames.

    The first difference keeps a run's first value; the second keeps that and the first step.
    """
    frozen = starts.copy()
    for back in range(1, degree + 1):
        frozen[back:] |= starts[:-back]
    return frozen


def _sum_from(values: IntArray, frozen: BoolArray) -> IntArray:
    """Return running sums down the frames that start anew wherever ``frozen``."""
    total = np.cumsum(values, axis=0)
    frame = np.arange(len(values))[:, None]
    origin = np.maximum.accumulate(np.where(frozen, frame, 0), axis=0)
    before = np.take_along_axis(total - values, origin, axis=0)
    return np.asarray(total - before)


def innovations_of(
    course: IntArray, used: BoolArray, borders: IntArray, starts: BoolArray, order: int
) -> IntArray:
    """Return the differences (frames, channels) that the patterns predict.

    ``course``: (frames, channels) the patterns laid along the clip on the quantiser grid;
    ``used``: (segments,) which segments use theirs; ``borders``: (segments + 1,). A segment's
    first frames, whose past lies in another segment, get none, except the first frame of the
    clip, which is predicted by the pattern itself.
    """
    if order not in (1, 2) or not used.any():
        return np.zeros_like(course)
    inside = np.repeat(used, np.diff(borders))[:, None]
    edge = np.zeros((len(course), 1), bool)
    edge[borders[:-1][borders[:-1] < len(course)]] = True
    blocked = _frozen(edge | starts, order - 1)
    steps = course
    for _ in range(order):
        steps = np.diff(steps, axis=0, prepend=np.zeros((1, course.shape[1]), np.int64))
    steps = np.where(inside & ~blocked, steps, 0)
    steps[0] = np.where(inside[0], course[0], 0)
    return np.asarray(steps)


def run_starts(changes: BoolArray) -> BoolArray:
    """Return ``starts`` for base changes (frames, channels): frame 0 starts a run as well."""
    starts = changes.copy()
    starts[:1] = True
    return starts
