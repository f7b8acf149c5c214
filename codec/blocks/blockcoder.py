"""The compiled heart of the codec: predict a block, quantise what is left, follow the decoder.

Encoder and decoder walk through a clip block by block, level by level, and call `expect` for
every node: the prediction, and how large the quantised coefficients are expected to be. Then
the decoder reads them, the encoder chooses them, and both call `settle`.
"""

from __future__ import annotations

import math

import numpy as np

from ..arithmetic.compiled import compiled, lean
from ..arithmetic.fixedpoint import between, log2_of, rotated
from ..arithmetic.quaternionlog import vector_to
from ..arithmetic.scaling import signal_of
from ..clip import BoolArray, FloatArray, IntArray
from ..streams.sizeclasses import class_of
from .blockcontext import LEVER_BITS, back, describe, key_of, pose, turn_at
from .motionmodel import GROUPS, SIGNS
from .nodes import AXES, CARRIER, FINE, GUIDE, HINGE, KIND, LEVER, PLACE, ROW, SCALE
from .recall import FollowArray, KeyArray, predict, recall, signals_at

FINENESS = 64  # of a refinement, × 1/256 octave: a quarter octave
MOST_FINE = 24  # refinements: 1/64 of the step


@compiled
def fine_step(step: int, fine: int) -> int:
    """Return a step (2^-24 cm) refined by ``fine`` quarter octaves."""
    quarter = (256, 215, 181, 152)
    return max(((step >> (fine >> 2)) * quarter[fine & 3]) >> 8, 1)


@lean
def activity_of(quantised: IntArray, fine: int) -> int:
    """Return log2 (× 256) of a node's mean quantised size in unrefined steps, plus a floor."""
    total = 0
    for c in range(len(quantised)):
        total += abs(quantised[c])
    return log2_of((16 * total) // len(quantised) + 1) - FINENESS * fine


@compiled
def _in_steps(length: int, step: int) -> int:
    """Return log2 (× 256) of a length (2^-20 cm) in steps (2^-24 cm), plus a floor."""
    return log2_of(((length << 8) // step) + 3)


@compiled
def expect(
    state: IntArray,
    table: IntArray,
    node: int,
    start: int,
    span: int,
    lags: IntArray,
    up: int,
    weights: IntArray,
    base: IntArray,
    senses: IntArray,
    keys: KeyArray,
    follows: FollowArray,
    own_keys: KeyArray,
    own_follows: FollowArray,
    own: int,
    signals: IntArray,
    activity: IntArray,
    top: int,
    path: int,
    step: int,
    fine: int,
    leads: IntArray,
    has: BoolArray,
    led: int,
    prediction: IntArray,
    classes: IntArray,
    signs: IntArray,
) -> None:
    """Write a node's prediction (channels,), the class of each coefficient, and its signs.

    ``activity``: (3, nodes) of this block, the last one and the one before, as by
    `activity_of`; ``step``: unrefined, 2^-24 cm; ``fine``: of the block; ``leads`` and ``has``:
    see `Leads`; ``led``: which of them the block follows, or -1.
    """
    row = table[node, ROW]
    fine += table[node, FINE]
    channels = len(prediction)
    size = fine_step(step, fine)
    shift = FINENESS * fine
    signs[:] = 0
    signs[0] = activity[1, node] + shift
    signs[1] = activity[2, node] + shift
    if table[node, GUIDE] >= 0:
        signs[2] = activity[0, table[node, GUIDE]] + shift
    if table[node, CARRIER] >= 0 and node != top:
        signs[3] = ((activity[0, top] + activity[0, path]) >> 1) + shift
    if led >= 0 and has[led, node]:
        followed = np.empty((span, 3), np.int64)
        signals_at(leads[led], table, node, 1, span, followed)
        for c in range(channels):
            prediction[c] = followed[c // 3, c % 3]
        for k in range(4, 9):
            signs[k] = _in_steps(0, size)  # as sure as recall ever is, of something at rest
        signs[9] = 256
    else:
        _foresee(
            state, table, node, start, span, lags, up, weights[row], keys[row], follows[row],
            own_keys[row], own_follows[row], own, signals, size, prediction, signs,
        )  # fmt: skip
    third = max(channels // GROUPS, 1)
    for group in range(GROUPS):
        level = 0
        for k in range(SIGNS):
            level += senses[row, group, k] * signs[k]
        level >>= 8
        stop = channels if group == GROUPS - 1 else third * (group + 1)
        for c in range(third * group, stop):
            classes[c] = class_of(base[row, c] + level)


@compiled
def _foresee(
    state: IntArray,
    table: IntArray,
    node: int,
    start: int,
    span: int,
    lags: IntArray,
    up: int,
    weights: IntArray,
    keys: KeyArray,
    follows: FollowArray,
    own_keys: KeyArray,
    own_follows: FollowArray,
    own: int,
    signals: IntArray,
    size: int,
    prediction: IntArray,
    signs: IntArray,
) -> None:
    """Write a node's prediction from what it did and what is recalled, and the signs of that.

    ``weights``, ``keys``, … : those of the node's row; ``size``: the step, refined, 2^-24 cm.
    """
    features = np.empty(weights.shape[0], np.int64)
    describe(state, table, node, start, span, lags, up, signals, features)
    predict(features, weights, prediction)
    speed = 0
    for f in range(12):
        speed += abs(features[f])
    signs[4] = _in_steps(speed // 12, size)
    if len(keys) + own > 0:
        key = np.empty(keys.shape[1], np.int16)
        key_of(features, span, key)
        spread, nearest, last = recall(key, keys, follows, own_keys, own_follows, own, prediction)
        signs[6] = _in_steps(spread, size)
        signs[7] = _in_steps(nearest << 14, size)
        signs[8] = _in_steps(last << 14, size)
        signs[9] = 256
    length = 0
    for c in range(len(prediction)):
        length += abs(prediction[c])
    signs[5] = _in_steps(length // len(prediction), size)


@lean
def settle(
    state: IntArray,
    table: IntArray,
    node: int,
    start: int,
    span: int,
    basis: IntArray,
    prediction: IntArray,
    quantised: IntArray,
    step: int,
    fine: int,
    signals: IntArray,
    activity: IntArray,
) -> None:
    """Write a node's decoded signals and frames from its quantised coefficients."""
    row = table[node, ROW]
    channels = len(prediction)
    fine += table[node, FINE]
    size = fine_step(step, fine)
    for c in range(channels):
        total = 0
        for k in range(channels):
            if quantised[k] != 0:
                total += quantised[k] * basis[row, k, c]
        signals[node, c // 3, c % 3] = prediction[c] + ((total * size + (1 << 17)) >> 18)
    pose(state, table, node, start, span, signals)
    activity[0, node] = activity_of(quantised, fine)


@lean
def wanted(
    state: IntArray,
    aims: IntArray,
    table: IntArray,
    node: int,
    start: int,
    out: IntArray,
) -> None:
    """Write the signals (channels,) that would bring a node to ``aims`` (span, 4)."""
    last = start - 1
    lever, axes = table[node, LEVER], table[node, AXES]
    for i in range(len(aims)):
        if table[node, KIND] == PLACE:
            dx = aims[i, 0] - state[last, node, 0]
            dy = aims[i, 1] - state[last, node, 1]
            dz = aims[i, 2] - state[last, node, 2]
            x, y, z = dx, dy, dz
            if axes >= 0:
                # turning there and back is not exact: jumps of a kilometre need a second look
                turn = turn_at(state, last, axes)
                x, y, z = 0, 0, 0
                for _ in range(3):
                    a, b, c = rotated(turn, x, y, z)
                    a, b, c = rotated(back(turn), dx - a, dy - b, dz - c)
                    x, y, z = x + a, y + b, z + c
            out[3 * i] = (x * lever) >> LEVER_BITS
            out[3 * i + 1] = (y * lever) >> LEVER_BITS
            out[3 * i + 2] = (z * lever) >> LEVER_BITS
            continue
        before, aim = turn_at(state, last, node), (aims[i, 0], aims[i, 1], aims[i, 2], aims[i, 3])
        if table[node, KIND] == HINGE:
            guide = table[node, GUIDE]
            before = between(turn_at(state, last, guide), before)
            aim = between(turn_at(state, start + i, guide), aim)
        x, y, z = vector_to(between(before, aim))
        x, y, z = signal_of(table[node, SCALE:], x, y, z)
        out[3 * i], out[3 * i + 1], out[3 * i + 2] = round(x), round(y), round(z)


@lean
def choose(
    left: IntArray,
    rest: FloatArray,
    basis: IntArray,
    analysis: FloatArray,
    size: int,
    classes: IntArray,
    ones: FloatArray,
    more: FloatArray,
    thrift: float,
    quantised: IntArray,
) -> None:
    """Write quantised coefficients of what prediction left (channels,).

    A coefficient is rounded down where the bits that this saves (``ones``: bits of ±1 rather
    than 0, ``more``: of each one more, by class) times ``thrift`` outweigh the larger squared
    error, in steps²: rate-distortion optimised rounding. ``basis`` and ``analysis``: the row's,
    of `MotionModel`; ``size``: the step, 2^-24 cm; ``rest``: (channels,) room to work in.
    """
    channels = len(left)
    for c in range(channels):
        rest[c] = left[c]
    quantised[:] = 0
    for attempt in range(4):
        changed = False
        for k in range(channels):
            total = 0.0
            for c in range(channels):
                total += analysis[k, c] * rest[c]
            z = total / float(1 << 10) / size  # 2^14 of the analysis, 2^-20 to 2^-24 of the step
            low = math.floor(abs(z))
            part = abs(z) - low
            step_up = 0.5
            if attempt == 0:
                kind = classes[k]
                step_up += 0.5 * thrift * (ones[kind] if low == 0 else more[kind])
            whole = low + 1 if part >= step_up else low
            if attempt > 0 and abs(z) < 1.0:
                whole = 0
            if whole > 0:
                quantised[k] += whole if z > 0 else -whole
                changed = changed or whole > 60
        if not changed:
            break
        # the basis is rounded: large coefficients leave a rest that is worth another look
        for c in range(channels):
            total = 0.0
            for k in range(channels):
                total += float(quantised[k]) * basis[k, c]
            rest[c] = left[c] - total * size / float(1 << 18)
