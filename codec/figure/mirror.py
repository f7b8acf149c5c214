"""A skeleton in a mirror: which joint each one becomes, and how its axes lie there.

The world is mirrored from left to right: x becomes -x. A joint Q of the left becomes the right
one M Q S, with M that mirror and S one that changes a joint's axes to those of its partner: all
three of them, as rigs have it whose limbs were mirrored by their tools, or one. Then a mirrored
turn is i Q u, with u one of 1, i, j, k: components change places and signs, and nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TypeAlias

import numpy as np

from ..clip import FloatArray, IntArray
from .bodyparts import BodyPart
from .jointnames import other_side

Mirror: TypeAlias = tuple[tuple[int, int], ...]
"""Per joint its partner, and which of 1, i, j, k is u; empty for a figure without an image."""

SIGNS = np.array([[-1, -1, -1], [-1, 1, 1], [1, -1, 1], [1, 1, -1]])  # the diagonal of S, by u
ROOTS = (1, 0, 2, 3)  # u of the root: that of the world first, where all are as good
APART = 1.4  # of two usual poses, root of the sum of squares: half of what a turned axis makes
LONGER = 0.25  # of a bone, by which its partner may differ
SHORT = 2.0  # centimetres, by which any may
DIGITS = 6  # so that of equal ways every machine takes the first


def find_mirror(
    names: Sequence[str],
    parents: IntArray,
    parts: Sequence[BodyPart],
    centres: FloatArray,
    bones: FloatArray,
) -> Mirror:
    """Return how a skeleton looks in a mirror, or () if its two sides are not alike.

    ``centres``: (joints, 3, 3) usual orientations relative to the parent parts' references, in
    the world for the root part; ``bones``: (joints, 3) local translations, centimetres.
    """
    partners = _partners(names, parents)
    if partners is None or not len(partners) or (parents[1:] < 0).any():
        return ()
    anchors, usual = _relative(parents, parts, centres)
    found = [_axes_from(root, partners, parents, anchors, usual, bones) for root in ROOTS]
    off, axes = min(found, key=lambda each: each[0])
    return tuple(zip(partners, axes, strict=True)) if off < np.inf else ()


def image_parts(mirror: Mirror, parts: Sequence[BodyPart], chosen: Iterable[int]) -> frozenset[int]:
    """Return the numbers of the parts that some parts become in a mirror."""
    owner = {joint: number for number, part in enumerate(parts) for joint in part.joints}
    return frozenset(owner[mirror[joint][0]] for part in chosen for joint in parts[part].joints)


def _partners(names: Sequence[str], parents: IntArray) -> list[int] | None:
    """Return which joint each becomes in a mirror, or None where the two sides differ."""
    numbers = {name.lower(): joint for joint, name in enumerate(names)}
    if len(numbers) < len(names):
        return None
    partners = [numbers.get(other_side(name), -1) for name in names]
    for joint, partner in enumerate(partners):
        if partner < 0 or partners[partner] != joint:
            return None
        above, other = int(parents[joint]), int(parents[partner])
        if (above < 0) != (other < 0) or (above >= 0 and partners[above] != other):
            return None
    return partners


def _relative(
    parents: IntArray, parts: Sequence[BodyPart], centres: FloatArray
) -> tuple[list[int], FloatArray]:
    """Return what each joint's usual orientation is relative to (-1: nothing), and that."""
    anchors, usual = [-1] * len(parents), centres.copy()
    for part in parts:
        for joint in part.joints:
            if part.parent >= 0:
                anchors[joint] = parts[part.parent].reference
            elif int(parents[joint]) in part.joints:
                anchors[joint] = int(parents[joint])
                usual[joint] = centres[anchors[joint]].T @ centres[joint]
    return anchors, usual


def _axes_from(
    root: int,
    partners: Sequence[int],
    parents: IntArray,
    anchors: Sequence[int],
    usual: FloatArray,
    bones: FloatArray,
) -> tuple[float, list[int]]:
    """Return u of every joint if the root's is ``root``, and how far that is from alike."""
    axes, total = [root] * len(partners), 0.0
    lengths = np.linalg.norm(bones, axis=1)
    other = SIGNS[:, None] * bones[list(partners)]
    # (4, joints): how far a bone is from its image, by the axes of the joint that it hangs on
    apart = np.abs(bones - other).max(axis=2)
    hanging = np.zeros((4, len(partners)))
    for bone, joint in enumerate(parents.tolist()):
        if joint >= 0:
            hanging[:, joint] += apart[:, bone] / (lengths[bone] + SHORT)
    # references may have higher numbers than the joints that are relative to them
    order = sorted(range(len(partners)), key=lambda joint: _depth(joint, anchors))
    for joint in order:
        anchor, partner = anchors[joint], partners[joint]
        if anchor < 0:
            continue
        image = SIGNS[axes[anchor]][:, None] * usual[partner]
        off = np.linalg.norm(usual[joint] - image * SIGNS[:, None], axis=(1, 2))
        axes[joint] = int(np.argmin(np.round(off + hanging[:, joint], DIGITS)))
        if off[axes[joint]] > APART:
            return np.inf, axes
        total += float(off[axes[joint]])
    placed = np.array(axes)[parents[1:]]
    longer = apart[placed, np.arange(1, len(partners))]
    if (longer > LONGER * lengths[1:] + SHORT).any():
        return np.inf, axes
    return round(total + float((longer / (lengths[1:] + SHORT)).sum()), DIGITS), axes


def _depth(joint: int, anchors: Sequence[int]) -> int:
    depth = 0
    while anchors[joint] >= 0:
        joint, depth = anchors[joint], depth + 1
    return depth
