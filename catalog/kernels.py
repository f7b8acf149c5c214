"""The loops of search, compiled: scores from postings, and time warping over words.

Words are compared by a table (columns, 256, 256) of distances, with 1 for what a body lacks;
``weights`` (columns,) say how much each column counts, and sum to 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..codec.arithmetic.compiled import compiled
from ..codec.clip import FloatArray, IntArray

Array = npt.NDArray[Any]

FAR = 1e30


@compiled
def add_scores(
    starts: IntArray,
    passages: Array,
    weights: Array,
    terms: IntArray,
    factors: Array,
    out: Array,
) -> None:
    """Add to each passage's score (passages,) its weight of each term, times the factor."""
    count = len(out)
    for number in range(len(terms)):
        factor = factors[number]
        for place in range(starts[terms[number]], starts[terms[number] + 1]):
            passage = passages[place]
            if passage < count:  # a damaged file must not write elsewhere
                out[passage] += factor * weights[place]


@compiled
def warped(query: Array, clip: Array, table: Array, weights: Array) -> float:
    """Return the mean distance of two motions, each (samples, columns), warped onto each other.

    Dynamic time warping from end to end with symmetric steps, a diagonal one counting twice
    (Sakoe and Chiba 1978, P = 0).
    """
    long = len(clip)
    before, now = np.full(long + 1, FAR), np.empty(long + 1)
    before[0] = 0.0
    for i in range(len(query)):
        now[0] = FAR
        for j in range(long):
            cost = 0.0
            for part in range(len(weights)):
                cost += weights[part] * table[part, query[i, part], clip[j, part]]
            now[j + 1] = min(before[j] + 2.0 * cost, before[j + 1] + cost, now[j] + cost)
        before, now = now, before
    return float(before[long] / (len(query) + long))


@compiled
def warped_path(query: Array, clip: Array, table: Array, weights: Array) -> FloatArray:
    """Return (columns,) the mean distance of each column along the path that `warped` takes."""
    wide, long, parts = len(query), len(clip), len(weights)
    total = np.full((wide + 1, long + 1), FAR)
    step = np.zeros((wide + 1, long + 1), np.int8)
    total[0, 0] = 0.0
    for i in range(wide):
        for j in range(long):
            cost = 0.0
            for part in range(parts):
                cost += weights[part] * table[part, query[i, part], clip[j, part]]
            best, kind = total[i, j] + 2.0 * cost, 0
            if total[i, j + 1] + cost < best:
                best, kind = total[i, j + 1] + cost, 1
            if total[i + 1, j] + cost < best:
                best, kind = total[i + 1, j] + cost, 2
            total[i + 1, j + 1], step[i + 1, j + 1] = best, kind
    sums, count = np.zeros(parts), 0
    i, j = wide, long
    while i > 0 and j > 0:
        for part in range(parts):
            sums[part] += table[part, query[i - 1, part], clip[j - 1, part]]
        count += 1
        kind = step[i, j]
        if kind != 2:
            i -= 1
        if kind != 1:
            j -= 1
    return sums / max(count, 1)


@compiled
def inside(cost: Array) -> tuple[float, int, int]:
    """Return (mean distance, start, stop) of the cheapest way through ``cost`` (query, clip).

    The query is used up, the clip's ends are open; at half to twice the speed (Sakoe and Chiba
    1978, P = 1).
    """
    wide, long = cost.shape
    total = np.full((wide, long), FAR)
    begun = np.zeros((wide, long), np.int64)
    for j in range(long):
        total[0, j], begun[0, j] = cost[0, j], j
    for i in range(1, wide):
        for j in range(1, long):
            best, from_where = total[i - 1, j - 1], begun[i - 1, j - 1]
            if j > 1 and total[i - 1, j - 2] < best:
                best, from_where = total[i - 1, j - 2], begun[i - 1, j - 2]
            if i > 1 and total[i - 2, j - 1] + cost[i - 1, j] < best:
                best, from_where = total[i - 2, j - 1] + cost[i - 1, j], begun[i - 2, j - 1]
            total[i, j], begun[i, j] = best + cost[i, j], from_where
    end, best = 0, np.inf
    for j in range(long):
        if total[wide - 1, j] < best:
            end, best = j, total[wide - 1, j]
    if best >= FAR or long == 0:
        return np.inf, 0, long
    return best / wide, begun[wide - 1, end], end + 1


@compiled
def warped_inside(
    query: Array, clip: Array, table: Array, weights: Array
) -> tuple[float, int, int]:
    """Return the distance and the span (first, last sample, exclusive) of a motion in a clip.

    Dynamic time warping with open ends in the clip, at half to twice the speed (Sakoe and
    Chiba 1978, P = 1). The distance is the mean over the query's samples; where the clip is
    shorter than half of the query, nothing fits, and it is infinite.
    """
    wide, long = len(query), len(clip)
    cost = np.empty((wide, long))
    for i in range(wide):
        for j in range(long):
            here = 0.0
            for part in range(len(weights)):
                here += weights[part] * table[part, query[i, part], clip[j, part]]
            cost[i, j] = here
    return inside(cost)


@compiled
def slid_inside(query: Array, clip: Array, table: Array, weights: Array) -> tuple[float, int, int]:
    """Return the distance and span of a motion in a clip at equal speed; see `warped_inside`.

    Where the clip is shorter than the query, what is left over counts as a distance of 1.
    """
    wide, long = len(query), len(clip)
    best, first = np.inf, 0
    for shift in range(max(long - wide, 0) + 1):
        cost = 0.0
        for i in range(wide):
            if shift + i >= long:
                cost += 1.0
                continue
            for part in range(len(weights)):
                cost += weights[part] * table[part, query[i, part], clip[shift + i, part]]
        if cost < best:
            best, first = cost, shift
    return best / max(wide, 1), first, min(first + wide, long)
