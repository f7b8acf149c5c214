"""Fitting linear prediction and basis of a motion model to closed-loop walks."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arithmetic.compiled import compiled
from ..blocks.aiming import aim
from ..blocks.blockcoder import wanted
from ..blocks.blockcontext import UNIT_BITS, describe
from ..blocks.blockwalk import STEP_BITS
from ..blocks.motionmodel import (
    BASIS_BITS,
    WEIGHT_BITS,
    MotionModel,
    cosine_basis,
    fold_features,
)
from ..blocks.nodes import FOLLOWER, KIND, ROW
from ..blocks.recall import empty_memory
from ..clip import FloatArray, IntArray
from .abreast import abreast
from .samples import Manner, Sample, walked

ROUNDING_SHARE = 0.015  # of the step: what rounding of one feature's weight may do
BASIS_GRAIN = 11  # bits after the point that a learned basis keeps
RIDGE = 3e-3  # of a feature's mean square, at a step of a millimetre; more at coarser ones
PARENTS = 15  # first of the features that say how guide and carrier move
LAST_FRAME = 1.75  # how much finer than the others the last frame of a block is coded
LEAST_BLOCKS = 200  # a row seen in fewer keeps the numbers that it had


@dataclass(frozen=True, eq=False)
class Products:
    """Sums over all blocks of closed-loop walks with a model, row by row.

    ``gram``: (rows, features, features) products of features, cm²; ``cross``: (rows, features,
    channels) of features and signals; ``square``: (rows, channels, channels) of signals;
    ``seen``: (rows,) blocks; ``costs``: (rows,) about how many bytes they cost.
    """

    gram: FloatArray
    cross: FloatArray
    square: FloatArray
    seen: IntArray
    costs: FloatArray


def products_of(samples: Sequence[Sample], model: MotionModel, manner: Manner) -> Products:
    """Return what `fit_predictors` fits to, from walks with ``model`` and no references."""
    features, channels = model.weights.shape[1:]
    gram = np.zeros((model.rows, features, features))
    cross = np.zeros((model.rows, features, channels))
    square = np.zeros((model.rows, channels, channels))
    seen = np.zeros(model.rows, np.int64)
    bits = np.zeros(model.rows)
    nothing = empty_memory(model.rows, channels)

    def gathered(sample: Sample) -> tuple[FloatArray, FloatArray, FloatArray]:
        done = walked(sample, model, nothing, manner)
        return *_gathered(sample, done.state, model), done.costs

    for sample, (xs, ys, costs) in zip(samples, abreast(gathered, samples), strict=True):
        np.add.at(bits, sample.nodes.table[:, ROW], costs)
        for node in range(sample.nodes.count):
            if sample.nodes.table[node, KIND] == FOLLOWER:
                continue
            row = int(sample.nodes.table[node, ROW])
            x, y = xs[node], ys[node]
            gram[row] += x.T @ x
            cross[row] += x.T @ y
            square[row] += y.T @ y
            seen[row] += len(x)
    return Products(gram, cross, square, seen, bits / 8.0)


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
        own = fold @ gram[row] @ fold.T / seen[row] * np.outer(used, used)
        both = fold @ cross[row] @ cosine.T / seen[row] * used[:, None]
        if not keep_weights:
            weights[row] = _weights(own, both, manner.step / float(1 << STEP_BITS))
        fitted = weights[row] / float(1 << WEIGHT_BITS)
        left = cosine @ square[row] @ cosine.T / seen[row]
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
    usual = np.sqrt(np.diag(own)) + 1e-6
    ridge = RIDGE * min(step / 0.1, 4.0)
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


def _gathered(sample: Sample, state: IntArray, model: MotionModel) -> tuple[FloatArray, FloatArray]:
    """Return (features, signals) of all nodes and whole blocks, cm: (nodes, blocks, …)."""
    frames = len(sample.goal)
    blocks = max(frames - 1, 0) // model.span
    count = sample.nodes.count
    xs = np.zeros((count, blocks, model.weights.shape[1]))
    ys = np.zeros((count, blocks, model.channels))
    measure = sample.yardstick
    _gather(
        state,
        sample.goal,
        sample.nodes.table,
        model.span,
        model.lags,
        model.up,
        measure.points,
        measure.shape,
        measure.offsets,
        measure.mends,
        xs,
        ys,
    )
    return xs, ys


@compiled
def _gather(
    state: IntArray,
    goal: IntArray,
    table: IntArray,
    span: int,
    lags: IntArray,
    up: int,
    points: FloatArray,
    shape: IntArray,
    offsets: FloatArray,
    mends: FloatArray,
    xs: FloatArray,
    ys: FloatArray,
) -> None:
    nodes, blocks, width = xs.shape
    signals = np.zeros((nodes, span, 3), np.int64)
    features = np.empty(width, np.int64)
    aims = np.empty((span, 4), np.int64)
    goals = np.empty(3 * span, np.int64)
    unit = float(1 << UNIT_BITS)
    for block in range(blocks):
        start = 1 + block * span
        for node in range(nodes):
            if table[node, KIND] == FOLLOWER:
                continue
            describe(state, table, node, start, span, lags, up, signals, features)
            for f in range(width):
                xs[node, block, f] = round(features[f] / unit * 256.0) / 256.0
            aim(state, goal, table, node, start, points, shape, offsets, mends, aims)
            wanted(state, aims, table, node, start, goals)
            for c in range(3 * span):
                ys[node, block, c] = round(goals[c] / unit * 256.0) / 256.0
            # what the levels below will see of this one: its decoded motion
            wanted(state, state[start : start + span, node], table, node, start, goals)
            for c in range(3 * span):
                signals[node, c // 3, c % 3] = goals[c]
