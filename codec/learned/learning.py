"""Learning a motion model from sample clips: prediction, basis, expected sizes, first poses.

The sample is walked by the encoder itself, so that the model learns from decoded pasts with
their rounding errors. Everything learned is rounded to integers; the codec never sees a float.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ..blocks.motionmodel import MotionModel
from ..blocks.nodes import FOLLOWER, JOINT, KIND, PLACE
from ..blocks.offered import Reference, reference_of
from ..blocks.recall import empty_memory, joined
from ..clip import IntArray
from .abreast import abreast
from .predictorfit import Products, fit_predictors, products_of
from .samples import Manner, Sample, walked
from .sizefit import fit_all_sizes
from .startfit import fit_starts

ROUNDS = 2
ALONE = 12  # one sample in so many is walked without references: some clips have none


def learn(
    samples: Sequence[Sample],
    start: MotionModel,
    manner: Manner,
    usual: IntArray,
    neighbours: Sequence[Sequence[int]],
    keep_weights: bool = False,
    without: Collection[str] = (),
    first: Products | None = None,
) -> MotionModel:
    """Return a model learned from sample clips, beginning with ``start``.

    ``usual``: (rows, 4) the family's usual pose; ``neighbours``: per sample, the numbers of
    the other samples that it may refer to; ``keep_weights``: the prediction stays as it is,
    for a library too small to pay for one of its own; ``without``: what is not learned, to
    measure its worth: ``basis`` (the one of ``start`` stays), ``parents`` (nothing is predicted
    from the guide's or the carrier's motion), ``contexts`` (expected sizes do not depend on
    what is decoded); ``first``: the products of ``start``, where they are known.
    """
    model = start
    products = first or products_of(samples, model, manner)
    for number in range(ROUNDS):
        if number > 0:
            products = products_of(samples, model, manner)
        model = fit_predictors(products, model, manner, keep_weights, without)
    nothing = empty_memory(model.rows, model.channels)

    def reference(sample: Sample) -> Reference:
        state = walked(sample, model, nothing, manner).state[: len(sample.goal)]
        return reference_of([state], sample.nodes, model)

    references = list(abreast(reference, samples))
    memories = (  # one at a time: together they take much memory
        joined([references[other].memory for other in others], model.rows, model.channels)
        if at % ALONE
        else nothing
        for at, others in enumerate(neighbours)
    )
    model = fit_all_sizes(samples, model, manner, memories, "contexts" not in without)
    empty = np.zeros((0, model.rows, 4), np.int64)
    poses = [
        np.concatenate([empty, *(references[other].poses for other in others)])
        for others in neighbours
    ]
    still, sliding = _usual_joints(samples)
    return replace(fit_starts(samples, model, usual, poses), still=still, sliding=sliding)


def _usual_joints(samples: Sequence[Sample]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the joints that follow their parents, and those that slide, in most samples."""
    counts: Counter[tuple[int, int]] = Counter()
    for sample in samples:
        table = sample.nodes.table
        counts.update(
            (int(row[KIND]), int(row[JOINT])) for row in table if row[KIND] in (FOLLOWER, PLACE)
        )
    most = [key for key, count in counts.items() if 2 * count > len(samples)]
    return (
        tuple(sorted(joint for kind, joint in most if kind == FOLLOWER)),
        tuple(sorted(joint for kind, joint in most if kind == PLACE)),
    )
