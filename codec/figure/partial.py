"""Clips of which only some body parts are wanted."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ..clip import Clip, MarkerClip, Skeleton
from ..errors import UsageError
from .bodyparts import BodyPart
from .rig import Rig


def only_parts(clip: Clip, rig: Rig, names: Collection[str] | None) -> Clip:
    """Return ``clip`` with the joints of all but the named parts, and those above, at rest.

    Markers of other parts become gaps. Raises `UsageError` for unknown parts.
    """
    wanted = with_ancestors(rig.parts, rig.skeleton, names)
    skipped = [j for n, part in enumerate(rig.parts) if n not in wanted for j in part.joints]
    if not skipped:
        return clip
    if isinstance(clip, MarkerClip):
        positions = clip.positions.copy()
        positions[:, skipped] = np.nan
        return replace(clip, positions=positions)
    rotations = clip.rotations.copy()
    rotations[:, skipped] = np.eye(3)
    return replace(clip, rotations=rotations)


def with_ancestors(
    parts: Sequence[BodyPart], skeleton: Skeleton, names: Collection[str] | None
) -> set[int]:
    """Return the parts to decode: the named ones, and those above them.

    Above in the hierarchy of parts, which the integers are relative to, and in the skeleton: a
    Biped's thighs hang on its spine, while the leg's parent part is the root. Raises `UsageError`.
    """
    if names is None:
        return set(range(len(parts)))
    known = {part.name: number for number, part in enumerate(parts)}
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise UsageError(
            f"no body part {', '.join(unknown)}", advice=f"Choose from {', '.join(known)}"
        )
    owner = {joint: number for number, part in enumerate(parts) for joint in part.joints}
    waiting = [0, *(known[name] for name in names)]
    wanted: set[int] = set()
    while waiting:
        number = waiting.pop()
        if number in wanted:
            continue
        wanted.add(number)
        above = {owner.get(int(skeleton.parents[joint]), 0) for joint in parts[number].joints}
        waiting += [*above, max(parts[number].parent, 0)]
    return wanted
