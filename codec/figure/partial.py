"""Clips of which only some body parts are wanted."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
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
    rotations, translations = clip.rotations.copy(), clip.translations.copy()
    rotations[:, skipped] = np.eye(3)
    translations[:, skipped] = clip.skeleton.offsets[skipped]
    return replace(clip, rotations=rotations, translations=translations)


def cut_to_parts(clip: Clip, rig: Rig, names: Collection[str]) -> Clip:
    """Return a clip of nothing but the named parts, and those above them, for a file of its own.

    A skeleton's other joints and end sites are gone, not at rest. Raises `UsageError` for unknown
    parts.
    """
    wanted = with_ancestors(rig.parts, rig.skeleton, names)
    joints = sorted(joint for number in wanted for joint in rig.parts[number].joints)
    if isinstance(clip, MarkerClip):
        kept = tuple(clip.names[marker] for marker in joints)
        return replace(clip, names=kept, positions=clip.positions[:, joints])
    skeleton, channels = clip.skeleton, clip.layout.channels
    number = np.full(skeleton.joints + 1, -1)
    number[joints] = np.arange(len(joints))  # the last one stays: -1 is none
    ends = np.isin(skeleton.end_parents, joints)
    smaller = Skeleton(
        tuple(skeleton.names[joint] for joint in joints),
        number[skeleton.parents[joints]],
        skeleton.offsets[joints],
        number[skeleton.end_parents[ends]],
        skeleton.end_offsets[ends],
    )
    layout = replace(clip.layout, channels=tuple(channels[j] for j in joints if channels))
    return replace(
        clip,
        skeleton=smaller,
        rotations=clip.rotations[:, joints],
        translations=clip.translations[:, joints],
        layout=layout,
    )


def with_ancestors(
    parts: Sequence[BodyPart], skeleton: Skeleton, names: Collection[str] | None
) -> set[int]:
    """Return the parts to decode: the named ones, and those `above` them. Raises `UsageError`."""
    if names is None:
        return set(range(len(parts)))
    known = {part.name: number for number, part in enumerate(parts)}
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise UsageError(
            f"no body part {', '.join(unknown)}", advice=f"Choose from {', '.join(known)}"
        )
    return above(parts, skeleton, (known[name] for name in names))


def above(parts: Sequence[BodyPart], skeleton: Skeleton, numbers: Iterable[int]) -> set[int]:
    """Return the parts of these numbers, the root part, and all parts above them.

    Above in the hierarchy of parts, which integers of version 1 and markers are relative to, and
    in the skeleton: a Biped's thighs hang on its spine, while the leg's parent part is the root.
    """
    owner = {joint: number for number, part in enumerate(parts) for joint in part.joints}
    waiting = [0, *numbers]
    wanted: set[int] = set()
    while waiting:
        number = waiting.pop()
        if number in wanted:
            continue
        wanted.add(number)
        carriers = {owner.get(int(skeleton.parents[joint]), 0) for joint in parts[number].joints}
        waiting += [*carriers, max(parts[number].parent, 0)]
    return wanted
