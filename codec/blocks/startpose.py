"""The first pose of a run of frames, against a known pose.

The pose that it is most like among those of the reference clips, or else the family's usual
one, is laid under it joint by joint, parents first, so that only the difference is coded.
"""

from __future__ import annotations

import math

import numpy as np

from ..arithmetic.compiled import compiled, lean
from ..arithmetic.fixedpoint import ONE, Turn, between, log2_of, product, turn_of, unit
from ..arithmetic.quaternionlog import vector_to
from ..arithmetic.scaling import signal_of, to_angles
from ..clip import FloatArray, IntArray
from ..figure.rig import CENTRE_SCALE, Family, Rig
from ..geometry.quaternions import multiply
from ..streams.sizeclasses import class_costs, class_of
from .aiming import aim
from .blockcoder import fine_step
from .blockcontext import turn_at
from .leads import LEAD_CLASS
from .motionmodel import MotionModel
from .nodes import FINE, FOLLOWER, GUIDE, KIND, LEVER, PLACE, ROW, SCALE, Nodes
from .yardstick import Yardstick

POSE_STRIDE = 8  # frames between the poses that a reference clip offers
FOLLOWER_FINE = 12  # quarter octaves


def usual_pose(rig: Rig, family: Family) -> IntArray:
    """Return the usual pose (rows, 4): each joint at its centre, standing at the origin."""
    skeleton = rig.skeleton
    rows = np.zeros((2 * skeleton.joints, 4), np.int64)
    turns: dict[int, tuple[int, int, int, int]] = {}
    for part in family.parts:
        above = (ONE, 0, 0, 0)
        if part.parent >= 0:
            above = turns[family.parts[part.parent].reference]
        for joint in part.joints:
            centre = family.centres[joint].tolist()
            w, x, y, z = ((value * ONE) // CENTRE_SCALE for value in centre)
            turns[joint] = product(above, unit(unit((w, x, y, z))))
    for joint, turn in turns.items():
        rows[joint] = turn
        rows[skeleton.joints + joint, :3] = np.rint(skeleton.offsets[joint] * (1 << 20))
    return rows


def poses_of(state: IntArray, frames: int, nodes: Nodes, rows: int) -> IntArray:
    """Return the poses (poses, rows, 4) that a decoded run offers."""
    chosen = state[0:frames:POSE_STRIDE]
    out = np.zeros((len(chosen), rows, 4), np.int64)
    out[:, nodes.table[:, ROW]] = chosen
    return out


@compiled
def start_size(step: int, fine: int, kind: int) -> int:
    """Return the step (2^-24 cm) of a node's first frame.

    A follower's is finer: its error stays through the clip, whatever the blocks do.
    """
    return fine_step(step, fine + FOLLOWER_FINE if kind == FOLLOWER else fine)


def start_classes(
    nodes: Nodes, model: MotionModel, pose: int, step: int, fine: int, led: bool
) -> IntArray:
    """Return the class (nodes, 3) of every number of a first pose.

    ``pose``: number of the known pose; ``led``: whether it is that of a lead.
    """
    if led:
        return np.full((nodes.count, 3), LEAD_CLASS, np.int64)
    in_steps = model.starts[nodes.table[:, ROW], int(pose > 0)]
    kinds = nodes.table[:, [KIND, FINE]].tolist()
    sizes = [start_size(step, fine + own, kind) for kind, own in kinds]
    in_steps = in_steps - np.array([[log2_of(size) - (24 << 8)] for size in sizes], np.int64)
    return np.array([[class_of(value) for value in row] for row in in_steps.tolist()], np.int64)


@lean
def lay(state: IntArray, node: int, table: IntArray, pose: IntArray, usual: IntArray) -> Turn:
    """Return where ``pose`` (rows, 4) expects a node, given its guide's decoded first frame."""
    row, guide = table[node, ROW], table[node, GUIDE]
    known = pose
    if table[node, KIND] == PLACE:
        if not pose[row].any():
            known = usual
        if guide >= 0 and table[guide, KIND] == PLACE:
            other = table[guide, ROW]
            return (
                state[0, guide, 0] + known[row, 0] - known[other, 0],
                state[0, guide, 1] + known[row, 1] - known[other, 1],
                state[0, guide, 2] + known[row, 2] - known[other, 2],
                0,
            )
        return known[row, 0], known[row, 1], known[row, 2], 0
    if not pose[row].any() or (guide >= 0 and not pose[table[guide, ROW]].any()):
        known = usual
    own = (known[row, 0], known[row, 1], known[row, 2], known[row, 3])
    if guide < 0:
        return own
    other = table[guide, ROW]
    above = (known[other, 0], known[other, 1], known[other, 2], known[other, 3])
    now = (state[0, guide, 0], state[0, guide, 1], state[0, guide, 2], state[0, guide, 3])
    return unit(product(now, between(above, own)))


@lean
def start_node(
    state: IntArray,
    node: int,
    table: IntArray,
    pose: IntArray,
    usual: IntArray,
    quantised: IntArray,
    step: int,
    fine: int,
) -> None:
    """Write a node's decoded first frame from its quantised difference (3,)."""
    expected = lay(state, node, table, pose, usual)
    lever = table[node, LEVER]
    size = start_size(step, fine + table[node, FINE], table[node, KIND])
    # 2^-24 cm times whole numbers, in 2^-20 cm
    x = (quantised[0] * size) >> 4
    y = (quantised[1] * size) >> 4
    z = (quantised[2] * size) >> 4
    if table[node, KIND] == PLACE:
        state[0, node, 0] = expected[0] + (x << 4) // lever
        state[0, node, 1] = expected[1] + (y << 4) // lever
        state[0, node, 2] = expected[2] + (z << 4) // lever
        return
    x, y, z = to_angles(table[node, SCALE:], x, y, z)
    turn = unit(product(expected, turn_of(x, y, z)))
    for c in range(4):
        state[0, node, c] = turn[c]


def choose_start(
    goal: IntArray,
    nodes: Nodes,
    yardstick: Yardstick,
    pose: IntArray,
    usual: IntArray,
    step: int,
    fine: int,
    classes: IntArray,
    thrift: float,
) -> tuple[IntArray, IntArray]:
    """Return the first pose (1, nodes, 4) as decoded, and its quantised differences (nodes, 3).

    ``goal``: (1 or more, nodes, 4); ``pose`` and ``usual``: (rows, 4); ``classes``: (nodes, 3)
    as by `start_classes`; ``thrift``: see `blockcoder.choose`. Followers are not rounded down,
    since their error stays.
    """
    state = np.zeros((1, nodes.count, 4), np.int64)
    out = np.zeros((nodes.count, 3), np.int64)
    _, ones, more = class_costs()
    _choose_start(
        goal,
        nodes.table,
        pose,
        usual,
        step,
        fine,
        yardstick.points,
        yardstick.shape,
        yardstick.offsets,
        yardstick.mends,
        classes,
        ones,
        more,
        thrift / (1.0 + fine),
        state,
        out,
    )
    return state, out


@compiled
def _choose_start(
    goal: IntArray,
    table: IntArray,
    pose: IntArray,
    usual: IntArray,
    step: int,
    fine: int,
    points: FloatArray,
    shape: IntArray,
    offsets: FloatArray,
    mends: FloatArray,
    classes: IntArray,
    ones: FloatArray,
    more: FloatArray,
    thrift: float,
    state: IntArray,
    out: IntArray,
) -> None:
    aims = np.empty((1, 4), np.int64)
    off = np.empty(3)
    for node in range(len(table)):
        aim(state, goal, table, node, 0, points, shape, offsets, mends, aims)
        unit_steps = float(start_size(step, fine + table[node, FINE], table[node, KIND])) / 16.0
        expected = lay(state, node, table, pose, usual)
        lever = table[node, LEVER]
        if table[node, KIND] == PLACE:
            for c in range(3):
                off[c] = float(aims[0, c] - expected[c]) * lever / 16.0
        else:
            x, y, z = vector_to(between(expected, turn_at(aims[None], 0, 0)))
            off[0], off[1], off[2] = signal_of(table[node, SCALE:], x, y, z)
        for c in range(3):
            size = abs(off[c]) / unit_steps
            low = math.floor(size)
            kind = classes[node, c]
            cost = ones[kind] if low == 0 else more[kind]
            down = 0.0 if table[node, KIND] == FOLLOWER else 0.5 * thrift * cost
            whole = low + 1 if size - low >= 0.5 + down else low
            out[node, c] = whole if off[c] > 0.0 else -whole
        start_node(state, node, table, pose, usual, out[node], step, fine)


def nearest_pose(goal: IntArray, nodes: Nodes, poses: IntArray) -> int:
    """Return the number of the pose that ``goal`` (nodes, 4) is most like."""
    return int(pose_distances(goal, nodes, poses).argmin())


def pose_distances(goal: IntArray, nodes: Nodes, poses: IntArray) -> FloatArray:
    """Return how far each pose (poses, rows, 4) is from ``goal`` (nodes, 4), its heading aside.

    Infinite for the first, the usual one, if there are others; squared angles times levers.
    """
    first = np.full(1, 0.0 if len(poses) == 1 else np.inf)
    table = nodes.table
    turns = np.flatnonzero((table[:, KIND] != PLACE) & (table[:, GUIDE] >= 0))
    if not len(turns):
        return np.concatenate([first, np.zeros(len(poses) - 1)])
    own = _relative(goal[None, turns], goal[None, table[turns, GUIDE]])
    rows, guides = table[turns, ROW], table[table[turns, GUIDE], ROW]
    theirs = _relative(poses[1:, rows], poses[1:, guides])
    off = 1.0 - np.abs((own * theirs).sum(axis=2))
    return np.concatenate([first, (off * np.square(table[turns, LEVER])).sum(axis=1)])


def _relative(own: IntArray, above: IntArray) -> FloatArray:
    """Return quaternions (…, 4) of ``own`` in the axes of ``above``."""
    return multiply(above / ONE * np.array([1.0, -1.0, -1.0, -1.0]), own / ONE)
