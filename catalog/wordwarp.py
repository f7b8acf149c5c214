"""Time warping over words: one query against many clips at once, with nothing to compile.

Words are compared by a table (columns, 256, 256) of distances, with 1 for what a body lacks;
``weights`` (columns,) say how much each column counts, and sum to 1. A loop runs over the query
or over diagonals, and each of its steps is an array operation over all clips: a search is one
query, and importing a compiler takes longer than it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..codec.clip import BoolArray, FloatArray, IntArray
from .vocabulary import COLUMNS, Words

Costs = npt.NDArray[np.float32]
Spans = tuple[FloatArray, IntArray, IntArray]
"""Per clip: mean distance, first and last sample (exclusive)."""

FAR = np.float32(1e30)
BESIDE = 20  # samples before and after a span that are looked at, too: two seconds
BESIDE_STEP = 2  # of which every second one is
BESIDE_WEIGHT = np.float32(0.1)  # of each, beside a sample of the span
_MOST_CELLS = 4_000_000  # of a grid of query and clips that is filled at a time


class Surroundings(NamedTuple):
    """The words (samples, columns) before and after a span, each `BESIDE_STEP` from the next.

    The last before it is a step from its first sample, the first after it a step from its last.
    A motion that repeats itself looks the same each time; what it comes from and leads to tells
    the first time from the second.
    """

    before: Words
    after: Words


NOTHING_BESIDE = Surroundings(*np.zeros((2, 0, len(COLUMNS)), np.uint8))


def surroundings(words: Words, first: int, last: int) -> Surroundings:
    """Return what is beside the samples ``first`` to ``last`` (exclusive) of a clip's words."""
    before = words[max(first - BESIDE, 0) : first][::-1][BESIDE_STEP - 1 :: BESIDE_STEP][::-1]
    return Surroundings(before, words[last : last + BESIDE][BESIDE_STEP - 1 :: BESIDE_STEP])


def warped(query: Words, clips: Sequence[Words], table: Costs, weights: FloatArray) -> FloatArray:
    """Return (clips,) the mean distance of a motion and each clip, warped onto each other.

    Motions: (samples, columns), none empty. Dynamic time warping from end to end with symmetric
    steps, a diagonal one counting twice (Sakoe and Chiba 1978, P = 0).
    """
    out = np.empty(len(clips))
    for some, lengths in _chunks(len(query), clips):
        cost = _costs(query, [clips[each] for each in some], table, weights, FAR, len(query))
        totals = _diagonals(cost, int(lengths.max()))[0]
        at = len(query) + lengths - 2
        out[some] = totals[at, np.arange(len(some))] / (len(query) + lengths)
    return out


def warped_path(
    query: Words, clips: Sequence[Words], table: Costs, weights: FloatArray
) -> FloatArray:
    """Return (clips, columns) the mean distance of each column along the path of `warped`."""
    out = np.empty((len(clips), len(weights)))
    columns = np.arange(len(weights))
    for some, lengths in _chunks(len(query), clips):
        cost = _costs(query, [clips[each] for each in some], table, weights, FAR, len(query))
        steps = _diagonals(cost, int(lengths.max()), keep_steps=True)[1]
        for place, number in enumerate(some.tolist()):
            path = _walked_back(steps[:, :, place], len(query), int(lengths[place]))
            said, others = query[path[:, 0]], clips[number][path[:, 1]]
            out[number] = table[columns, said, others].mean(axis=0)
    return out


def warped_inside(
    query: Words,
    clips: Sequence[Words],
    table: Costs,
    weights: FloatArray,
    beside: Surroundings = NOTHING_BESIDE,
) -> Spans:
    """Return where in each clip a motion is, at half to twice the speed (`Spans`).

    Dynamic time warping with open ends in the clip (Sakoe and Chiba 1978, P = 1). The distance
    is the mean over the query's samples, and what `_apart` adds; where the clip is shorter than
    half of the query, nothing fits, and it is infinite.
    """
    out = np.full(len(clips), np.inf), np.zeros(len(clips), np.int64), _lengths(clips)
    for some, _ in _chunks(len(query), clips):
        these = [clips[each] for each in some]
        cost = _costs(np.concatenate([query, *beside]), these, table, weights, FAR)
        cost, before, after = _apart(cost, beside, these)
        total, begun = cost[0], np.broadcast_to(np.arange(cost.shape[2]), cost.shape[1:])
        older = np.full_like(total, FAR), begun  # two samples of the query ago
        for i in range(1, len(query)):
            best, source = np.full_like(total, FAR), np.zeros(total.shape, np.int64)
            best[:, 1:], source[:, 1:] = total[:, :-1], begun[:, :-1]
            _take_nearer(best[:, 2:], source[:, 2:], total[:, :-2], begun[:, :-2])
            slow = older[0][:, :-1] + cost[i - 1][:, 1:]
            _take_nearer(best[:, 1:], source[:, 1:], slow, older[1][:, :-1])
            older, total, begun = (total, begun), best + cost[i], source
        total = total + after + np.take_along_axis(before, begun, axis=1)
        ends = total.argmin(axis=1)
        rows = np.arange(len(some))
        fits = total[rows, ends] < FAR
        out[0][some[fits]] = total[rows, ends][fits] / len(query)
        out[1][some[fits]], out[2][some[fits]] = begun[rows, ends][fits], ends[fits] + 1
    return out


def slid_inside(
    query: Words,
    clips: Sequence[Words],
    table: Costs,
    weights: FloatArray,
    beside: Surroundings = NOTHING_BESIDE,
) -> Spans:
    """Return where in each clip a motion is, at equal speed (`Spans`).

    Where a clip is shorter than the query, what is left over counts as a distance of 1. To the
    mean comes what `_apart` adds.
    """
    wide = len(query)
    out = np.empty(len(clips)), np.empty(len(clips), np.int64), _lengths(clips)
    for some, lengths in _chunks(wide, clips):
        shifts = np.maximum(lengths - wide, 0)
        these = [clips[each] for each in some]
        everything = np.concatenate([query, *beside])
        cost = _costs(everything, these, table, weights, np.float32(1.0), wide)
        cost, before, after = _apart(cost, beside, these)
        last = np.minimum(np.arange(int(shifts.max()) + 1) + wide, after.shape[1]) - 1
        total = before[:, : len(last)] + after[:, last]
        for i in range(wide):
            total += cost[i][:, i : i + total.shape[1]]
        total[np.arange(total.shape[1]) > shifts[:, None]] = np.inf
        first = total.argmin(axis=1)
        out[0][some] = total[np.arange(len(some)), first] / max(wide, 1)
        out[1][some], out[2][some] = first, np.minimum(first + wide, lengths)
    return out


def _lengths(clips: Sequence[Words]) -> IntArray:
    return np.array([len(clip) for clip in clips], np.int64)


def _chunks(wide: int, clips: Sequence[Words]) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the numbers of clips that are compared together, about equally long, and lengths."""
    lengths = _lengths(clips)
    order = np.argsort(lengths, kind="stable")
    first = 0
    while first < len(order):
        last = first + 1
        while (
            last < len(order)
            and (last + 1 - first) * wide * (lengths[order[last]] + wide) <= _MOST_CELLS
        ):
            last += 1
        yield order[first:last], lengths[order[first:last]]
        first = last


def _costs(
    query: Words,
    clips: Sequence[Words],
    table: Costs,
    weights: FloatArray,
    beyond: np.float32,
    room: int = 0,
) -> Costs:
    """Return (query, clips, longest + room) distances of samples, ``beyond`` after a clip's end."""
    said, lengths = np.concatenate(clips), _lengths(clips)
    gaps = np.zeros((len(said), len(query)), np.float32)
    some = np.empty_like(gaps)
    for column in np.flatnonzero(weights):
        near = np.float32(weights[column]) * table[column][:, query[:, column]]
        np.take(near, said[:, column], axis=0, out=some, mode="clip")  # words are bytes
        gaps += some
    out = np.full((len(query), len(clips), int(lengths.max(initial=0)) + room), beyond, np.float32)
    owner = np.repeat(np.arange(len(clips)), lengths)
    out[:, owner, np.arange(len(said)) - np.repeat(np.cumsum(lengths) - lengths, lengths)] = gaps.T
    return out


def _apart(cost: Costs, beside: Surroundings, clips: Sequence[Words]) -> tuple[Costs, Costs, Costs]:
    """Return the costs of the query, and what surroundings add where a span begins and ends.

    ``cost``: (query + before + after, clips, longest or more). What is added: (clips, longest).
    Surroundings are compared at equal speed; beyond its ends a clip stands still.
    """
    lengths = _lengths(clips)
    samples = np.arange(int(lengths.max(initial=0)))
    first, last = len(cost) - len(beside.before) - len(beside.after), len(cost) - len(beside.after)
    found = []
    for some, step in ((cost[first:last], -len(beside.before)), (cost[last:], 1)):
        added = np.zeros((len(clips), len(samples)), np.float32)
        for number, here in enumerate(some, step):
            near = np.clip(samples + number * BESIDE_STEP, 0, lengths[:, None] - 1)
            added += BESIDE_WEIGHT * np.take_along_axis(here, near, axis=1)
        found.append(added)
    return cost[:first], found[0], found[1]


def _diagonals(
    cost: Costs, longest: int, *, keep_steps: bool = False
) -> tuple[Costs, npt.NDArray[np.int8]]:
    """Return the totals at the query's last sample, and the steps to every cell, by diagonals.

    ``cost``: (query, clips, longest + query), far beyond the clips' ends. Totals: (diagonals,
    clips); steps: (diagonals, query, clips), 0 from both, 1 from the query's sample before, 2
    from the clip's; none unless ``keep_steps``. A cell's diagonal is the sum of its samples.
    """
    wide, clips, _ = cost.shape
    row, clip, sample = cost.strides
    count = wide + longest - 1
    skewed = np.lib.stride_tricks.as_strided(  # what it reads beside a row lies beyond an end
        cost, (count, wide, clips), (sample, row - sample, clip), writeable=False
    )
    totals = np.empty((count, clips), np.float32)
    steps = np.zeros((count if keep_steps else 0, wide, clips), np.int8)
    before = np.full((wide + 1, clips), FAR, np.float32)
    now = before.copy()
    before[0] = 0.0
    for number in range(count):
        here = skewed[number].copy()
        here[number + 1 :] = FAR
        best = before[:-1] + 2.0 * here
        above, left = now[:-1] + here, now[1:] + here
        if keep_steps:
            step = steps[number]
            step[above < best] = 1
            step[left < np.minimum(best, above)] = 2
        before, now = now, np.full((wide + 1, clips), FAR, np.float32)
        np.minimum(np.minimum(best, above), left, out=now[1:])
        totals[number] = now[-1]
    return totals, steps


def _walked_back(steps: npt.NDArray[np.int8], wide: int, long: int) -> IntArray:
    """Return (steps, 2) the samples of query and clip on the best path, last first."""
    path = []
    i, j = wide - 1, long - 1
    while i >= 0 and j >= 0:
        path.append((i, j))
        step = steps[i + j, i]
        i, j = i - (step != 2), j - (step != 1)
    return np.array(path, np.int64)


def _take_nearer(best: Costs, source: IntArray, other: Costs, others: IntArray) -> None:
    """Put the totals that are nearer in the place of the best ones, and where they began."""
    nearer: BoolArray = other < best
    np.copyto(best, other, where=nearer)
    np.copyto(source, others, where=nearer)
