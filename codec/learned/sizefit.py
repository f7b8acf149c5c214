"""Fitting the expected sizes of a motion model to what closed-loop walks quantise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from ..blocks.motionmodel import GROUPS, MotionModel
from ..blocks.nodes import FOLLOWER, KIND, ROW
from ..clip import FloatArray, IntArray
from .abreast import abreast
from .rehearsal import Rehearsal
from .samples import Manner

LEAST_BLOCKS = 200  # a row seen in fewer keeps the numbers that it had
MOST_SAMPLES = 6000  # blocks of a row that the fit looks at


def fit_all_sizes(
    rehearsal: Rehearsal, model: MotionModel, manner: Manner, contexts: bool = True
) -> MotionModel:
    """Return the model with expected sizes fitted to what closed-loop walks quantise.

    Without ``contexts`` they depend on the coefficient alone: the senses are zero.
    """
    signs: list[list[IntArray]] = [[] for _ in range(model.rows)]
    sizes: list[list[IntArray]] = [[] for _ in range(model.rows)]
    walks = rehearsal.walk(model, manner, lambda _, walk: (walk.signs, walk.quantised))
    for sample, (found, quantised) in zip(rehearsal.samples, walks, strict=True):
        for node in range(sample.nodes.count):
            if sample.nodes.table[node, KIND] != FOLLOWER:
                row = int(sample.nodes.table[node, ROW])
                signs[row].append(found[:, node])
                sizes[row].append(quantised[:, node])
    base, senses = model.base.copy(), model.senses.copy()
    rows = [row for row in range(model.rows) if sum(map(len, signs[row])) >= LEAST_BLOCKS]
    rng = np.random.default_rng(0)

    def seen() -> Iterator[tuple[FloatArray, FloatArray]]:
        for row in rows:
            x = np.concatenate(signs[row]) / np.float64(256.0) * contexts
            q = np.abs(np.concatenate(sizes[row]))
            if len(x) > MOST_SAMPLES:
                chosen = rng.choice(len(x), MOST_SAMPLES, replace=False)
                x, q = x[chosen], q[chosen]
            yield np.asarray(x, np.float64), q.astype(np.float64)

    fits = abreast(lambda both: fit_sizes(*both), seen())
    for row, (found_base, found_senses) in zip(rows, fits, strict=True):
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
    # in place: making arrays anew takes longer than filling them
    mean, square, root, above, theta, less, more = (np.empty(sizes.shape) for _ in range(7))

    def cost(values: FloatArray) -> tuple[float, FloatArray]:
        base, senses = values[:channels], values[channels:].reshape(GROUPS, -1)
        np.add(base, (x @ senses.T)[:, group], out=mean)
        np.exp(np.clip(mean, -4.85, 15.0, out=mean), out=mean)
        np.multiply(mean, mean, out=square)
        np.sqrt(np.add(square, 1.0, out=root), out=root)
        np.subtract(root, 1.0, out=above)
        np.divide(above, mean, out=theta)
        np.subtract(1.0, theta, out=less)
        np.add(1.0, theta, out=more)
        slope = np.divide(square, root, out=root)  # of theta over the mean: (m² / r - (r - 1)) / m²
        slope -= above
        slope /= square
        bits = np.log(np.divide(more, less, out=square), out=square)
        bits -= np.multiply(sizes, np.log(theta, out=above), out=above)
        step = np.divide(1.0, less, out=less)  # of bits over the mean's logarithm
        step += np.divide(1.0, more, out=more)
        step -= np.divide(sizes, theta, out=theta)
        step *= slope
        step *= mean
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
