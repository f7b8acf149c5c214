"""Fitting linear prediction and basis of a motion model to closed-loop walks."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ..blocks.blockwalk import STEP_BITS, Walk
from ..blocks.motionmodel import (
    BASIS_BITS,
    WEIGHT_BITS,
    MotionModel,
    cosine_basis,
    fold_features,
)
from ..blocks.nodes import FOLLOWER, KIND, ROW
from ..clip import FloatArray, IntArray
from .fixedorder import add_products, eigenvectors, folded_products, solved, times
from .gathering import gathered
from .rehearsal import Rehearsal
from .samples import Manner, Sample

ROUNDING_SHARE = 0.015  # of the step: what rounding of one feature's weight may do
BASIS_GRAIN = 11  # bits after the point that a learned basis keeps
RIDGE = 1.5e-2  # of a feature's mean square, at a step of a millimetre; more at coarser ones
SURE = 0.2  # of the squared step: blocks missed by less do not count for more
PARENTS = 15  # first of the features that say how guide and carrier move
LAST_FRAME = 1.75  # how much finer than the others the last frame of a block is coded
LEAST_BLOCKS = 200  # a row seen in fewer keeps the numbers that it had


@dataclass(frozen=True, eq=False)
class Products:
    """Weighted means over all blocks of closed-loop walks with a model, row by row.

    ``gram``: (rows, features, features) products of features, cm²; ``cross``: (rows, features,
    channels) of features and signals; ``square``: (rows, channels, channels) of signals;
    ``seen``: (rows,) blocks; ``rehearsal``: the samples as the walks left them.
    """

    gram: FloatArray
    cross: FloatArray
    square: FloatArray
    seen: IntArray
    rehearsal: Rehearsal


def products_of(rehearsal: Rehearsal, model: MotionModel, manner: Manner) -> Products:
    """Return what `fit_predictors` fits to, from walks with ``model``.

    A block weighs as the inverse of its squared miss under ``model``, to which a part of the
    squared step is added: bits go with the logarithm of what is missed, so that the few blocks
    that nothing foresees must not decide (iteratively reweighted least squares; Cauchy's
    weights).
    """
    features, channels = model.weights.shape[1:]
    gram = np.zeros((model.rows, features, features))
    cross = np.zeros((model.rows, features, channels))
    square = np.zeros((model.rows, channels, channels))
    seen = np.zeros(model.rows, np.int64)
    weight = np.zeros(model.rows)
    step = manner.step / float(1 << STEP_BITS)
    states: list[IntArray] = []

    def both(at: int, walk: Walk) -> tuple[IntArray, int, list[Sums]]:
        sample = rehearsal.samples[at]
        state = walk.state[: len(sample.goal)]
        xs, ys = gathered(sample, walk.state, model, rehearsal.others(at), step)
        return state, xs.shape[1], [*_sums(sample, xs, ys, model, SURE * step**2)]

    walks = rehearsal.walk(model, manner, both)
    for state, blocks, sums in walks:
        states.append(state)
        for row, counts, *parts in sums:
            for whole, part in zip((gram, cross, square), parts, strict=True):
                whole[row] += part
            seen[row] += blocks
            weight[row] += counts
    share = 1.0 / np.maximum(weight, 1e-12)[:, None, None]
    known = replace(rehearsal, states=states)
    gram += np.triu(gram, 1).transpose(0, 2, 1)
    return Products(gram * share, cross * share, square * share, seen, known)


Sums: TypeAlias = tuple[int, float, FloatArray, FloatArray, FloatArray]


def _sums(
    sample: Sample, xs: FloatArray, ys: FloatArray, model: MotionModel, sure: float
) -> Iterator[Sums]:
    """Yield (row, what its blocks count for, gram, cross, square) of every node that is coded."""
    features, channels = model.weights.shape[1:]
    for node, about in enumerate(sample.nodes.table):
        if about[KIND] != FOLLOWER:
            row = int(about[ROW])
            sizes = (features, features), (features, channels), (channels, channels)
            gram, cross, square = (np.zeros(size) for size in sizes)
            weights = model.weights[row] / float(1 << WEIGHT_BITS)
            counts = add_products(xs[node], ys[node], weights, sure, gram, cross, square)
            yield row, counts, gram, cross, square


def fit_predictors(
    products: Products,
    model: MotionModel,
    manner: Manner,
    keep_weights: bool = False,
    without: Collection[str] = (),
) -> MotionModel:
    """Return the model with weights and bases fitted to closed-loop walks with the old one.

    ``products``: of the old model; ``keep_weights``: only the bases are fitted; ``without``:
    see `learning.learn`.
    """
    features, channels = model.weights.shape[1:]
    gram, cross, square, seen = products.gram, products.cross, products.square, products.seen
    fold = fold_features(model.span) / float(1 << BASIS_BITS)
    cosine = cosine_basis(model.span)
    used = np.ones(features)
    if "parents" in without:
        used[PARENTS : PARENTS + 2 * (channels + 6)] = 0.0
    weights, basis = model.folded_weights.copy(), model.folded_basis.copy()
    for row in np.flatnonzero(seen >= LEAST_BLOCKS).tolist():
        own = folded_products(fold, gram[row], fold) * np.outer(used, used)
        both = folded_products(fold, cross[row], cosine) * used[:, None]
        if not keep_weights:
            weights[row] = _weights(own, both, manner.step / float(1 << STEP_BITS))
        foreseen = np.ascontiguousarray(weights[row].T / float(1 << WEIGHT_BITS))
        shared = times(foreseen, both)
        left = folded_products(cosine, square[row], cosine) - shared - shared.T
        left += folded_products(foreseen, own, foreseen)
        if "basis" not in without:
            basis[row] = _basis(left, model.span)
    return replace(model, folded_weights=weights, folded_basis=basis)


def _weights(own: FloatArray, both: FloatArray, step: float) -> IntArray:
    """Return the folded weights × 2^16 of least squares.

    ``own``: (features, features) mean products of folded features, ``both``: (features,
    channels) of features and signals; ``step``: centimetres. Weights are rounded as far as the
    step allows.
    """
    usual = np.sqrt(np.maximum(np.diag(own), 0.0)) + 1e-6
    ridge = RIDGE * min(step / 0.1, 6.0)
    normal = own / np.outer(usual, usual) + ridge * np.eye(len(own))
    moved = solved(normal, both / usual[:, None], ridge)
    allowed = ROUNDING_SHARE * step / usual * (1 << WEIGHT_BITS)
    bits = np.clip(np.frexp(allowed)[1] - 1, 0, 15)[:, None]
    fine = moved / usual[:, None] * (1 << WEIGHT_BITS)
    coarse = np.rint(np.ldexp(fine, -bits)).astype(np.int64)
    return np.asarray(coarse << bits)


def _basis(covariance: FloatArray, span: int) -> IntArray:
    """Return the basis of a folded covariance: eigenvectors, the largest first.

    They are those of the signals with the last frame stretched, so that rounding errs less
    there: the next block is predicted from it. The volume of all errors stays the same.
    """
    stretch = np.ones(span)
    stretch[-1] = LAST_FRAME
    stretch /= round(LAST_FRAME ** (1.0 / span), 9)  # whose last bits machines know differently
    cosine, scales = cosine_basis(span), np.repeat(stretch, 3)
    stretched = times(cosine * scales, np.ascontiguousarray(cosine.T))
    relaxed = times(cosine / scales, np.ascontiguousarray(cosine.T))
    rows = eigenvectors(folded_products(stretched, covariance, stretched))
    signs = np.sign(rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)])
    fine = times(rows * signs[:, None], relaxed)
    coarse = np.rint(fine * (1 << BASIS_GRAIN)).astype(np.int64)
    return np.asarray(coarse << (BASIS_BITS - BASIS_GRAIN))
