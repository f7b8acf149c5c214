"""Fitting linear prediction and basis of a motion model to closed-loop walks."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

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
from .gathering import gathered
from .rehearsal import Rehearsal
from .samples import Manner

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

    def both(at: int, walk: Walk) -> tuple[IntArray, FloatArray, FloatArray]:
        sample = rehearsal.samples[at]
        state = walk.state[: len(sample.goal)]
        return state, *gathered(sample, walk.state, model, rehearsal.others(at), step)

    walks = rehearsal.walk(model, manner, both)
    for sample, (state, xs, ys) in zip(rehearsal.samples, walks, strict=True):
        states.append(state)
        for node in range(sample.nodes.count):
            if sample.nodes.table[node, KIND] == FOLLOWER:
                continue
            row = int(sample.nodes.table[node, ROW])
            x, y = xs[node], ys[node]
            missed = y - x @ (model.weights[row] / float(1 << WEIGHT_BITS))
            weights = 1.0 / (SURE * step**2 + np.square(missed).mean(axis=1))
            heavy = x.T * weights
            gram[row] += heavy @ x
            cross[row] += heavy @ y
            square[row] += (y.T * weights) @ y
            seen[row] += len(x)
            weight[row] += weights.sum()
    share = 1.0 / np.maximum(weight, 1e-12)[:, None, None]
    known = replace(rehearsal, states=states)
    return Products(gram * share, cross * share, square * share, seen, known)


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
        own = fold @ gram[row] @ fold.T * np.outer(used, used)
        both = fold @ cross[row] @ cosine.T * used[:, None]
        if not keep_weights:
            weights[row] = _weights(own, both, manner.step / float(1 << STEP_BITS))
        fitted = weights[row] / float(1 << WEIGHT_BITS)
        left = cosine @ square[row] @ cosine.T
        left += fitted.T @ own @ fitted - fitted.T @ both - both.T @ fitted
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
    target = both / usual[:, None]
    moved = np.linalg.solve(normal, target)
    allowed = ROUNDING_SHARE * step / usual * (1 << WEIGHT_BITS)
    grain = np.exp2(np.clip(np.floor(np.log2(np.maximum(allowed, 1.0))), 0, 15))[:, None]
    fine = moved / usual[:, None] * (1 << WEIGHT_BITS)
    return np.asarray(np.rint(fine / grain) * grain, np.int64)


def _basis(covariance: FloatArray, span: int) -> IntArray:
    """Return the basis of a folded covariance: eigenvectors, the largest first.

    They are those of the signals with the last frame stretched, so that rounding errs less
    there: the next block is predicted from it. The volume of all errors stays the same.
    """
    stretch = np.ones(span)
    stretch[-1] = LAST_FRAME
    stretch /= LAST_FRAME ** (1.0 / span)
    cosine, scales = cosine_basis(span), np.repeat(stretch, 3)
    stretched = (cosine * scales) @ cosine.T
    relaxed = (cosine / scales) @ cosine.T
    alike = stretched @ covariance @ stretched
    _, vectors = np.linalg.eigh(alike + 1e-12 * np.eye(len(covariance)))
    rows = vectors.T[::-1]
    signs = np.sign(rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)])
    coarse = np.rint((rows * signs[:, None]) @ relaxed * (1 << BASIS_GRAIN)).astype(np.int64)
    return np.asarray(coarse << (BASIS_BITS - BASIS_GRAIN))
