"""Measuring a decoded block inside the encoder's loop, against what the person allowed.

The same shell error as `metrics`, one frame at a time on the codec's whole numbers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ..arithmetic.compiled import compiled, lean
from ..arithmetic.fixedpoint import ONE
from ..clip import BoolArray, FloatArray, IntArray, Skeleton
from ..geometry.metrics import SHELL_CENTIMETRES
from .nodes import Nodes

UNIT = float(1 << 20)

_Arrays: TypeAlias = tuple[
    FloatArray, FloatArray, IntArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray
]


@dataclass(frozen=True, eq=False)
class Yardstick:
    """A clip as it should be, and how far off each joint may be.

    ``world``: (frames, joints, 3, 3) world rotations (of markers: none); ``points``: (frames,
    joints + end sites, 3) world positions, centimetres; ``shape``: (joints + end sites, 4):
    parent, turn node, place node, whether the place is a world position; ``offsets``: (joints
    + end sites, 3) centimetres; ``mends``: (nodes, 21), see `aiming.mends_of`; ``counted``:
    (frames, joints + end sites) 1 where an error counts, 0 in a marker's gaps; ``joint_limits``
    and ``frame_limits``: centimetres, the lesser of the two holds.
    """

    world: FloatArray
    points: FloatArray
    shape: IntArray
    offsets: FloatArray
    mends: FloatArray
    counted: FloatArray
    joint_limits: FloatArray
    frame_limits: FloatArray

    @property
    def arrays(self) -> _Arrays:
        """Everything, in the order in which compiled loops take it."""
        return (
            self.world,
            self.points,
            self.shape,
            self.offsets,
            self.mends,
            self.counted,
            self.joint_limits,
            self.frame_limits,
        )

    def cut(self, start: int, stop: int) -> Yardstick:
        """Return that of some of the frames."""
        return replace(
            self,
            world=self.world[start:stop],
            points=self.points[start:stop],
            counted=self.counted[start:stop],
            frame_limits=self.frame_limits[start:stop],
        )


def skeleton_shape(skeleton: Skeleton, nodes: Nodes) -> tuple[IntArray, FloatArray]:
    """Return a skeleton's ``shape`` and ``offsets``."""
    shape = []
    for joint in range(skeleton.joints):
        place = nodes.of_joint.get((True, joint), -1)
        turn = nodes.of_joint[False, joint]
        shape.append([int(skeleton.parents[joint]), turn, place, int(place == nodes.path >= 0)])
    for carrier in skeleton.end_parents.tolist():
        shape.append([carrier, nodes.of_joint[False, carrier], -1, 0])
    return np.array(shape, np.int64), np.concatenate([skeleton.offsets, skeleton.end_offsets])


def marker_shape(nodes: Nodes) -> tuple[IntArray, FloatArray]:
    """Return the same of markers."""
    places = [nodes.of_joint[True, marker] for marker in range(nodes.count)]
    shape = np.array([[-1, -1, place, 1] for place in places], np.int64)
    return shape, np.zeros((nodes.count, 3))


def all_counted(frames: int, points: int, seen: BoolArray | None = None) -> FloatArray:
    """Return which errors count, (frames, points)."""
    return np.ones((frames, points)) if seen is None else seen.astype(np.float64)


@lean
def matrix_at(state: IntArray, frame: int, node: int, out: FloatArray) -> None:
    """Write a turn's rotation matrix into ``out`` (3, 3)."""
    w = state[frame, node, 0] / float(ONE)
    x = state[frame, node, 1] / float(ONE)
    y = state[frame, node, 2] / float(ONE)
    z = state[frame, node, 3] / float(ONE)
    out[0, 0], out[0, 1], out[0, 2] = (
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
    )
    out[1, 0], out[1, 1], out[1, 2] = (
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
    )
    out[2, 0], out[2, 1], out[2, 2] = (
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    )


@compiled
def errors_at(
    state: IntArray,
    frame: int,
    world: FloatArray,
    points: FloatArray,
    shape: IntArray,
    offsets: FloatArray,
    out: FloatArray,
) -> None:
    """Write the shell error of every joint, marker and end site at a frame, centimetres."""
    place = np.empty((len(shape), 3))
    turns = np.empty((world.shape[1], 3, 3))
    _errors_at(state, frame, world, points, shape, offsets, place, turns, out)


@lean
def _errors_at(
    state: IntArray,
    frame: int,
    world: FloatArray,
    points: FloatArray,
    shape: IntArray,
    offsets: FloatArray,
    place: FloatArray,
    turns: FloatArray,
    out: FloatArray,
) -> None:
    count, joints = len(shape), world.shape[1]
    for j in range(count):
        parent, turn, node, absolute = shape[j, 0], shape[j, 1], shape[j, 2], shape[j, 3]
        if j < joints:
            matrix_at(state, frame, turn, turns[j])
        if absolute == 1:
            for c in range(3):
                place[j, c] = state[frame, node, c] / UNIT
        else:
            for c in range(3):
                place[j, c] = 0.0
            for k in range(3):
                along = offsets[j, k] if node < 0 else state[frame, node, k] / UNIT
                for c in range(3):
                    if parent >= 0:
                        place[j, c] += turns[parent, c, k] * along
                    elif c == k:
                        place[j, c] = along
            if parent >= 0:
                for c in range(3):
                    place[j, c] += place[parent, c]
        owner = j if j < joints else parent
        worst = 0.0
        for axis in range(3 if joints > 0 else 1):
            square = 0.0
            for c in range(3):
                off = place[j, c] - points[frame, j, c]
                if joints > 0:
                    off += SHELL_CENTIMETRES * (
                        turns[owner, c, axis] - world[frame, owner, c, axis]
                    )
                square += off * off
            worst = max(worst, square)
        out[j] = math.sqrt(worst)
