"""What is coded of a clip, and in which order: three channels at a time, parents first.

A *node* is one joint's orientation (a *turn*), that of a joint that bends about one axis of its
parent only, measured against its guide (a *hinge*), one joint's or marker's position (a *place*),
or a joint that keeps its angle to its parent through the clip and costs nothing (a *follower*).
Nodes stand in levels: all that a node is predicted from lies in levels above its own, so that
the nodes of a level are coded together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..arithmetic.scaling import SCALE_COLUMNS, scale_columns
from ..clip import IntArray, Skeleton
from ..figure.rig import LEVER_SCALE, Family, Rig

TURN, PLACE, FOLLOWER, HINGE = 0, 1, 2, 3

# Columns of the table that the compiled loops read.
KIND, ROW, GUIDE, CARRIER, AXES, LEVER, JOINT, FINE, SCALE = range(9)
COLUMNS = SCALE + SCALE_COLUMNS
_UNSCALED = [0] * SCALE_COLUMNS


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes of one clip in coding order.

    ``table``: (nodes, 21) whole numbers: ``KIND``; ``ROW``, which of the model's rows serves it
    (the joint's number for turns, joints + the joint's number for places); ``GUIDE``, the node
    whose motion it follows (-1: none); ``CARRIER``, the node of the root's path (-1: none, or
    the node is a place; of the first turn, which comes before it, only the path's past is
    seen); ``AXES``, the turn whose last decoded axes a place is measured in (-1: those of the
    world, or of the parent joint); ``LEVER``, in 1/16 cm per radian, or 1/16 for places;
    ``JOINT``; ``FINE``, the quarter octaves by which its steps are finer than others', because
    less is allowed to it or to what hangs on it; from ``SCALE`` on, of all but places, what
    `scaling` makes signals with.
    ``levels``: (levels + 1,) borders between them. ``top``, ``path``: the nodes of the first
    turn and of the root's path, or -1; of markers, the path is the root part's reference marker.
    """

    table: IntArray
    levels: IntArray
    top: int
    path: int

    @property
    def count(self) -> int:
        """Number of nodes."""
        return len(self.table)

    def refined(self, fines: IntArray) -> Nodes:
        """Return the same nodes with steps finer by ``fines`` (nodes,) quarter octaves."""
        table = self.table.copy()
        table[:, FINE] = fines
        return replace(self, table=table)

    def only(self, kept: IntArray) -> Nodes:
        """Return the nodes ``kept`` (ascending), with which guides, carriers and axes must be."""
        number = np.full(self.count + 1, -1)
        number[kept] = np.arange(len(kept))  # the last one stays: -1 is none
        table = self.table[kept]
        for column in (GUIDE, CARRIER, AXES):
            table[:, column] = number[table[:, column]]
        levels = np.searchsorted(kept, self.levels)
        return Nodes(table, levels, int(number[self.top]), int(number[self.path]))

    @cached_property
    def of_joint(self) -> dict[tuple[bool, int], int]:
        """Node number by (is it a place?, joint)."""
        kinds, joints = self.table[:, KIND].tolist(), self.table[:, JOINT].tolist()
        return {
            (kind == PLACE, joint): node
            for node, (kind, joint) in enumerate(zip(kinds, joints, strict=True))
        }


def skeleton_nodes(
    rig: Rig, family: Family, still: frozenset[int], sliding: tuple[int, ...]
) -> Nodes:
    """Return the nodes of a skeleton clip.

    ``still``: joints whose local rotation does not change through the clip; ``sliding``:
    joints whose translation is coded, ascending. The first of them carries the root's path:
    its place is its position in the world, measured in the axes of the first turn; the places
    of the others are local translations.
    """
    skeleton = rig.skeleton
    turning = [joint for joint in range(skeleton.joints) if joint not in still]
    holding = holding_levers(skeleton, family)
    top = _top_turn(skeleton, turning, sliding)
    level: dict[tuple[bool, int], int] = {}
    rows: dict[tuple[bool, int], list[int]] = {}
    path = (True, sliding[0]) if sliding else None
    if top is not None:
        level[False, top] = 0
    if path is not None:
        level[path] = 1
    for joint in sliding[1:]:
        level[True, joint] = 1
    for joint in range(skeleton.joints):
        if (False, joint) in level:
            continue
        parent = int(skeleton.parents[joint])
        # joints that are still and hang on nothing that turns come before the first turn
        above = -skeleton.joints - 1 if parent < 0 else level[False, parent]
        level[False, joint] = above + 1 if joint in still else max(above + 1, 2)
    order = sorted(level, key=lambda node: (level[node], node[0], node[1]))
    number = {node: at for at, node in enumerate(order)}
    for node in order:
        place, joint = node
        parent = int(skeleton.parents[joint])
        if place:
            lever = int(family.shift_levers[joint])
            axes = number[False, top] if node == path and top is not None else -1
            rows[node] = [
                PLACE,
                skeleton.joints + joint,
                axes,
                -1,
                axes,
                lever,
                joint,
                0,
                *_UNSCALED,
            ]
            continue
        lever = int(family.levers[joint])
        if joint in still:
            guide = -1 if parent < 0 else number[False, parent]
            lever = int(holding[joint])
            scale = scale_columns(_isotropic(lever))
            rows[node] = [FOLLOWER, joint, guide, -1, -1, lever, joint, 0, *scale]
            continue
        while parent >= 0 and parent in still:
            parent = int(skeleton.parents[parent])
        guide = -1 if parent < 0 or joint == top else number[False, parent]
        carrier = -1 if path is None else number[path]
        tensor = family.inertia[joint].tolist() if len(family.inertia) else _isotropic(lever)
        scale = scale_columns(tensor)
        kind = HINGE if guide >= 0 and joint in family.hinged else TURN
        rows[node] = [kind, joint, guide, carrier, number[node], lever, joint, 0, *scale]
    return Nodes(
        np.array([rows[node] for node in order], np.int64).reshape(-1, COLUMNS),
        _borders([level[node] for node in order]),
        -1 if top is None else number[False, top],
        -1 if path is None else number[path],
    )


def _isotropic(lever: int) -> list[int]:
    """Return the inertia of a lever (1/16 cm per radian) that is the same about all axes."""
    square = lever * lever * 256 // LEVER_SCALE**2
    return [square, 0, 0, square, 0, square]


def holding_levers(skeleton: Skeleton, family: Family) -> IntArray:
    """Return the largest lever (1/16 cm per radian) at and below each joint.

    What an error of a joint counts for where those below do not make up for it: a follower
    carries other followers, and the axes of hinges.
    """
    out = np.array(family.levers, np.int64)
    for joint in range(skeleton.joints - 1, 0, -1):
        parent = int(skeleton.parents[joint])
        out[parent] = max(out[parent], out[joint])
    return out


def _top_turn(skeleton: Skeleton, turning: list[int], sliding: tuple[int, ...]) -> int | None:
    """Return the first joint that turns and has no turning joint above it, nearest the path."""
    free = []
    for joint in turning:
        parent = int(skeleton.parents[joint])
        while parent >= 0 and parent not in turning:
            parent = int(skeleton.parents[parent])
        if parent < 0:
            free.append(joint)
    if not free:
        return None
    return sliding[0] if sliding and sliding[0] in free else free[0]


def marker_nodes(family: Family) -> Nodes:
    """Return the nodes of a marker clip: places that follow a reference marker.

    In the root part its own, in the others that of the parent part."""
    parts = family.parts
    guide: dict[int, int] = {}
    for part in parts:
        anchor = parts[part.parent].reference if part.parent >= 0 else part.reference
        for marker in part.joints:
            guide[marker] = anchor if anchor != marker else -1
    level: dict[int, int] = {}

    def depth(marker: int) -> int:
        if marker not in level:
            level[marker] = 0 if guide[marker] < 0 else depth(guide[marker]) + 1
        return level[marker]

    order = sorted(guide, key=lambda marker: (depth(marker), marker))
    number = {marker: at for at, marker in enumerate(order)}
    table = [
        [
            PLACE,
            len(order) + marker,
            number.get(guide[marker], -1),
            -1,
            -1,
            int(family.shift_levers[marker]),
            marker,
            0,
            *_UNSCALED,
        ]
        for marker in order
    ]
    borders = _borders([level[marker] for marker in order])
    root = number[parts[0].reference]
    return Nodes(np.array(table, np.int64).reshape(-1, COLUMNS), borders, -1, root)


def _borders(levels: list[int]) -> IntArray:
    """Return where each level begins, and the end, for levels in ascending order."""
    changes = np.flatnonzero(np.diff(levels)) + 1
    return np.concatenate([[0], changes, [len(levels)]]).astype(np.int64)
