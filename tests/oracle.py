"""Measuring without the codec: BVH, forward kinematics and shell error from their definitions.

Shares no code with ``motifold``: rotations are SciPy's, products go joint by joint. It reads
well-formed files only, and is written to be checked by eye.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

Floats = npt.NDArray[np.float64]
SHELL = 3.0  # centimetres


class Motion(NamedTuple):
    """A skeleton and its motion.

    ``parents``: per joint, -1 for the root; ``offsets``: (joints, 3); ``ends``: (joint that
    carries it, offset) per end site; ``rotations``: per joint a `Rotation` over all frames,
    local; ``translations``: (frames, joints, 3) local; centimetres and seconds.
    """

    names: list[str]
    parents: list[int]
    offsets: Floats
    ends: list[tuple[int, Floats]]
    rotations: list[Any]
    translations: Floats
    frame_time: float


def read_bvh(source: Path | str | bytes, scale: float = 1.0) -> Motion:
    """Read a well-formed BVH file; ``scale`` is the length of its unit in centimetres."""
    text = source.decode() if isinstance(source, bytes) else Path(source).read_text()
    hierarchy, _, motion = text.partition("MOTION")
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    channels: list[list[str]] = []
    ends: list[tuple[int, Floats]] = []
    open_joints: list[int] = []  # -2 stands for an end site
    for line in hierarchy.splitlines():
        word, *rest = line.split() or [""]
        if word in ("ROOT", "JOINT"):
            parents.append(open_joints[-1] if open_joints else -1)
            names.append(line.split(None, 1)[1].strip())
            open_joints.append(len(names) - 1)
        elif word == "End":
            open_joints.append(-2)
        elif word == "OFFSET":
            numbers = [float(number) * scale for number in rest]
            if open_joints[-1] == -2:
                ends.append((open_joints[-2], np.array(numbers)))
            else:
                offsets.append(numbers)
        elif word == "CHANNELS":
            channels.append(rest[1:])
        elif word == "}":
            open_joints.pop()
    words = motion.split()  # Frames: n Frame Time: t numbers …
    frames, frame_time = int(words[1]), float(words[4])
    values = np.array(words[5:], np.float64).reshape(frames, -1)
    assert values.shape[1] == sum(map(len, channels))

    translations = np.repeat(np.array(offsets)[None], frames, axis=0)
    rotations = []
    column = 0
    for joint, joint_channels in enumerate(channels):
        order, angles = "", []
        for name in joint_channels:
            if name.endswith("position"):
                translations[:, joint, "XYZ".index(name[0])] = values[:, column] * scale
            else:
                order += name[0]
                angles.append(values[:, column])
            column += 1
        rotations.append(_turns(order, angles, frames))
    return Motion(names, parents, np.array(offsets), ends, rotations, translations, frame_time)


def _turns(order: str, angles: list[Floats], frames: int) -> Any:
    """Intrinsic turns, degrees, about the axes of ``order`` one after the other."""
    if not order or not frames:
        return Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (frames, 1)))
    if len(order) == 3 and order[0] != order[1] != order[2]:
        return Rotation.from_euler(order, np.stack(angles, axis=1), degrees=True)
    turn = Rotation.from_euler(order[0], angles[0][:, None], degrees=True)
    for axis, angle in zip(order[1:], angles[1:], strict=True):
        turn = turn * Rotation.from_euler(axis, angle[:, None], degrees=True)
    return turn


def of_clip(clip: Any) -> Motion:
    """Return the motion that a `SkeletonClip` holds, whose matrices must be rotations."""
    matrices = clip.rotations
    squares = np.einsum("fjki,fjkl->fjil", matrices, matrices)
    assert np.abs(squares - np.eye(3)).max(initial=0.0) < 1e-9, "not rotations"
    assert (np.linalg.det(matrices) > 0).all(), "mirrored"
    skeleton = clip.skeleton
    return Motion(
        list(skeleton.names),
        [int(parent) for parent in skeleton.parents],
        skeleton.offsets,
        list(zip(skeleton.end_parents.tolist(), skeleton.end_offsets, strict=True)),
        [Rotation.from_matrix(matrices[:, joint]) for joint in range(matrices.shape[1])],
        clip.translations,
        clip.frame_time,
    )


def pose(motion: Motion) -> tuple[list[Any], Floats]:
    """Return each joint's world `Rotation` over all frames, and positions (frames, joints, 3)."""
    world: list[Any] = []
    positions = np.empty_like(motion.translations)
    for joint, parent in enumerate(motion.parents):
        local, step = motion.rotations[joint], motion.translations[:, joint]
        if parent < 0 or len(step) == 0:
            world.append(local)
            positions[:, joint] = step
        else:
            world.append(world[parent] * local)
            positions[:, joint] = positions[:, parent] + world[parent].apply(step)
    return world, positions


def shell_error(original: Motion, decoded: Motion) -> Floats:
    """Return the shell error (frames, joints + end sites), centimetres.

    The largest displacement of the three points 3 cm along the axes of a joint; an end site
    has the axes of the joint that carries it.
    """
    assert original.parents == decoded.parents
    assert len(original.ends) == len(decoded.ends)
    shells = [_shell_points(motion) for motion in (original, decoded)]
    away = shells[1] - shells[0]
    return np.asarray(np.sqrt((away * away).sum(axis=3)).max(axis=2))


def _shell_points(motion: Motion) -> Floats:
    """Return the points (frames, joints + end sites, 3 points, 3)."""
    world, positions = pose(motion)
    frames, joints = positions.shape[:2]
    points = np.empty((frames, joints + len(motion.ends), 3, 3))
    if not frames:
        return points
    for joint in range(joints):
        for axis in range(3):
            reach = world[joint].apply(SHELL * np.eye(3)[axis])
            points[:, joint, axis] = positions[:, joint] + reach
    for number, (carrier, offset) in enumerate(motion.ends):
        points[:, joints + number] = points[:, carrier] + world[carrier].apply(offset)[:, None]
    return points


def marker_error(original: Any, decoded: Any) -> Floats:
    """Return the displacement (frames, markers), centimetres, 0 in gaps, which must agree."""
    assert original.positions.shape == decoded.positions.shape
    frames, markers = original.positions.shape[:2]
    gap = np.isnan(original.positions).any(axis=2)
    assert (np.isnan(decoded.positions).any(axis=2) == gap).all(), "gaps differ"
    out = np.zeros((frames, markers))
    for marker in range(markers):
        seen = ~gap[:, marker]
        away = decoded.positions[seen, marker] - original.positions[seen, marker]
        out[seen, marker] = np.linalg.norm(away, axis=1)
    return out


def clip_error(original: Any, decoded: Any) -> Floats:
    """Return the errors (frames, joints + end sites or markers) of two clips, centimetres."""
    if hasattr(original, "positions"):
        return marker_error(original, decoded)
    return shell_error(of_clip(original), of_clip(decoded))
