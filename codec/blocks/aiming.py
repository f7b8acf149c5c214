"""What the encoder aims a node at, given what the errors above it have done.

Joints hang on each other, so that errors of a shoulder, an arm and a wrist would add up in the
hand. The encoder sees the decoded shoulder before it codes the arm: it aims the arm not at its
own true orientation but at the one that brings the points that hang on it, and its shell,
nearest to where they should be. The decoder knows nothing of it.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from ..arithmetic.compiled import compiled, lean
from ..arithmetic.fixedpoint import ANGLE_BITS, ONE, Turn, between, product, turn_of, unit
from ..arithmetic.quaternionlog import vector_to
from ..arithmetic.scaling import LENGTH_BITS
from ..clip import FloatArray, IntArray, Skeleton
from ..geometry.kinematics import SHELL_INERTIA
from .blockcontext import turn_at
from .nodes import FOLLOWER, GUIDE, HINGE, JOINT, KIND, TURN, Nodes

MENDED = 0.9  # of an error: at coarse steps, all of it costs more bits than it saves
MOST_TURNED = 0.3  # radians
BALL = 0.01  # of the squared turns about the main axis: what counts as one more
STIFF = 1e-9  # squared radians a frame: a joint that turns less has no axis
UNIT = float(1 << LENGTH_BITS)
Spot: TypeAlias = tuple[float, float, float]
MEND_COLUMNS = 21  # gain (3 × 3), inertia (3 × 3), first moment (3)


def mends_of(
    skeleton: Skeleton, nodes: Nodes, shape: IntArray, offsets: FloatArray, goal: IntArray
) -> FloatArray:
    """Return what each node (nodes, 21) needs to make up for errors; zeros: it makes up for none.

    The rotation d, in the joint's axes, that brings points at o of mass m nearest to where e
    would move them solves M d = Σ m o × e, with M their inertia and that of the shell. Columns:
    a gain G, M and Σ m o. G is M⁻¹ for turns, A (Aᵀ M A)⁻¹ Aᵀ for a hinge with axes A: one, or
    more if joints were made hinges that are none.
    ``shape`` and ``offsets``: see `yardstick.Yardstick`; ``goal``: (frames, nodes, 4).
    """
    joints, kinds = skeleton.joints, nodes.table[:, KIND]
    mass = np.ones(len(shape))
    inertia = np.tile(SHELL_INERTIA * np.eye(3), (joints, 1, 1))
    moment = np.zeros((joints, 3))
    for point in range(len(shape) - 1, 0, -1):
        parent, arm = shape[point, 0], offsets[point]
        if parent < 0 or shape[point, 3] == 1:
            continue
        inertia[parent] += mass[point] * ((arm @ arm) * np.eye(3) - np.outer(arm, arm))
        moment[parent] += mass[point] * arm
        if kinds[shape[parent, 1]] == FOLLOWER:
            mass[parent] += mass[point]  # it turns with its own parent
    out = np.zeros((nodes.count, MEND_COLUMNS))
    for node, row in enumerate(nodes.table):
        joint = row[JOINT]
        gain = np.zeros((3, 3))
        if row[KIND] == TURN and node != nodes.top:  # the first turn is coded before its place
            gain = np.linalg.inv(inertia[joint])
        if row[KIND] == HINGE:
            axes = _axes(goal, node, int(row[GUIDE]))
            gain = axes @ np.linalg.inv(axes.T @ inertia[joint] @ axes) @ axes.T
        if gain.any():
            out[node] = np.concatenate([gain.ravel(), inertia[joint].ravel(), moment[joint]])
    return out


def _axes(goal: IntArray, node: int, guide: int) -> FloatArray:
    """Return the axes (3, up to 3) that a hinge bends about; none if it does not bend."""
    sizes, axes = np.linalg.eigh(_bends(goal, node, guide))
    return np.asarray(axes[:, sizes > max(STIFF * len(goal), BALL * sizes[2])])


@compiled
def _bends(goal: IntArray, node: int, guide: int) -> FloatArray:
    """Return the sum (3, 3) of the outer squares of a hinge's turns since the first frame."""
    total = np.zeros((3, 3))
    bend = np.empty(3)
    for frame in range(1, len(goal)):
        first = between(turn_at(goal, 0, guide), turn_at(goal, 0, node))
        now = between(turn_at(goal, frame, guide), turn_at(goal, frame, node))
        bend[0], bend[1], bend[2] = vector_to(between(first, now))
        for i in range(3):
            for j in range(3):
                total[i, j] += bend[i] * bend[j]
    return total


@lean
def aim(
    state: IntArray,
    goal: IntArray,
    table: IntArray,
    node: int,
    start: int,
    points: FloatArray,
    shape: IntArray,
    offsets: FloatArray,
    mends: FloatArray,
    out: IntArray,
) -> None:
    """Write what a node should be in a block, (span, 4), all above it being decoded.

    ``goal``: (frames, nodes, 4) what it should be if nothing were amiss; ``points``: (frames,
    joints + end sites, 3) where they should be; beyond their end the last one counts.
    """
    mend, guide = mends[node], table[node, GUIDE]
    for i in range(len(out)):
        frame = start + i
        true = turn_at(goal, frame, node)
        turn = true
        if table[node, KIND] in (HINGE, FOLLOWER) and guide >= 0:  # what it holds is the angle
            held = between(turn_at(goal, frame, guide), true)
            turn = product(turn_at(state, frame, guide), held)
        if mend[0] != 0.0 or mend[4] != 0.0 or mend[8] != 0.0:
            joint, known = table[node, JOINT], min(frame, len(points) - 1)
            x, y, z = spot_at(state, frame, joint, shape, offsets)
            off = (
                points[known, joint, 0] - x,
                points[known, joint, 1] - y,
                points[known, joint, 2] - z,
            )
            turn = _mended(turn, true, off, mend)
        for c in range(4):
            out[i, c] = turn[c]


@lean
def _mended(turn: Turn, true: Turn, off: Spot, mend: FloatArray) -> Turn:
    """Return ``turn`` turned so that what hangs on it moves by ``off``, centimetres."""
    ex, ey, ez = along((true[0], -true[1], -true[2], -true[3]), off[0], off[1], off[2])
    sx, sy, sz = mend[18], mend[19], mend[20]
    ax, ay, az = vector_to(between(true, turn))
    tx = sy * ez - sz * ey - (mend[9] * ax + mend[10] * ay + mend[11] * az)
    ty = sz * ex - sx * ez - (mend[12] * ax + mend[13] * ay + mend[14] * az)
    tz = sx * ey - sy * ex - (mend[15] * ax + mend[16] * ay + mend[17] * az)
    dx = mend[0] * tx + mend[1] * ty + mend[2] * tz
    dy = mend[3] * tx + mend[4] * ty + mend[5] * tz
    dz = mend[6] * tx + mend[7] * ty + mend[8] * tz
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    scale = float(1 << ANGLE_BITS) * MENDED * min(1.0, MOST_TURNED / max(length, MOST_TURNED))
    return unit(product(turn, turn_of(round(dx * scale), round(dy * scale), round(dz * scale))))


@lean
def spot_at(state: IntArray, frame: int, joint: int, shape: IntArray, offsets: FloatArray) -> Spot:
    """Return where the decoded turns and places above a joint put it, centimetres."""
    a, b, c = 0.0, 0.0, 0.0
    while joint >= 0:
        parent, place = shape[joint, 0], shape[joint, 2]
        x, y, z = offsets[joint, 0], offsets[joint, 1], offsets[joint, 2]
        if place >= 0:
            x, y, z = (
                state[frame, place, 0] / UNIT,
                state[frame, place, 1] / UNIT,
                state[frame, place, 2] / UNIT,
            )
        if shape[joint, 3] == 1:
            parent = -1
        if parent >= 0:
            x, y, z = along(turn_at(state, frame, shape[parent, 1]), x, y, z)
        a, b, c = a + x, b + y, c + z
        joint = parent
    return a, b, c


@compiled
def along(turn: Turn, x: float, y: float, z: float) -> Spot:
    """Return a vector turned by ``turn``."""
    w, i, j, k = turn[0] / ONE, turn[1] / ONE, turn[2] / ONE, turn[3] / ONE
    u, v, t = 2.0 * (j * z - k * y), 2.0 * (k * x - i * z), 2.0 * (i * y - j * x)
    return x + w * u + j * t - k * v, y + w * v + k * u - i * t, z + w * t + i * v - j * u
