"""Learning a motion model from sample clips: prediction, basis, expected sizes, first poses.

The sample is walked by the encoder itself, so that the model learns from decoded pasts with
their rounding errors. Everything learned is rounded to integers; the codec never sees a float.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace

from ..blocks.motionmodel import MotionModel
from ..blocks.nodes import FOLLOWER, JOINT, KIND, PLACE
from ..clip import IntArray
from .predictorfit import Products, fit_predictors, products_of
from .rehearsal import Rehearsal
from .samples import Manner, Sample
from .sizefit import fit_all_sizes
from .startfit import fit_starts

ROUNDS = 3


def learn(
    first: Products,
    start: MotionModel,
    manner: Manner,
    usual: IntArray,
    keep_weights: bool = False,
    without: Collection[str] = (),
) -> tuple[MotionModel, Rehearsal]:
    """Return a model learned from sample clips, and those as the last walks left them.

    ``first``: the products of ``start``, the model to begin with; ``usual``: (rows, 4) the
    family's usual pose; ``keep_weights``: the prediction stays as it is, for a library too
    small to pay for one of its own; ``without``: what is not learned, to measure its worth:
    ``basis`` (the one of ``start`` stays), ``parents`` (nothing is predicted from the guide's
    or the carrier's motion), ``contexts`` (expected sizes do not depend on what is decoded).
    """
    model, products = start, first
    for number in range(ROUNDS):
        if number > 0:
            products = products_of(products.rehearsal, model, manner)
        model = fit_predictors(products, model, manner, keep_weights, without)
    rehearsal = products.rehearsal
    model = fit_all_sizes(rehearsal, model, manner, "contexts" not in without)
    model = fit_starts(rehearsal.samples, model, usual, rehearsal.poses(model.rows))
    still, sliding = _usual_joints(rehearsal.samples)
    return replace(model, still=still, sliding=sliding), rehearsal


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
