"""From a clip to the runs of its index file, and back to a clip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arithmetic.fixedpoint import ONE
from ..blocks.blockcoder import MOST_FINE
from ..blocks.blockcontext import UNIT_BITS
from ..blocks.blockwalk import Walk, walk
from ..blocks.leads import Leads
from ..blocks.motifs import choose_motifs
from ..blocks.motionmodel import MotionModel
from ..blocks.nodes import JOINT, KIND, PLACE, Nodes
from ..blocks.offered import Reference
from ..blocks.partnodes import stream_numbers
from ..blocks.recall import joined
from ..blocks.runstream import Known, Start
from ..blocks.startpose import choose_start, nearest_pose, start_classes, usual_pose
from ..blocks.yardstick import Yardstick
from ..clip import BoolArray, Clip, FloatArray, IntArray, MarkerClip, SkeletonClip
from ..figure.conform import conformed
from ..figure.rig import Family, Rig
from ..geometry.kinematics import local_rotations
from ..geometry.rotations import from_quaternions


def known_of(
    nodes: Nodes,
    rig: Rig,
    family: Family,
    model: MotionModel,
    references: Sequence[Reference],
    streams: int = 1,
) -> Known:
    """Return what a clip with these references is coded against.

    ``streams``: how many the rest of each run has; see `partnodes.stream_numbers`.
    """
    memory = joined([reference.memory for reference in references], model.rows, model.channels)
    poses = [usual_pose(rig, family)[None], *(reference.poses for reference in references)]
    in_streams = stream_numbers(nodes, rig.parts, streams)
    return Known(nodes, model, memory, np.concatenate(poses), in_streams)


@dataclass(frozen=True, eq=False)
class CodedRun:
    """One run at one step: its choices, and what they amount to."""

    start: Start
    motifs: IntArray
    walk: Walk


def code_run(
    known: Known,
    goal: IntArray,
    yardstick: Yardstick,
    step: int,
    thrift: float,
    refine: bool,
    leads: Leads,
) -> CodedRun:
    """Return a run coded at a step, its first pose refined until it is inside its limits."""
    nodes = known.nodes
    pose = nearest_pose(goal[0], nodes, known.poses)
    single = yardstick.cut(0, 1)
    under = known.poses[pose] if leads.first is None else leads.first
    fine = 0
    while True:
        classes = start_classes(nodes, known.model, pose, step, fine, leads.first is not None)
        first, quantised = choose_start(
            goal, nodes, yardstick, under, known.poses[0], step, fine, classes, thrift
        )
        alone = walk(
            goal[:1], first, nodes, known.model, known.memory, single, step, thrift, refine
        )
        if not refine or alone.largest <= 1.0 or fine >= MOST_FINE:
            break
        fine += 1
    done = walk(
        goal, first, nodes, known.model, known.memory, yardstick, step, thrift, refine, leads
    )
    motifs = choose_motifs(goal, nodes, known.poses, pose)
    return CodedRun(Start(pose, fine, quantised), motifs, done)


def clip_of(rig: Rig, nodes: Nodes, states: Sequence[IntArray], seen: BoolArray | None) -> Clip:
    """Return the clip of decoded runs; ``seen`` (frames, markers) says where markers have gaps.

    Where only some parts were decoded, joints of others stand as the world does, their
    translations at rest, and markers of others are gaps.
    """
    empty = np.zeros((0, nodes.count, 4), np.int64)
    state = np.concatenate([empty, *states])
    if rig.kind == "markers":
        positions = np.full((len(state), rig.skeleton.joints, 3), np.nan)
        positions[:, nodes.table[:, JOINT]] = state[..., :3] / float(1 << UNIT_BITS)
        if seen is not None:
            positions[~seen] = np.nan
        return MarkerClip(rig.skeleton.names, rig.frame_time, positions, rig.layout)
    skeleton = rig.skeleton
    turns = np.tile(np.array([ONE, 0, 0, 0], np.int64), (len(state), skeleton.joints, 1))
    turning = np.flatnonzero(nodes.table[:, KIND] != PLACE)
    turns[:, nodes.table[turning, JOINT]] = state[:, turning]
    world = conformed(skeleton, rig.layout, from_quaternions(turns / float(ONE)))
    local = local_rotations(skeleton, world)
    shifts = np.broadcast_to(skeleton.offsets, (len(state), skeleton.joints, 3)).copy()
    for node in np.flatnonzero(nodes.table[:, KIND] == PLACE).tolist():
        joint = int(nodes.table[node, JOINT])
        place = state[:, node, :3] / float(1 << UNIT_BITS)
        shifts[:, joint] = (
            _local_path(rig, world, shifts, place, joint) if node == nodes.path else place
        )
    return SkeletonClip(skeleton, rig.frame_time, local, shifts, rig.layout)


def _local_path(
    rig: Rig, world: FloatArray, shifts: FloatArray, place: FloatArray, joint: int
) -> FloatArray:
    """Return the local translation of a joint whose position in the world is ``place``."""
    parents = rig.skeleton.parents
    chain = []
    above = int(parents[joint])
    while above >= 0:
        chain.append(above)
        above = int(parents[above])
    origin = np.zeros_like(place)
    for link in reversed(chain):
        parent = int(parents[link])
        step = shifts[:, link]
        origin = origin + (step if parent < 0 else np.einsum("fij,fj->fi", world[:, parent], step))
    if not chain:
        return place
    return np.asarray(np.einsum("fji,fj->fi", world[:, chain[0]], place - origin))
