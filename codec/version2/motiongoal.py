"""A clip on its way into the codec: whole-number turns and places, and what measures them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arithmetic.fixedpoint import to_turns
from ..blocks.aiming import MEND_COLUMNS, mends_of
from ..blocks.blockcoder import MOST_FINE
from ..blocks.blockcontext import UNIT_BITS
from ..blocks.nodes import (
    FINE,
    JOINT,
    KIND,
    PLACE,
    Nodes,
    holding_levers,
    marker_nodes,
    skeleton_nodes,
)
from ..blocks.yardstick import Yardstick, marker_shape, skeleton_shape
from ..clip import Clip, IntArray, MarkerClip, SkeletonClip
from ..figure.rig import LEVER_SCALE, Family, Rig
from ..figure.sliding import sliding_joints
from ..geometry.gaps import filled
from ..geometry.kinematics import end_positions, world_positions, world_rotations
from ..geometry.limits import Limits
from ..geometry.rotations import to_quaternions

QUARTER = 0.25  # octaves: the unit of fineness
STILL_SHARE = 0.02  # of the tolerance: what a joint may turn (times its lever) and be a follower


@dataclass(frozen=True, eq=False)
class Goal:
    """What the encoder aims at: ``path`` (frames, nodes, 4) of the clip's nodes.

    ``still`` and ``sliding``: joints, as `nodes.skeleton_nodes` takes them.
    """

    nodes: Nodes
    still: tuple[int, ...]
    sliding: tuple[int, ...]
    path: IntArray
    yardstick: Yardstick

    @property
    def fines(self) -> tuple[int, ...]:
        """How much finer each node is coded, see `nodes.FINE`; empty if none is."""
        fines = self.nodes.table[:, FINE]
        return tuple(fines.tolist()) if fines.any() else ()

    def run(self, start: int, stop: int) -> tuple[IntArray, Yardstick]:
        """Return the goal and the yardstick of some of the frames."""
        return self.path[start:stop], self.yardstick.cut(start, stop)


def goal_of(clip: Clip, rig: Rig, family: Family, limits: Limits, least: float = 1.0) -> Goal:
    """Return what the codec makes of ``clip``; ``limits`` say which motion is worth coding.

    ``least``: share of what a joint may usually turn or slide without its being coded.
    """
    if isinstance(clip, MarkerClip):
        return _marker_goal(clip, family, limits)
    return _skeleton_goal(clip, rig, family, limits, least)


def _marker_goal(clip: MarkerClip, family: Family, limits: Limits) -> Goal:
    nodes = marker_nodes(family)
    nodes = nodes.refined(_fines(nodes, marker_shape(nodes)[0], limits))
    positions = filled(clip.positions)
    shape, offsets = marker_shape(nodes)
    counted = clip.seen.astype(np.float64)
    measure = Yardstick(
        np.zeros((clip.frames, 0, 3, 3)),
        positions,
        shape,
        offsets,
        np.zeros((nodes.count, MEND_COLUMNS)),
        counted,
        limits.joints,
        limits.frames,
    )
    path = np.zeros((clip.frames, nodes.count, 4), np.int64)
    path[..., :3] = np.rint(positions[:, nodes.table[:, JOINT]] * (1 << UNIT_BITS))
    return Goal(nodes, (), (), path, measure)


def _skeleton_goal(
    clip: SkeletonClip, rig: Rig, family: Family, limits: Limits, least: float
) -> Goal:
    skeleton = clip.skeleton
    world = world_rotations(skeleton, clip.rotations)
    positions = world_positions(skeleton, world, clip.translations)
    tolerance = limits.least if limits.mean is None else min(limits.least, limits.mean)
    sliding = sliding_joints(clip, rig, world, positions, least * tolerance)
    still = _still(clip, family, least * tolerance)
    nodes = skeleton_nodes(rig, family, frozenset(still), sliding)
    shape, offsets = skeleton_shape(skeleton, nodes)
    nodes = nodes.refined(_fines(nodes, shape, limits))
    points = np.concatenate([positions, end_positions(skeleton, world, positions)], axis=1)
    path = np.zeros((clip.frames, nodes.count, 4), np.int64)
    turns = to_turns(to_quaternions(world))
    for node, row in enumerate(nodes.table):
        joint = int(row[JOINT])
        if row[KIND] != PLACE:
            path[:, node] = turns[:, joint]
            continue
        place = positions if node == nodes.path else clip.translations
        path[:, node, :3] = np.rint(place[:, joint] * (1 << UNIT_BITS))
    measure = Yardstick(
        world,
        points,
        shape,
        offsets,
        mends_of(skeleton, nodes, shape, offsets, path),
        np.ones(points.shape[:2]),
        limits.joints,
        limits.frames,
    )
    return Goal(nodes, still, sliding, path, measure)


def _fines(nodes: Nodes, shape: IntArray, limits: Limits) -> IntArray:
    """Return how much finer (nodes,) than for the loosest limit each node is to be coded.

    As fine as the closest limit at or below it needs; ``shape``: see `yardstick.Yardstick`.
    """
    closest = limits.joints.copy()
    for point in range(len(shape) - 1, -1, -1):
        parent = int(shape[point, 0])
        if parent >= 0:
            closest[parent] = min(closest[parent], closest[point])
    finer = np.log2(closest.max(initial=0.0) / closest)[nodes.table[:, JOINT]]
    return np.asarray(np.minimum(np.rint(finer / QUARTER), MOST_FINE), np.int64)


def _still(clip: SkeletonClip, family: Family, tolerance: float) -> tuple[int, ...]:
    """Return the joints that hold their angle to their parent through the clip."""
    if not clip.frames:
        return ()
    apart = np.square(clip.rotations - clip.rotations[:1]).sum(axis=(2, 3)).max(axis=0)
    levers = holding_levers(clip.skeleton, family) / LEVER_SCALE
    turned = np.sqrt(apart / 2.0) * levers  # chord of the angle, times the lever
    return tuple(np.flatnonzero(turned <= STILL_SHARE * tolerance).tolist())
