"""Fitting the expected sizes of a motion model to what closed-loop walks quantise.

A generalised linear model (McCullagh & Nelder 1989, Section 2.5): the logarithm l of an expected
size is linear in what the decoder knows, and sizes q are two-sided geometric. Of a table for the
expected size m = e^l the length of q changes with l as (m - q) / √(1 + m²), and in the mean over
all q that changes as m / √(1 + m²): so Newton's steps have a closed form (Fisher scoring).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ..arithmetic.compiled import compiled
from ..blocks.motionmodel import GROUPS, MotionModel
from ..blocks.nodes import FOLLOWER, KIND, ROW
from ..clip import FloatArray, IntArray
from .abreast import abreast
from .fixedorder import solved
from .rehearsal import Rehearsal
from .samples import Manner

LEAST_BLOCKS = 200  # a row seen in fewer keeps the numbers that it had
MOST_SAMPLES = 6000  # blocks of a row that the fit looks at
LEAST_MEAN = 0.003  # quantiser steps
RIDGE = 1e-3  # nats for every squared sense
HOLD = 1e-3  # nats for how far a logarithm is from where it begins, squared
SCORINGS = 12  # steps at the most
LARGEST_SCORING = 1.0  # of any number in one step
SETTLED = 1e-4  # a step of less is the last one
LN2 = 0.6931471805599453
LOWEST, HIGHEST = -7 * 256, 22 * 256  # 1/256 octaves: expected sizes that are told apart


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

    def seen() -> Iterator[tuple[IntArray, IntArray]]:
        for row in rows:
            x = np.concatenate(signs[row]) * contexts
            q = np.abs(np.concatenate(sizes[row]))
            if len(x) > MOST_SAMPLES:
                chosen = rng.choice(len(x), MOST_SAMPLES, replace=False)
                x, q = x[chosen], q[chosen]
            yield x, q

    fits = abreast(lambda both: fit_sizes(*both), seen())
    for row, (found_base, found_senses) in zip(rows, fits, strict=True):
        base[row], senses[row] = found_base, found_senses
    return replace(model, base=base, senses=senses)


def fit_sizes(signs: IntArray, sizes: IntArray) -> tuple[IntArray, IntArray]:
    """Return (base, senses), × 256, that make ``sizes`` cheapest under two-sided geometric tables.

    ``signs``: (blocks, signs) × 256; ``sizes``: (blocks, coefficients) absolute quantised values.
    """
    channels = sizes.shape[1]
    third = max(channels // GROUPS, 1)
    centre = np.rint(signs.mean(axis=0))
    x = (signs - centre) / 256.0
    base, senses = np.zeros(channels), np.zeros((GROUPS, signs.shape[1]))
    for group in range(GROUPS):
        own = slice(third * group, channels if group == GROUPS - 1 else third * (group + 1))
        found = _fitted(x, sizes[:, own]) * 256.0 / LN2
        coefficients = len(found) - len(centre)
        senses[group] = np.rint(found[coefficients:])
        base[own] = found[:coefficients] - (found[coefficients:] * centre / 256.0).sum()
    return np.rint(base).astype(np.int64), senses.astype(np.int64)


def _fitted(x: FloatArray, sizes: IntArray) -> FloatArray:
    """Return the logarithms of a group's sizes where ``x`` is zero, and what each x adds."""
    coefficients = sizes.shape[1]
    usual = np.maximum(sizes.mean(axis=0), LEAST_MEAN)
    known = np.zeros(coefficients + x.shape[1])
    known[:coefficients] = np.round(np.log(usual), 6)  # whose last bits machines know differently
    ridge = 2.0 * np.where(np.arange(len(known)) < coefficients, HOLD, RIDGE)
    begin = known
    contiguous = np.ascontiguousarray(sizes)
    for _ in range(SCORINGS):
        slope, curve = _scores(x, contiguous, known, *_tables())
        slope = slope / len(x) + ridge * (known - begin)
        curve = curve / len(x) + np.diag(ridge)
        step = solved(curve, slope[:, None], 2.0 * min(HOLD, RIDGE))[:, 0]
        largest = np.abs(step).max()
        known = known - step * min(1.0, LARGEST_SCORING / max(largest, SETTLED))
        if largest < SETTLED:
            break
    return known


@lru_cache(maxsize=1)
def _tables() -> tuple[FloatArray, FloatArray]:
    """Return m / √(1 + m²) and 1 / √(1 + m²) for every expected size m that is told apart."""
    mean = np.exp2(np.arange(LOWEST, HIGHEST + 1) / 256.0)
    root = np.sqrt(1.0 + mean**2)
    curve, inverse = (np.rint(each * 2.0**40) * 2.0**-40 for each in (mean / root, 1.0 / root))
    return curve, inverse


@compiled
def _scores(
    x: FloatArray, sizes: IntArray, known: FloatArray, curves: FloatArray, inverses: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the first and the expected second derivatives of what all sizes take, in nats."""
    coefficients, count = sizes.shape[1], len(known)
    slope, curve = np.zeros(count), np.zeros((count, count))
    for block in range(len(x)):
        level = 0.0
        for k in range(coefficients, count):
            level += known[k] * x[block, k - coefficients]
        slopes, curved = 0.0, 0.0
        for c in range(coefficients):
            octaves = round((known[c] + level) * (256.0 / LN2))
            at = min(max(octaves, LOWEST), HIGHEST) - LOWEST
            own = curves[at] - sizes[block, c] * inverses[at]
            slopes += own
            curved += curves[at]
            slope[c] += own
            curve[c, c] += curves[at]
            for k in range(coefficients, count):
                curve[k, c] += curves[at] * x[block, k - coefficients]
        for k in range(coefficients, count):
            slope[k] += slopes * x[block, k - coefficients]
            heavy = curved * x[block, k - coefficients]
            for j in range(coefficients, k + 1):
                curve[k, j] += heavy * x[block, j - coefficients]
    return slope, curve  # whose lower half `solved` reads
