"""Forward and inverse kinematics of a `Skeleton`."""

from __future__ import annotations

from collections.abc import Set

import numpy as np

from ..clip import FloatArray, Skeleton

# cm²: 3² for a point 3 cm away, and a third more because the worst of three points counts
SHELL_INERTIA = 12.0
# exponent of the joints that hang on a bone: they make up for a part of its error themselves
MADE_UP = 0.75


def world_rotations(skeleton: Skeleton, rotations: FloatArray) -> FloatArray:
    """Return world rotations (frames, joints, 3, 3) of local ones of the same shape."""
    out = np.empty_like(rotations)
    for joint, parent in enumerate(skeleton.parents):
        local = rotations[:, joint]
        out[:, joint] = local if parent < 0 else out[:, parent] @ local
    return out


def local_rotations(skeleton: Skeleton, world: FloatArray) -> FloatArray:
    """Return local rotations (frames, joints, 3, 3) of world ones: the inverse of the above."""
    out = world.copy()
    child = np.flatnonzero(skeleton.parents >= 0)
    parent = skeleton.parents[child]
    out[:, child] = np.swapaxes(world[:, parent], -1, -2) @ world[:, child]
    return out


def world_positions(skeleton: Skeleton, world: FloatArray, translations: FloatArray) -> FloatArray:
    """Return joint positions (frames, joints, 3), centimetres.

    ``world``: (frames, joints, 3, 3) world rotations; ``translations``: (frames, joints, 3)
    local translations, centimetres.
    """
    out = np.empty_like(translations)
    for joint, parent in enumerate(skeleton.parents):
        step = translations[:, joint]
        if parent < 0:
            out[:, joint] = step
        else:
            out[:, joint] = out[:, parent] + np.einsum("fij,fj->fi", world[:, parent], step)
    return out


def end_positions(skeleton: Skeleton, world: FloatArray, positions: FloatArray) -> FloatArray:
    """Return end-site positions (frames, ends, 3), centimetres, of posed joints."""
    carriers = skeleton.end_parents
    arms = np.einsum("feij,ej->fei", world[:, carriers], skeleton.end_offsets)
    return np.asarray(positions[:, carriers] + arms)


def hanging_joints(skeleton: Skeleton) -> FloatArray:
    """Return how many joints hang on each joint (joints,), itself included."""
    hanging = np.ones(skeleton.joints)
    for joint in range(skeleton.joints - 1, 0, -1):
        hanging[skeleton.parents[joint]] += hanging[joint]
    return hanging


def levers(skeleton: Skeleton) -> FloatArray:
    """Return each joint's lever (joints,), centimetres of displacement per radian of error.

    lever² = 3² + Σ over children and end sites of (joints that hang on it, itself included)
    × |offset|²: the root of the summed squared displacements that a small turn of this
    joint's world orientation causes, with the 3 cm shell for the joint itself.
    """
    hanging = hanging_joints(skeleton)
    square = np.full(skeleton.joints, 9.0)
    for joint in range(1, skeleton.joints):
        square[skeleton.parents[joint]] += hanging[joint] * (skeleton.offsets[joint] ** 2).sum()
    for carrier, offset in zip(skeleton.end_parents, skeleton.end_offsets, strict=True):
        square[carrier] += (offset**2).sum()
    return np.asarray(np.sqrt(square))


def inertia(skeleton: Skeleton, hinged: Set[int] = frozenset()) -> FloatArray:
    """Return what a small turn of each joint's world orientation does (joints, 3, 3), cm².

    e · M e is the summed squared displacement that the turn e (radians, in the joint's axes)
    causes: 12 |e|² for the joint's shell, and |e × offset|² for every child and end site, times
    n^0.75 of the n joints that hang on it, itself included. It is the inertia tensor of those
    points: a twist about a bone moves nothing at the bone's end. A joint of ``hinged`` is
    measured against its parent, which then turns all that hangs on it: a third of the trace of
    its inertia, as its pose changes, counts for its parent about every axis.
    """
    hanging = hanging_joints(skeleton) ** MADE_UP
    out = np.tile(SHELL_INERTIA * np.eye(3), (skeleton.joints, 1, 1))

    def add(joint: int, mass: float, arm: FloatArray) -> None:
        out[joint] += mass * ((arm**2).sum() * np.eye(3) - np.outer(arm, arm))

    for carrier, offset in zip(skeleton.end_parents, skeleton.end_offsets, strict=True):
        add(int(carrier), 1.0, offset)
    for joint in range(skeleton.joints - 1, 0, -1):
        parent = int(skeleton.parents[joint])
        add(parent, hanging[joint], skeleton.offsets[joint])
        if joint in hinged:
            out[parent] += np.trace(out[joint]) / 3.0 * np.eye(3)
    return out
