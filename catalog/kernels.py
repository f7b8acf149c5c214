"""Loops that are worth compiling: scores of many queries from postings, and time warping.

Importing the compiler takes longer than a search, so one search does without them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..codec.arithmetic.compiled import compiled
from ..codec.clip import IntArray

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
