"""What encoder and decoder both know of a node before its next block of frames is coded.

A node's *features* are lengths in its own axes at the last decoded frame, scaled like its
signal: its own past, its pose, what its guide (the joint or marker that it hangs on) and the
root's path do in this very block, and which way is up. Predictions are linear in them, and
retrieval compares a few of them. All whole numbers, in units of 2^-20 cm.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..arithmetic.compiled import compiled, lean
from ..arithmetic.fixedpoint import (
    ONE,
    TURN_BITS,
    Turn,
    Vector,
    between,
    product,
    rotated,
    turn_of,
    unit,
    vector_of,
)
from ..arithmetic.scaling import FROM_ANGLES, FROM_TURNS, LENGTH_BITS, to_angles, to_lengths
from ..clip import IntArray
from .nodes import AXES, CARRIER, FOLLOWER, GUIDE, HINGE, KIND, LEVER, PLACE, SCALE

UNIT_BITS = LENGTH_BITS
LEVER_BITS = 4
LAGS = 4
POSE_CENTIMETRES = 10  # a radian of the pose feature counts for so much
UP_CENTIMETRES = 20
FEATURE_LIMIT = 1 << 38
TO_FEATURE = TURN_BITS - UNIT_BITS
KEYS = 24  # components that retrieval compares
KEY_SHIFT = 18  # keys are in 1/64 cm after weights in 1/16
# Weights, in 1/16, of what retrieval compares: velocity, acceleration, pose, up, the guide's way
# through the block and its bend, the carrier's.
_KEY_WEIGHTS: IntArray = np.array([24, 24, 8, 6, 10, 26, 2, 20], np.int64)


def feature_count(span: int) -> int:
    """Return how many features a node has for blocks of ``span`` frames."""
    return 31 + 6 * span


@compiled
def turn_at(state: IntArray, frame: int, node: int) -> Turn:
    """Return a turn of the state (frames, nodes, 4)."""
    return (
        state[frame, node, 0],
        state[frame, node, 1],
        state[frame, node, 2],
        state[frame, node, 3],
    )


@compiled
def back(a: Turn) -> Turn:
    """Return the rotation that undoes ``a``."""
    return a[0], -a[1], -a[2], -a[3]


@compiled
def turned_by(state: IntArray, node: int, last: int, frame: int) -> Vector:
    """Return how a turn differs at ``frame`` from ``last``, in its axes there, radians × 2^30."""
    return vector_of(between(turn_at(state, last, node), turn_at(state, frame, node)))


@compiled
def bent_by(state: IntArray, node: int, guide: int, last: int, frame: int) -> Vector:
    """Return the same of a turn as its guide sees it."""
    before = between(turn_at(state, last, guide), turn_at(state, last, node))
    after = between(turn_at(state, frame, guide), turn_at(state, frame, node))
    return vector_of(between(before, after))


@lean
def moved_in_lengths(state: IntArray, table: IntArray, node: int, last: int, frame: int) -> Vector:
    """Return the signal (2^-20 cm) that a node's motion from ``last`` to ``frame`` is.

    A place's is not yet turned into its axes.
    """
    if table[node, KIND] == PLACE:
        return moved_by(state, node, last, frame, table[node, LEVER])
    if table[node, KIND] == HINGE:
        x, y, z = bent_by(state, node, table[node, GUIDE], last, frame)
    else:
        x, y, z = turned_by(state, node, last, frame)
    return to_lengths(table[node, SCALE:], x, y, z, FROM_TURNS)


@compiled
def moved_by(state: IntArray, node: int, last: int, frame: int, lever: int) -> Vector:
    """Return how a place differs at ``frame`` from ``last``, in the axes of its state."""
    return (
        ((state[frame, node, 0] - state[last, node, 0]) * lever) >> LEVER_BITS,
        ((state[frame, node, 1] - state[last, node, 1]) * lever) >> LEVER_BITS,
        ((state[frame, node, 2] - state[last, node, 2]) * lever) >> LEVER_BITS,
    )


@lean
def describe(
    state: IntArray,
    table: IntArray,
    node: int,
    start: int,
    span: int,
    lags: IntArray,
    up: int,
    signals: IntArray,
    out: IntArray,
) -> None:
    """Write the features of ``node`` for the block from frame ``start`` into ``out``.

    ``state``: (frames, nodes, 4) decoded turns, and places in their first three; ``signals``:
    (nodes, frames of a block, 3) of the levels above in this block; ``lags``: (4,) frames to
    look back from the last one; ``up``: the world's vertical axis.
    """
    last = start - 1
    axes = table[node, AXES]
    place = table[node, KIND] == PLACE
    guide, carrier = table[node, GUIDE], table[node, CARRIER]
    out[:] = 0
    inverse = (ONE, 0, 0, 0)
    if axes >= 0:
        inverse = back(turn_at(state, last, axes))
    at = 0
    for k in range(LAGS):
        frame = max(last - lags[k], 0)
        x, y, z = moved_in_lengths(state, table, node, last, frame)
        if place and axes >= 0:
            x, y, z = rotated(inverse, x, y, z)
        out[at], out[at + 1], out[at + 2] = x, y, z
        at += 3
    if guide >= 0 and not place:
        x, y, z = vector_of(between(turn_at(state, last, guide), turn_at(state, last, node)))
        out[at] = (x * POSE_CENTIMETRES) >> TO_FEATURE
        out[at + 1] = (y * POSE_CENTIMETRES) >> TO_FEATURE
        out[at + 2] = (z * POSE_CENTIMETRES) >> TO_FEATURE
    at += 3
    if guide >= 0:
        _follow(state, table, node, guide, True, inverse, last, span, lags, signals, out, at)
    at += 3 * span + 6
    if carrier >= 0:
        current = node != table[carrier, AXES]
        _follow(state, table, node, carrier, current, inverse, last, span, lags, signals, out, at)
    at += 3 * span + 6
    if axes >= 0:
        x, y, z = rotated(
            inverse,
            UP_CENTIMETRES << UNIT_BITS if up == 0 else 0,
            UP_CENTIMETRES << UNIT_BITS if up == 1 else 0,
            UP_CENTIMETRES << UNIT_BITS if up == 2 else 0,
        )
        out[at], out[at + 1], out[at + 2] = x, y, z
    out[at + 3] = POSE_CENTIMETRES << UNIT_BITS
    for i in range(len(out)):
        out[i] = min(max(out[i], -FEATURE_LIMIT), FEATURE_LIMIT)


@lean
def _follow(
    state: IntArray,
    table: IntArray,
    node: int,
    other: int,
    current: bool,
    inverse: Turn,
    last: int,
    span: int,
    lags: IntArray,
    signals: IntArray,
    out: IntArray,
    at: int,
) -> None:
    """Write what ``other`` does in this block, and did in two frames before, in node's axes."""
    # a turn's motion counts for a turn by what it would do there, for a place as it is
    turns = table[node, KIND] != PLACE and table[other, KIND] != PLACE
    hinge = table[other, KIND] == HINGE
    own, theirs = table[node, SCALE:], table[other, SCALE:]
    from_axes = table[other, AXES]
    across = inverse
    if from_axes >= 0:
        across = product(inverse, turn_at(state, last, from_axes))
    if current:
        for i in range(span):
            x, y, z = signals[other, i, 0], signals[other, i, 1], signals[other, i, 2]
            if turns and hinge:  # its signals are not those of its turn in the world
                x, y, z = turned_by(state, other, last, last + 1 + i)
                x, y, z = x >> 2, y >> 2, z >> 2
            elif turns:
                x, y, z = to_angles(theirs, x, y, z)
            x, y, z = rotated(across, x, y, z)
            if turns:
                x, y, z = to_lengths(own, x, y, z, FROM_ANGLES)
            out[at + 3 * i], out[at + 3 * i + 1], out[at + 3 * i + 2] = x, y, z
    at += 3 * span
    for k in range(2):
        frame = max(last - lags[k], 0)
        if table[other, KIND] != PLACE:
            x, y, z = turned_by(state, other, last, frame)
            if not turns:
                x, y, z = to_lengths(theirs, x, y, z, FROM_TURNS)
            x, y, z = rotated(across, x, y, z)
            if turns:
                x, y, z = to_lengths(own, x, y, z, FROM_TURNS)
        else:
            x, y, z = moved_by(state, other, last, frame, table[other, LEVER])
            x, y, z = rotated(inverse, x, y, z)
        out[at + 3 * k], out[at + 3 * k + 1], out[at + 3 * k + 2] = x, y, z


@lean
def key_of(features: IntArray, span: int, out: npt.NDArray[np.int16]) -> None:
    """Write what retrieval compares, (24,) in 1/64 cm, into ``out``."""
    guide = 15
    carrier = guide + 3 * span + 6
    upward = carrier + 3 * span + 6
    end, middle = 3 * (span - 1), 3 * (span // 2 - 1)
    for c in range(3):
        bend_guide = features[guide + middle + c] - features[guide + end + c] // 2
        bend_carrier = features[carrier + middle + c] - features[carrier + end + c] // 2
        out[c] = _weighed(features[c], 0)
        out[3 + c] = _weighed(features[3 + c] - 2 * features[c], 1)
        out[6 + c] = _weighed(features[12 + c], 2)
        out[9 + c] = _weighed(features[upward + c], 3)
        out[12 + c] = _weighed(features[guide + end + c], 4)
        out[15 + c] = _weighed(bend_guide, 5)
        out[18 + c] = _weighed(features[carrier + end + c], 6)
        out[21 + c] = _weighed(bend_carrier, 7)


@lean
def _weighed(length: int, which: int) -> int:
    """Return a length as one of the kinds of numbers that retrieval compares."""
    key: int = min(max((length * _KEY_WEIGHTS[which]) >> KEY_SHIFT, -32767), 32767)
    return key


@lean
def pose(
    state: IntArray, table: IntArray, node: int, start: int, span: int, signals: IntArray
) -> None:
    """Write a node's frames of the block from ``start`` into the state, from its signals."""
    last = start - 1
    lever = table[node, LEVER]
    axes = table[node, AXES]
    kind = table[node, KIND]
    if kind == FOLLOWER:
        guide = table[node, GUIDE]
        for i in range(span):
            turn = turn_at(state, 0, node)
            if guide >= 0:
                held = between(turn_at(state, 0, guide), turn)
                turn = unit(product(turn_at(state, start + i, guide), held))
            for c in range(4):
                state[start + i, node, c] = turn[c]
    elif kind != PLACE:
        guide = table[node, GUIDE]
        before = turn_at(state, last, node)
        if kind == HINGE:
            before = between(turn_at(state, last, guide), before)
        scale = table[node, SCALE:]
        for i in range(span):
            x, y, z = to_angles(
                scale, signals[node, i, 0], signals[node, i, 1], signals[node, i, 2]
            )
            turn = unit(product(before, turn_of(x, y, z)))
            if kind == HINGE:
                turn = unit(product(turn_at(state, start + i, guide), turn))
            for c in range(4):
                state[start + i, node, c] = turn[c]
    else:
        for i in range(span):
            x = (signals[node, i, 0] << LEVER_BITS) // lever
            y = (signals[node, i, 1] << LEVER_BITS) // lever
            z = (signals[node, i, 2] << LEVER_BITS) // lever
            if axes >= 0:
                x, y, z = rotated(turn_at(state, last, axes), x, y, z)
            state[start + i, node, 0] = state[last, node, 0] + x
            state[start + i, node, 1] = state[last, node, 1] + y
            state[start + i, node, 2] = state[last, node, 2] + z
