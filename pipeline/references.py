"""Which clips of a library are predicted from which: a graph of few levels.

The clips of a level refer to clips of lower levels only, so that a level is encoded in
parallel, and a clip decodes after a handful of others. Which clip refers to which is voted by
moments: each one names the clips that had moments like it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..codec.clip import IntArray
from ..codec.learned.sketch import Sketch

LEVEL_SHARES = (0.05, 0.2, 0.5)  # of the clips that are in this level or a lower one
NEIGHBOURS = 24  # moments that every moment votes for
MOST_MOMENTS = 160  # sketched moments that a clip's references have together at the most


def levels_of(count: int, seed: int) -> IntArray:
    """Return the level of each of ``count`` clips, drawn by lot.

    The first level is small, because its clips have nothing to refer to; the last one is half
    of them, because nothing refers to its clips.
    """
    place = np.random.default_rng(seed).permutation(count)
    borders = [max(1, round(share * count)) for share in LEVEL_SHARES]
    return np.searchsorted(borders, place, side="right").astype(np.int64)


class Candidate(NamedTuple):
    """A clip by its number among candidates, or its mirror image."""

    number: int
    mirrored: bool = False


class ReferenceFinder:
    """Finds clips with moments like those of another one, among the candidates added so far."""

    def __init__(self, most: int) -> None:
        self.most = most
        self._moments: list[Sketch] = []
        self._tree: cKDTree | None = None
        self._owner = np.zeros(0, np.int64)
        self._lengths: list[int] = []
        self._imaged: list[bool] = []

    def add(self, sketches: Sequence[Sketch], imaged: Sequence[bool] | None = None) -> None:
        """Add candidates; they are numbered in the order in which they come.

        ``imaged``: which of them have a mirror image; None if all have.
        """
        self._moments += sketches
        self._imaged += [True] * len(sketches) if imaged is None else imaged
        self._lengths += [len(sketch) for sketch in sketches]
        self._tree = None

    def find(self, sketch: Sketch, image: Sketch | None = None) -> list[Candidate]:
        """Return the candidates that serve a clip best, the best first.

        ``image``: of its mirror image. What that is like is like the clip in a mirror.
        """
        if self._tree is None and any(self._lengths):
            self._tree = cKDTree(np.concatenate(self._moments))
            self._owner = np.repeat(np.arange(len(self._lengths)), self._lengths)
        if self._tree is None or not len(sketch):
            return []
        count, neighbours = len(self._lengths), min(NEIGHBOURS, len(self._owner))
        voted, apart = [], []
        for asked in (sketch,) if image is None else (sketch, image):
            far, near = self._tree.query(asked, k=neighbours)
            apart.append(np.asarray(far).reshape(len(sketch), -1))
            voted.append(self._owner[np.asarray(near).reshape(len(sketch), -1)])
        owners = np.concatenate([owner + count * n for n, owner in enumerate(voted)], axis=1)
        if image is not None:
            order = np.argsort(np.concatenate(apart, axis=1), axis=1, kind="stable")
            owners = np.take_along_axis(owners, order[:, :neighbours], axis=1)
        votes = np.zeros(2 * count)
        for row in owners:
            _, first = np.unique(row, return_index=True)
            rank = np.argsort(np.argsort(first))
            votes[row[first]] += 1.0 / (2.0 + rank)
        votes[count:] *= self._imaged
        chosen: list[Candidate] = []
        moments = 0
        for candidate in np.argsort(-votes, kind="stable").tolist():
            if votes[candidate] <= 0.0 or len(chosen) == self.most:
                break
            number = candidate % count
            if chosen and moments + self._lengths[number] > MOST_MOMENTS:
                continue
            chosen.append(Candidate(number, candidate >= count))
            moments += self._lengths[number]
        return chosen
