"""Which joints of a clip slide, and whether a clip can be coded at all."""

from __future__ import annotations

import numpy as np

from ..clip import Clip, FloatArray, MarkerClip, SkeletonClip
from ..errors import UnsupportedError
from ..geometry.kinematics import world_positions
from .rig import Rig

STILL_SHARE = 0.1  # of the tolerance: a translation that varies less is taken as the rest offset


def can_slide(rig: Rig) -> list[int]:
    """Return the joints whose translation the rig's file format could animate."""
    channels = rig.layout.channels
    if not channels:
        return list(range(rig.skeleton.joints))
    return [
        joint
        for joint, names in enumerate(channels)
        if any(name.lower().endswith("position") for name in names)
    ]


def sliding_joints(
    clip: SkeletonClip, rig: Rig, world: FloatArray, positions: FloatArray, tolerance: float
) -> tuple[int, ...]:
    """Return the joints whose translation is coded: those that leave their rest offset."""
    offsets = rig.skeleton.offsets
    moved = np.abs(clip.translations - offsets).max(axis=(0, 2), initial=0.0)
    still = min(STILL_SHARE * tolerance, 0.02)
    candidates = can_slide(rig)
    sliding = [joint for joint in candidates if moved[joint] > still]
    if 2.0 * sum(moved[joint] for joint in candidates if moved[joint] <= still) < tolerance:
        return tuple(sliding)
    # what is neglected adds up along a chain of joints; past the tolerance no step mends it
    kept = np.broadcast_to(offsets, clip.translations.shape).copy()
    kept[:, sliding] = clip.translations[:, sliding]
    missed = np.square(world_positions(clip.skeleton, world, kept) - positions).sum(axis=2)
    if missed.max(initial=0.0) >= tolerance * tolerance:
        still /= rig.skeleton.joints
    return tuple(joint for joint in candidates if moved[joint] > still)


def check_size(clip: Clip) -> None:
    """Raise `UnsupportedError` for a clip of nothing, or too far out for any tolerance."""
    if isinstance(clip, MarkerClip):
        joints, largest = len(clip.names), np.nanmax(np.abs(clip.positions), initial=0.0)
    else:
        joints, lengths = clip.skeleton.joints, (clip.translations, clip.skeleton.end_offsets)
        largest = np.max([np.abs(values).max(initial=0.0) for values in lengths])
    if not joints:
        raise UnsupportedError("the clip has no joints or markers", advice="Leave this file out")
    if not largest < 1e7:
        raise UnsupportedError(
            f"positions reach {largest:.3g} cm", advice="Check the file's unit (--units)"
        )
