"""Sample clips that are predicted from one another, as clips of an archive are.

A model is learned from walks in which blocks see what they will see in archives: decoded pasts,
and what is recalled from other clips. A sample refers to others as the last walk left them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..blocks.blockwalk import Walk
from ..blocks.motionmodel import MotionModel
from ..blocks.recall import joined, remember
from ..blocks.startpose import poses_of
from ..clip import IntArray
from .abreast import abreast
from .samples import Manner, Sample, walked

ALONE = 12  # one sample in so many has no references: some clips have none

Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class Rehearsal:
    """Samples, and what they may be predicted from.

    ``neighbours``: per sample, the numbers of the others that it may refer to; ``states``: per
    sample, (frames, nodes, 4) as the last walk left it, or None before the first walk, in which
    no sample refers to another one.
    """

    samples: Sequence[Sample]
    neighbours: Sequence[Sequence[int]]
    states: Sequence[IntArray] | None = None

    def others(self, at: int) -> list[tuple[Sample, IntArray]]:
        """Return the samples that a sample refers to, with their decoded frames."""
        states = self.states or ()  # of none, `_references` are none
        return [(self.samples[other], states[other]) for other in self._references(at)]

    def poses(self, rows: int) -> Iterator[IntArray]:
        """Yield per sample the known poses, (poses, rows, 4), that it may start from."""
        for at in range(len(self.samples)):
            known = [
                poses_of(state, len(state), sample.nodes, rows) for sample, state in self.others(at)
            ]
            yield np.concatenate([np.zeros((0, rows, 4), np.int64), *known])

    def walk(
        self, model: MotionModel, manner: Manner, then: Callable[[int, Walk], Result]
    ) -> Iterator[Result]:
        """Walk through all samples; yield, in their order, what ``then`` makes of each.

        ``then`` is given the number of the sample and its walk.
        """
        span, lags, up, weights = model.span, model.lags, model.up, model.weights
        memories = [
            remember(state, len(state), sample.nodes.table, span, lags, up, weights)
            for sample, state in zip(self.samples, self.states or (), strict=False)
        ]

        def done(at: int) -> Result:
            known = [memories[other] for other in self._references(at)]
            memory = joined(known, model.rows, model.channels)
            return then(at, walked(self.samples[at], model, memory, manner))

        return abreast(done, range(len(self.samples)))

    def _references(self, at: int) -> Sequence[int]:
        return () if self.states is None or at % ALONE == 0 else self.neighbours[at]
