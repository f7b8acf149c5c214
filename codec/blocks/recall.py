"""Retrieval without side information: what followed in reference clips when it was like now.

Before a node's block is coded, encoder and decoder know its features. They look for the
moments of the clip's *reference clips* whose features are nearest, and add the mean of what
the linear prediction missed there to the prediction. No index is sent; the spread of what
followed says how sure it is, which the entropy coder reads.

A clip is its own reference, too: its moments are remembered as soon as what followed them is
decoded. Nobody walks so much like a person as the same person two steps ago.

The idea is Gu, Peng & Deng's (2009), patterns that repeat across clips, turned round: the
pattern is found by its context, so that its number need not be coded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..arithmetic.compiled import compiled, lean
from ..arithmetic.fixedpoint import rotated
from ..clip import IntArray
from .blockcontext import KEYS, back, describe, key_of, moved_in_lengths, turn_at
from .nodes import AXES, FOLLOWER, KIND, PLACE, ROW

NEIGHBOURS = 8
STRIDE = 2  # frames between remembered moments of references
NOWHERE = 1 << 62  # squared distance of a neighbour that is not there
FAR = 32767  # keys of a row that a reference clip does not have

KeyArray = npt.NDArray[np.int16]
FollowArray = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Memory:
    """The moments of reference clips, or of a clip itself.

    ``keys``: (rows, moments, 24) what retrieval compares, 1/64 cm; ``follows``: (rows,
    moments, channels of a block) what linear prediction missed there, 2^-20 cm.
    """

    keys: KeyArray
    follows: FollowArray

    @property
    def moments(self) -> int:
        """Number of moments."""
        return int(self.keys.shape[1])


def empty_memory(rows: int, channels: int) -> Memory:
    """Return the memory of a clip without references."""
    return Memory(np.zeros((rows, 0, KEYS), np.int16), np.zeros((rows, 0, channels), np.int32))


def joined(memories: list[Memory], rows: int, channels: int) -> Memory:
    """Return the moments of several clips, one after the other."""
    if not memories:
        return empty_memory(rows, channels)
    return Memory(
        np.concatenate([memory.keys for memory in memories], axis=1),
        np.concatenate([memory.follows for memory in memories], axis=1),
    )


def remember(
    state: IntArray,
    frames: int,
    table: IntArray,
    span: int,
    lags: IntArray,
    up: int,
    weights: IntArray,
) -> Memory:
    """Return the moments of one decoded clip.

    ``state``: (frames or more, nodes, 4); ``weights``: (rows, features, channels) of the
    linear prediction.
    """
    out = _room(frames, len(weights), span, STRIDE)
    remember_next(state, frames, table, span, lags, up, weights, STRIDE, out.keys, out.follows, 0)
    return out


def own_memory(frames: int, rows: int, span: int) -> Memory:
    """Return room for the moments of a run itself, which fills while it is decoded."""
    return _room(frames, rows, span, own_stride(span))


@compiled
def own_stride(span: int) -> int:
    """Return how many frames lie between remembered moments of a run itself."""
    return max(span // 4, 1)


def _room(frames: int, rows: int, span: int, stride: int) -> Memory:
    moments = len(range(1, frames - span + 1, stride))
    return Memory(
        np.full((rows, moments, KEYS), FAR, np.int16),
        np.zeros((rows, moments, 3 * span), np.int32),
    )


@lean
def signals_at(
    state: IntArray, table: IntArray, node: int, start: int, span: int, out: IntArray
) -> None:
    """Write the signals (span, 3) of a node whose frames are known into ``out``."""
    last = start - 1
    axes = table[node, AXES]
    for i in range(span):
        x, y, z = moved_in_lengths(state, table, node, last, start + i)
        if table[node, KIND] == PLACE and axes >= 0:
            x, y, z = rotated(back(turn_at(state, last, axes)), x, y, z)
        out[i, 0], out[i, 1], out[i, 2] = x, y, z


@lean
def predict(features: IntArray, weights: IntArray, out: IntArray) -> None:
    """Write the linear prediction of a block into ``out`` (channels,)."""
    out[:] = 1 << 15
    fours = len(features) // 4 * 4
    for f in range(0, fours, 4):  # four at a time: sums are loaded and stored less often
        first, second, third, fourth = (
            features[f],
            features[f + 1],
            features[f + 2],
            features[f + 3],
        )
        for c in range(len(out)):
            now = first * weights[f, c] + second * weights[f + 1, c]
            now += third * weights[f + 2, c] + fourth * weights[f + 3, c]
            out[c] += now
    for f in range(fours, len(features)):
        for c in range(len(out)):
            out[c] += features[f] * weights[f, c]
    for c in range(len(out)):
        out[c] >>= 16


@compiled
def remember_next(
    state: IntArray,
    frames: int,
    table: IntArray,
    span: int,
    lags: IntArray,
    up: int,
    weights: IntArray,
    stride: int,
    keys: KeyArray,
    follows: FollowArray,
    known: int,
) -> int:
    """Write the moments that ``frames`` decoded frames have beyond the first ``known``.

    Every ``stride`` frames is a moment. Returns how many there are now.
    """
    nodes = len(table)
    features = np.empty(weights.shape[1], np.int64)
    prediction = np.empty(weights.shape[2], np.int64)
    signals = np.zeros((nodes, span, 3), np.int64)
    limit = (1 << 31) - 1
    while known < keys.shape[1] and stride * known + span < frames:
        start, moment = 1 + stride * known, known
        known += 1
        for node in range(nodes):
            if table[node, KIND] == FOLLOWER:
                continue
            row = table[node, ROW]
            signals_at(state, table, node, start, span, signals[node])
            describe(state, table, node, start, span, lags, up, signals, features)
            key_of(features, span, keys[row, moment])
            predict(features, weights[row], prediction)
            for i in range(span):
                for c in range(3):
                    missed = signals[node, i, c] - prediction[3 * i + c]
                    follows[row, moment, 3 * i + c] = min(max(missed, -limit), limit)
    return known


@compiled
def recall(
    key: KeyArray,
    keys: KeyArray,
    follows: FollowArray,
    own_keys: KeyArray,
    own_follows: FollowArray,
    own: int,
    prediction: IntArray,
) -> tuple[int, int, int]:
    """Add what the nearest moments say to ``prediction``; return how sure they are.

    Those of the references, and the first ``own`` of the clip itself.

    Returns (mean absolute deviation of what followed, 2^-20 cm; distance to the nearest and to
    the last neighbour, 1/64 cm). Neighbours weigh 1 / (d² + d_first²)², with 1 added to
    d_first²: one that is far nearer than the others stands nearly alone.
    """
    moments = len(follows)
    near = np.full(NEIGHBOURS, NOWHERE)
    which = np.zeros(NEIGHBOURS, np.int64)
    count = find_nearest(key, keys, own_keys, own, near, which)
    nearest, last = _root(near[0]), _root(near[count - 1])
    followed = np.empty((count, len(prediction)), np.int64)
    for n in range(count):
        at = which[n]
        if at >= moments:
            followed[n] = own_follows[at - moments]
        else:
            followed[n] = follows[at]
    return _blend(near, followed, prediction), nearest, last


@lean
def _blend(near: IntArray, followed: IntArray, prediction: IntArray) -> int:
    """Add the weighted mean of what followed to ``prediction``; return its deviation.

    ``followed``: (neighbours, channels). In ``near`` their weights are left.
    """
    count, channels = followed.shape
    spread = 0
    total = weigh(near, count)
    for c in range(channels):
        mean = 0
        for n in range(count):
            mean += near[n] * followed[n, c]
        mean //= total
        deviation = 0
        for n in range(count):
            deviation += near[n] * abs(followed[n, c] - mean)
        spread += deviation // total
        prediction[c] += mean
    mean_deviation: int = spread // channels
    return mean_deviation


@lean
def weigh(near: IntArray, count: int) -> int:
    """Put weights in the place of the first ``count`` squared distances; return their sum."""
    first, total = near[0] + 1, 0
    for n in range(count):
        part = 2048 * first // (near[n] + first)
        near[n] = part * part
        total += part * part
    return total


@lean
def find_nearest(
    key: KeyArray, keys: KeyArray, own_keys: KeyArray, own: int, near: IntArray, which: IntArray
) -> int:
    """Write the nearest moments and their squared distances; return how many there are.

    Those of the references, and after them the first ``own`` of the clip itself. ``near``
    begins as `NOWHERE`.
    """
    _sort_in(key, keys, len(keys), 0, near, which)
    _sort_in(key, own_keys, own, len(keys), near, which)
    return min(len(keys) + own, NEIGHBOURS)


@lean
def _sort_in(
    key: KeyArray, keys: KeyArray, count: int, first: int, near: IntArray, which: IntArray
) -> None:
    """Sort moments into the nearest so far: squared distances, and numbers from ``first`` on."""
    worst = near[NEIGHBOURS - 1]
    for m in range(count):
        distance = 0
        for k in range(len(key)):  # of a length not known while compiling: it becomes SIMD
            difference = int(keys[m, k]) - int(key[k])
            distance += difference * difference
        if distance >= worst:
            continue
        at = NEIGHBOURS - 1
        while at > 0 and near[at - 1] > distance:
            near[at], which[at] = near[at - 1], which[at - 1]
            at -= 1
        near[at], which[at] = distance, first + m
        worst = near[NEIGHBOURS - 1]


@compiled
def _root(value: int) -> int:
    """Return the whole square root, by Newton's method on whole numbers."""
    if value < 2:
        return value
    root = 1 << 31
    while True:
        better = (root + value // root) >> 1
        if better >= root:
            return root
        root = better
