"""Row by row the cheapest of several motion models: what is stored must save more than it costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..blocks.motionmodel import BASIS_BITS, MotionModel
from ..blocks.nodes import ROW
from ..clip import FloatArray, IntArray
from .modelfile import row_sizes
from .rehearsal import Rehearsal
from .samples import Manner

COARSER_WEIGHTS = 2  # low bits that the coarser one of two equal models leaves out
COARSE_BASIS = 8  # bits after the point


def row_costs(rehearsal: Rehearsal, model: MotionModel, manner: Manner) -> FloatArray:
    """Return about how many bytes the samples' blocks of each row (rows,) cost."""
    bits = np.zeros(model.rows)
    walks = rehearsal.walk(model, manner, lambda _, walk: walk.costs)
    for sample, costs in zip(rehearsal.samples, walks, strict=True):
        np.add.at(bits, sample.nodes.table[:, ROW], costs)
    return bits / 8.0


def coarsened(model: MotionModel) -> MotionModel:
    """Return the model with fewer bits in its weights and basis."""
    weights = _rounded(model.folded_weights, _lowest_bits(model.folded_weights) + COARSER_WEIGHTS)
    basis = _rounded(model.folded_basis, np.int64(BASIS_BITS - COARSE_BASIS))
    return replace(model, folded_weights=weights, folded_basis=basis)


def _lowest_bits(values: IntArray) -> IntArray:
    """Return the lowest bit that is set anywhere in each line (rows, features, 1)."""
    together = np.bitwise_or.reduce(values, axis=2)
    lowest = np.maximum(together & -together, 1)
    return np.asarray(np.rint(np.log2(lowest)).astype(np.int64)[:, :, None])


def _rounded(values: IntArray, bits: IntArray | np.int64) -> IntArray:
    """Return whole numbers with ``bits`` low bits rounded away."""
    grain = np.int64(1) << bits
    return np.asarray((values + (grain >> 1)) // grain * grain)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A model and what it would cost: ``costs`` (rows,) bytes, those of storing it included."""

    model: MotionModel
    costs: FloatArray


def candidate(model: MotionModel, rehearsal: Rehearsal, manner: Manner, share: float) -> Candidate:
    """Return a model with its costs; the samples' bytes count ``share`` times."""
    return Candidate(model, row_costs(rehearsal, model, manner) * share + row_sizes(model))


def cheapest(candidates: Sequence[Candidate]) -> Candidate:
    """Return a model that has every row from the candidate in which it is cheapest.

    The candidates have equal blocks; what is not in rows is taken from the last one.
    """
    costs = np.stack([each.costs for each in candidates])
    best, rows = costs.argmin(axis=0), np.arange(costs.shape[1])

    def picked(name: str) -> IntArray:
        return np.asarray(np.stack([getattr(each.model, name) for each in candidates])[best, rows])

    model = replace(
        candidates[-1].model,
        folded_weights=picked("folded_weights"),
        folded_basis=picked("folded_basis"),
        base=picked("base"),
        senses=picked("senses"),
        starts=picked("starts"),
    )
    return Candidate(model, costs.min(axis=0))
