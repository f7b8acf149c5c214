"""The scale of a body: its head's diagonal, by which thresholds follow the actor's size.

Gu et al. 2009, Section 5, take the average diagonal distance of the head (ADDH): the distance
of two opposite ones of the four head markers, averaged over the first 200 frames.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..clip import FloatArray, Skeleton
from .bodyparts import body_parts

# Head diagonal over standing height. Measured on the pyCGM sample trials that declare the
# actor's height: 0.111, 0.121, 0.124 and 0.125.
HEAD_FRACTION = 0.12
_ANKLE_FRACTION = 0.04  # height of the ankle joint above the floor over standing height
_SMALLEST = 1.0  # centimetres, so that no threshold becomes 0
_FRAMES = 200
_DIAGONALS = (("LFHD", "RBHD"), ("RFHD", "LBHD"))


def head_diagonal(skeleton: Skeleton) -> float:
    """Return what the ADDH of a skeleton's actor would be, centimetres, 1 at least.

    `HEAD_FRACTION` of the standing height, which is the length of the bones from the ankle up
    to the pelvis and on to the top of the head, and 4 % for the foot's height. It does not
    depend on the rest pose, and joints of fingers, props and tails do not count. Without a
    foot or a head the longest way between two joints or end sites takes its place.
    """
    bones = np.sqrt((skeleton.offsets**2).sum(axis=1))
    ends = np.sqrt((skeleton.end_offsets**2).sum(axis=1))
    parts = body_parts(skeleton)
    pelvis = parts[0].reference
    depth = np.zeros(skeleton.joints)  # along the bones, below the skeleton's root
    for joint in range(1, skeleton.joints):
        depth[joint] = depth[skeleton.parents[joint]] + bones[joint]
    tips = depth.copy()
    np.maximum.at(tips, skeleton.end_parents, depth[skeleton.end_parents] + ends)

    heads = [tips[list(part.joints)].max() for part in parts if part.name == "head"]
    feet = [depth[part.joints[0]] for part in parts if part.name in ("left_foot", "right_foot")]
    if heads and feet:
        height = (max(heads) + max(feet) - 2 * depth[pelvis]) / (1 - _ANKLE_FRACTION)
    else:
        height = _longest_way(skeleton, bones, tips - depth)
    return _at_least_smallest(HEAD_FRACTION * float(height))


def marker_head_diagonal(names: Sequence[str], positions: FloatArray) -> float:
    """Return the ADDH of a marker set, centimetres, 1 at least (Gu et al. 2009, Section 5).

    ``positions``: (frames, markers, 3) centimetres, NaN in gaps. The mean of both diagonals of
    the head markers (LFHD to RBHD, RFHD to LBHD, with or without a ``subject:`` in front) over
    those of the first 200 frames that show them. Without them `HEAD_FRACTION` of the marker
    cloud's extent: its largest side along an axis, the median of those frames.
    """
    early = positions[:_FRAMES]
    place = {name.rsplit(":", 1)[-1].strip().upper(): index for index, name in enumerate(names)}
    lengths = [
        np.sqrt(((early[:, place[front]] - early[:, place[back]]) ** 2).sum(axis=1))
        for front, back in _DIAGONALS
        if front in place and back in place
    ]
    seen = np.concatenate([length[~np.isnan(length)] for length in lengths] or [np.zeros(0)])
    if len(seen):
        return _at_least_smallest(float(seen.mean()))
    shown = early[~np.isnan(early).all(axis=(1, 2))]
    if not shown.size:
        return _SMALLEST
    with_gaps_high = np.where(np.isnan(shown), -np.inf, shown).max(axis=1)
    with_gaps_low = np.where(np.isnan(shown), np.inf, shown).min(axis=1)
    extent = float(np.median((with_gaps_high - with_gaps_low).max(axis=1)))
    return _at_least_smallest(HEAD_FRACTION * extent)


def _longest_way(skeleton: Skeleton, bones: FloatArray, ends: FloatArray) -> float:
    """Return the longest way along bones between two joints or end sites, centimetres."""
    below = ends.copy()
    longest = 0.0
    for joint in range(skeleton.joints - 1, 0, -1):
        parent = skeleton.parents[joint]
        arm = below[joint] + bones[joint]
        longest = max(longest, below[parent] + arm)
        below[parent] = max(below[parent], arm)
    return max(longest, float(below.max(initial=0.0)))


def _at_least_smallest(length: float) -> float:
    return length if np.isfinite(length) and length > _SMALLEST else _SMALLEST
