"""Learning a motion model from sample clips: linear prediction, basis, expected sizes.

The sample is walked by the encoder itself, so that the model learns from decoded pasts with
their rounding errors. Everything learned is rounded to integers; the codec never sees a float.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from .blockcoder import SIGNS, expect, settle, wanted
from .blockcontext import UNIT_BITS, describe
from .blockwalk import STEP_BITS, walk
from .clip import FloatArray, IntArray
from .compiled import compiled
from .motionmodel import (
    BASIS_BITS,
    GROUPS,
    WEIGHT_BITS,
    MotionModel,
    cosine_basis,
    fold_features,
    folded,
)
from .nodes import FOLLOWER, KIND, ROW, Nodes
from .recall import FollowArray, KeyArray, Memory, empty_memory
from .yardstick import Yardstick

ROUNDING_SHARE = 0.015  # of the step: what rounding of one feature's weight may do
BASIS_GRAIN = 11  # bits after the point that a learned basis keeps
RIDGE = 3e-3  # of a feature's mean square
LEAST_BLOCKS = 200  # a row seen in fewer keeps the fixed model's numbers
MOST_SAMPLES = 6000  # blocks of a row that expected sizes are fitted to


@dataclass(frozen=True, eq=False)
class Sample:
    """One clip to learn from: what `blockwalk.walk` takes."""

    goal: IntArray
    first: IntArray
    nodes: Nodes
    yardstick: Yardstick


def learn(
    samples: Sequence[Sample],
    start: MotionModel,
    step: int,
    thrift: float,
    memories: Sequence[Memory] | None = None,
    rounds: int = 2,
) -> MotionModel:
    """Return a model learned from sample clips, beginning with ``start``.

    ``step``: 2^-24 cm; ``memories``: what each sample clip may refer to.
    """
    model = start
    for _ in range(rounds):
        model = _predictors(samples, model, step, thrift)
    return _sizes(samples, model, step, thrift, memories)


def _walked(
    sample: Sample, model: MotionModel, step: int, thrift: float, memory: Memory
) -> tuple[IntArray, IntArray]:
    done = walk(
        sample.goal,
        sample.first,
        sample.nodes,
        model,
        memory,
        sample.yardstick,
        step,
        thrift,
        False,
    )
    return done.state, done.quantised


def _predictors(
    samples: Sequence[Sample], model: MotionModel, step: int, thrift: float
) -> MotionModel:
    """Return the model with weights and bases fitted to closed-loop walks with the old one."""
    features, channels = model.weights.shape[1:]
    gram = np.zeros((model.rows, features, features))
    cross = np.zeros((model.rows, features, channels))
    square = np.zeros((model.rows, channels, channels))
    seen = np.zeros(model.rows, np.int64)
    nothing = empty_memory(model.rows, channels)
    for sample in samples:
        state, _ = _walked(sample, model, step, thrift, nothing)
        xs, ys = _gathered(sample, state, model)
        for node in range(sample.nodes.count):
            if sample.nodes.table[node, KIND] == FOLLOWER:
                continue
            row = int(sample.nodes.table[node, ROW])
            x, y = xs[node], ys[node]
            gram[row] += x.T @ x
            cross[row] += x.T @ y
            square[row] += y.T @ y
            seen[row] += len(x)
    weights, basis = model.folded_weights.copy(), model.folded_basis.copy()
    for row in np.flatnonzero(seen >= LEAST_BLOCKS).tolist():
        scale = np.sqrt(np.diag(gram[row]) / seen[row]) + 1e-6
        normal = gram[row] / np.outer(scale, scale) + RIDGE * seen[row] * np.eye(features)
        solved = np.linalg.solve(normal, cross[row] / scale[:, None]) / scale[:, None]
        fold = fold_features(model.span) / float(1 << BASIS_BITS)
        usual = np.sqrt(np.einsum("ij,jk,ik->i", fold, gram[row], fold) / seen[row]) + 1e-6
        weights[row] = folded(solved, model.span, _bits_to_drop(usual, step))
        fitted = replace(model, folded_weights=weights[row : row + 1]).weights[0]
        fitted = fitted / (1 << WEIGHT_BITS)
        left = square[row] - fitted.T @ cross[row] - cross[row].T @ fitted
        left += fitted.T @ gram[row] @ fitted
        basis[row] = _basis(left / seen[row], model.span)
    return replace(model, folded_weights=weights, folded_basis=basis)


def _bits_to_drop(usual: FloatArray, step: int) -> FloatArray:
    """Return how many low bits of the features' weights may go; ``usual``: their sizes, cm.

    What rounding moves a prediction by stays a small share of the step (2^-24 cm).
    """
    allowed = ROUNDING_SHARE * step / float(1 << STEP_BITS) / usual * (1 << WEIGHT_BITS)
    return np.asarray(np.clip(np.floor(np.log2(np.maximum(allowed, 1.0))), 0, 11))


def _basis(covariance: FloatArray, span: int) -> IntArray:
    """Return the eigenvectors of a covariance as a folded basis, the largest first."""
    _, vectors = np.linalg.eigh(covariance + 1e-12 * np.eye(len(covariance)))
    rows = vectors.T[::-1] @ cosine_basis(span).T
    signs = np.sign(rows[np.arange(len(rows)), np.abs(rows).argmax(axis=1)])
    coarse = np.rint(rows * signs[:, None] * (1 << BASIS_GRAIN)).astype(np.int64)
    return np.asarray(coarse << (BASIS_BITS - BASIS_GRAIN))


def _gathered(sample: Sample, state: IntArray, model: MotionModel) -> tuple[FloatArray, FloatArray]:
    """Return (features, signals) of all nodes and whole blocks, cm: (nodes, blocks, …)."""
    frames = len(sample.goal)
    blocks = max(frames - 1, 0) // model.span
    count = sample.nodes.count
    xs = np.zeros((count, blocks, model.weights.shape[1]))
    ys = np.zeros((count, blocks, model.channels))
    _gather(state, sample.goal, sample.nodes.table, model.span, model.lags, model.up, xs, ys)
    return xs, ys


@compiled
def _gather(
    state: IntArray,
    goal: IntArray,
    table: IntArray,
    span: int,
    lags: IntArray,
    up: int,
    xs: FloatArray,
    ys: FloatArray,
) -> None:
    nodes, blocks, width = xs.shape
    signals = np.zeros((nodes, span, 3), np.int64)
    features = np.empty(width, np.int64)
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
            wanted(state, goal, table, node, start, span, goals)
            for c in range(3 * span):
                ys[node, block, c] = round(goals[c] / unit * 256.0) / 256.0
            # what the levels below will see of this one: its decoded motion
            wanted(state, state, table, node, start, span, goals)
            for c in range(3 * span):
                signals[node, c // 3, c % 3] = goals[c]


@compiled
def _gather_signs(
    state: IntArray,
    table: IntArray,
    top: int,
    path: int,
    span: int,
    lags: IntArray,
    up: int,
    weights: IntArray,
    basis: IntArray,
    base: IntArray,
    senses: IntArray,
    keys: KeyArray,
    follows: FollowArray,
    quantised: IntArray,
    step: int,
    found: IntArray,
) -> None:
    blocks, nodes, channels = quantised.shape
    signals = np.zeros((nodes, span, 3), np.int64)
    activity = np.zeros((3, nodes), np.int64)
    prediction = np.empty(channels, np.int64)
    classes = np.empty(channels, np.int64)
    for block in range(blocks):
        start = 1 + block * span
        for node in range(nodes):
            if table[node, KIND] == FOLLOWER:
                continue
            expect(
                state, table, node, start, span, lags, up, weights, base, senses, keys, follows,
                signals, activity, top, path, step, 0, prediction, classes, found[node, block],
            )  # fmt: skip
            settle(
                state, table, node, start, span, basis, prediction, quantised[block, node],
                step, 0, signals, activity,
            )  # fmt: skip
        activity[2] = activity[1]
        activity[1] = activity[0]


def _sizes(
    samples: Sequence[Sample],
    model: MotionModel,
    step: int,
    thrift: float,
    memories: Sequence[Memory] | None,
) -> MotionModel:
    """Return the model with expected sizes fitted to what closed-loop walks quantise."""
    nothing = empty_memory(model.rows, model.channels)
    signs: list[list[IntArray]] = [[] for _ in range(model.rows)]
    sizes: list[list[IntArray]] = [[] for _ in range(model.rows)]
    for at, sample in enumerate(samples):
        memory = nothing if memories is None else memories[at]
        state, quantised = _walked(sample, model, step, thrift, memory)
        found = np.zeros((sample.nodes.count, len(quantised), SIGNS), np.int64)
        _gather_signs(
            state,
            sample.nodes.table,
            sample.nodes.top,
            sample.nodes.path,
            model.span,
            model.lags,
            model.up,
            model.weights,
            model.basis,
            model.base,
            model.senses,
            memory.keys,
            memory.follows,
            quantised,
            step,
            found,
        )
        for node in range(sample.nodes.count):
            if sample.nodes.table[node, KIND] != FOLLOWER:
                row = int(sample.nodes.table[node, ROW])
                signs[row].append(found[node])
                sizes[row].append(quantised[:, node])
    base, senses = model.base.copy(), model.senses.copy()
    rng = np.random.default_rng(0)
    for row in range(model.rows):
        if sum(map(len, signs[row])) < LEAST_BLOCKS:
            continue
        x, q = np.concatenate(signs[row]) / 256.0, np.abs(np.concatenate(sizes[row]))
        if len(x) > MOST_SAMPLES:
            chosen = rng.choice(len(x), MOST_SAMPLES, replace=False)
            x, q = x[chosen], q[chosen]
        found_base, found_senses = fit_sizes(x, q.astype(np.float64))
        base[row] = np.rint(found_base * 256)
        senses[row] = np.rint(found_senses * 256)
    return replace(model, base=base, senses=senses)


def fit_sizes(signs: FloatArray, sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return (base, senses) that make ``sizes`` cheapest under two-sided geometric tables.

    ``signs``: (blocks, signs), ``sizes``: (blocks, coefficients) absolute quantised values.
    """
    blocks, channels = sizes.shape
    third = max(channels // GROUPS, 1)
    group = np.minimum(np.arange(channels) // third, GROUPS - 1)
    centre = signs.mean(axis=0)
    x = signs - centre
    start = np.log(np.maximum(sizes.mean(axis=0), 0.003))

    def cost(values: FloatArray) -> tuple[float, FloatArray]:
        base, senses = values[:channels], values[channels:].reshape(GROUPS, -1)
        level = np.clip(base + (x @ senses.T)[:, group], -4.85, 15.0)
        mean = np.exp(level)
        root = np.sqrt(1.0 + mean * mean)
        theta = (root - 1.0) / mean
        bits = np.log((1.0 + theta) / (1.0 - theta)) - sizes * np.log(theta)
        slope = (mean * mean / root - (root - 1.0)) / (mean * mean)
        step = (1.0 / (1.0 - theta) + 1.0 / (1.0 + theta) - sizes / theta) * slope * mean
        by_group = np.stack([step[:, group == g].sum(axis=1) for g in range(GROUPS)], axis=1)
        gradient = np.concatenate([step.sum(axis=0), (by_group.T @ x).ravel()]) / blocks
        penalty = 1e-3 * np.square(senses).sum()
        gradient[channels:] += 2e-3 * senses.ravel()
        return float(bits.sum() / blocks + penalty), gradient

    values = np.concatenate([start, np.zeros(GROUPS * signs.shape[1])])
    best = minimize(cost, values, jac=True, method="L-BFGS-B", options={"maxiter": 60}).x
    base = best[:channels] / np.log(2.0)
    senses = best[channels:].reshape(GROUPS, -1) / np.log(2.0)
    return base - (senses @ centre)[group], senses
