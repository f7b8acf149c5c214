"""Channels: the numbers of a BVH frame, and the local motion that they stand for.

A joint's channels are named ``Xposition`` … ``Zrotation``, in file order. Its rotation is the
product of the turns of its rotation channels in that order, in degrees; a position channel
replaces its axis of the joint's offset, other axes keep the offset.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..clip import FloatArray
from ..errors import UnsupportedError
from ..geometry.rotations import from_euler, to_euler

POSITIONS = ("Xposition", "Yposition", "Zposition")
ROTATIONS = ("Xrotation", "Yrotation", "Zrotation")
Channels = Sequence[tuple[str, ...]]
_SMALL = 1_000_000  # poses of joints that fit in 100 MB, and need no excuse


def rotation_order(names: Sequence[str]) -> str:
    """Return the axes of one joint's rotation channels in file order, such as ``"ZXY"``."""
    return "".join(name[0] for name in names if name in ROTATIONS)


def check_size(frames: int, joints: int, numbers: int) -> None:
    """Raise UnsupportedError where a file's numbers would unfold to far more poses of joints.

    Keeps the memory of a clip in proportion to its file, whatever the header claims.
    """
    if frames * joints > max(_SMALL, 2 * numbers):
        raise UnsupportedError(
            f"{frames} frames of {joints} joints share only {numbers} numbers",
            advice="Remove the joints that never move from the file",
        )


def unfold(
    values: FloatArray, channels: Channels, offsets: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return local translations (frames, joints, 3) and rotations (frames, joints, 3, 3).

    ``values``: (frames, channels of all joints), lengths in any unit and angles in degrees;
    ``offsets``: (joints, 3) in that unit, which is the unit of the translations.
    """
    frames, joints = len(values), len(channels)
    translations = np.empty((frames, joints, 3))
    translations[:] = offsets
    joint, axis, column = _position_columns(channels)
    translations[:, joint, axis] = values[:, column]
    rotations = np.empty((frames, joints, 3, 3))
    for order, (members, columns) in _rotation_columns(channels).items():
        rotations[:, members] = from_euler(order, np.radians(values[:, columns]))
    return translations, rotations


def fold(translations: FloatArray, rotations: FloatArray, channels: Channels) -> FloatArray:
    """Return the values (frames, channels) whose `unfold` comes nearest to a local motion.

    Angles are degrees in [-180, 180]. A joint with fewer than three rotation channels gets the
    best fit, one without position channels loses its translation.
    """
    values = np.zeros((len(rotations), sum(map(len, channels))))
    joint, axis, column = _position_columns(channels)
    values[:, column] = translations[:, joint, axis]
    for order, (members, columns) in _rotation_columns(channels).items():
        values[:, columns] = np.degrees(to_euler(order, rotations[:, members]))
    return values


def _position_columns(channels: Channels) -> tuple[list[int], list[int], list[int]]:
    flat = [(joint, name) for joint, names in enumerate(channels) for name in names]
    found = [
        (joint, POSITIONS.index(name), column)
        for column, (joint, name) in enumerate(flat)
        if name in POSITIONS
    ]
    return [f[0] for f in found], [f[1] for f in found], [f[2] for f in found]


def _rotation_columns(channels: Channels) -> dict[str, tuple[list[int], list[list[int]]]]:
    """Return {order: (joints, their columns)}, so that one call turns all of an order's joints."""
    groups: dict[str, tuple[list[int], list[list[int]]]] = {}
    column = 0
    for joint, names in enumerate(channels):
        members, columns = groups.setdefault(rotation_order(names), ([], []))
        members.append(joint)
        columns.append([column + i for i, name in enumerate(names) if name in ROTATIONS])
        column += len(names)
    return groups
