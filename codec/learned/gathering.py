"""What a linear prediction is fitted to: features and signals, less those of recalled moments.

A decoder adds to the prediction of a block what the prediction missed at recalled moments. It
is linear in the features, so what it comes to is: the recalled signals, and the weights times
how the features differ from the recalled ones. That is what weights must be good at.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..arithmetic.compiled import compiled
from ..blocks.aiming import aim
from ..blocks.blockcoder import wanted
from ..blocks.blockcontext import KEYS, UNIT_BITS, describe, key_of
from ..blocks.motionmodel import MotionModel
from ..blocks.nodes import FOLLOWER, KIND, ROW, Nodes
from ..blocks.recall import (
    FAR,
    NEIGHBOURS,
    NOWHERE,
    STRIDE,
    KeyArray,
    find_nearest,
    own_stride,
    signals_at,
    weigh,
)
from ..clip import FloatArray, IntArray
from .samples import Sample

Floats = npt.NDArray[np.float32]

GRAINS = 16.0  # of what is fitted to, in a step
COARSEST = -8  # log2 of a grain, centimetres


class Moments(NamedTuple):
    """Moments of decoded clips, as `recall.Memory` has them, before any model is known.

    ``keys``: (rows, moments, 24) 1/64 cm; ``features``: (rows, moments, features) and
    ``signals``: (rows, moments, channels) of the blocks that begin there, centimetres.
    """

    keys: KeyArray
    features: Floats
    signals: Floats


def gathered(
    sample: Sample,
    state: IntArray,
    model: MotionModel,
    others: Sequence[tuple[Sample, IntArray]],
    step: float,
) -> tuple[FloatArray, FloatArray]:
    """Return (features, signals) of all nodes and whole blocks, cm: (nodes, blocks, …).

    From both what is recalled is taken away. ``state``: the sample's decoded frames;
    ``others``: the samples that it refers to, with theirs; ``step``: centimetres.
    """
    blocks = max(len(sample.goal) - 1, 0) // model.span
    xs = np.zeros((sample.nodes.count, blocks, model.weights.shape[1]))
    ys = np.zeros((sample.nodes.count, blocks, model.channels))
    own = own_moments(sample, state, model)
    known = _moments([(other.nodes, states) for other, states in others], model, STRIDE)
    # far less than the step, so that what does not differ is zero, but for float dust
    grain = 2.0 ** int(np.clip(np.floor(np.log2(step / GRAINS)), COARSEST - 8, COARSEST))
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
        *known,
        *own,
        own_stride(model.span),
        grain,
        xs,
        ys,
    )
    return xs, ys


def own_moments(sample: Sample, state: IntArray, model: MotionModel) -> Moments:
    """Return the moments that a sample has of itself, as far as it is not yet decoded, too."""
    frames = state[: len(sample.goal)]
    return _moments([(sample.nodes, frames)], model, own_stride(model.span))


def _moments(clips: Sequence[tuple[Nodes, IntArray]], model: MotionModel, stride: int) -> Moments:
    """Return every ``stride``-th moment of some clips' decoded frames, one after the other."""
    counts = [len(range(1, len(state) - model.span + 1, stride)) for _, state in clips]
    out = Moments(
        np.full((model.rows, sum(counts), KEYS), FAR, np.int16),
        np.zeros((model.rows, sum(counts), model.weights.shape[1]), np.float32),
        np.zeros((model.rows, sum(counts), model.channels), np.float32),
    )
    first = 0
    for (nodes, state), count in zip(clips, counts, strict=True):
        ways = model.span, model.lags, model.up, stride
        _remember(state, nodes.table, *ways, first, count, *out)
        first += count
    return out


@compiled
def _remember(
    state: IntArray,
    table: IntArray,
    span: int,
    lags: IntArray,
    up: int,
    stride: int,
    first: int,
    count: int,
    keys: KeyArray,
    features: Floats,
    signals: Floats,
) -> None:
    nodes = len(table)
    known = np.empty(features.shape[2], np.int64)
    moved = np.zeros((nodes, span, 3), np.int64)
    unit = float(1 << UNIT_BITS)
    for moment in range(first, first + count):
        start = 1 + stride * (moment - first)
        for node in range(nodes):
            if table[node, KIND] == FOLLOWER:
                continue
            row = table[node, ROW]
            signals_at(state, table, node, start, span, moved[node])
            describe(state, table, node, start, span, lags, up, moved, known)
            key_of(known, span, keys[row, moment])
            for f in range(len(known)):
                features[row, moment, f] = known[f] / unit
            for c in range(3 * span):
                signals[row, moment, c] = moved[node, c // 3, c % 3] / unit


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
    keys: KeyArray,
    features: Floats,
    signals: Floats,
    own_keys: KeyArray,
    own_features: Floats,
    own_signals: Floats,
    stride: int,
    grain: float,
    xs: FloatArray,
    ys: FloatArray,
) -> None:
    nodes, blocks, width = xs.shape
    moved = np.zeros((nodes, span, 3), np.int64)
    known = np.empty(width, np.int64)
    aims = np.empty((span, 4), np.int64)
    goals = np.empty(3 * span, np.int64)
    key = np.empty(KEYS, np.int16)
    unit = float(1 << UNIT_BITS)
    moments = keys.shape[1]
    for block in range(blocks):
        start = 1 + block * span
        own = min(max((start - span - 1) // stride + 1, 0), own_keys.shape[1])
        for node in range(nodes):
            if table[node, KIND] == FOLLOWER:
                continue
            row, x, y = table[node, ROW], xs[node, block], ys[node, block]
            describe(state, table, node, start, span, lags, up, moved, known)
            for f in range(width):
                x[f] = known[f] / unit
            aim(state, goal, table, node, start, points, shape, offsets, mends, aims)
            wanted(state, aims, table, node, start, goals)
            for c in range(3 * span):
                y[c] = goals[c] / unit
            # what the levels below will see of this one: its decoded motion
            signals_at(state, table, node, start, span, moved[node])
            key_of(known, span, key)
            near = np.full(NEIGHBOURS, NOWHERE)
            which = np.zeros(NEIGHBOURS, np.int64)
            count = find_nearest(key, keys[row], own_keys[row], own, near, which)
            total = weigh(near, count)
            for n in range(count):
                share, at = near[n] / total, which[n]
                if at < moments:
                    _take_away(share, features[row, at], signals[row, at], x, y)
                else:
                    at -= moments
                    _take_away(share, own_features[row, at], own_signals[row, at], x, y)
            for f in range(width):
                x[f] = round(x[f] / grain) * grain
            for c in range(3 * span):
                y[c] = round(y[c] / grain) * grain


@compiled
def _take_away(
    share: float, features: Floats, signals: Floats, x: FloatArray, y: FloatArray
) -> None:
    for f in range(len(x)):
        x[f] -= share * features[f]
    for c in range(len(y)):
        y[c] -= share * signals[c]
