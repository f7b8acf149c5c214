"""From an index file back to a clip."""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal

import numpy as np

from .clip import Clip, FloatArray, IntArray, MarkerClip, SkeletonClip
from .conform import conformed
from .errors import DamagedError, UsageError
from .index_file import IndexFile
from .kinematics import local_rotations
from .layers import (
    Preview,
    check_room,
    group_channels,
    part_starts,
    read_preview,
    read_rest,
    unpredicted,
)
from .patterns import Codebook, unfold
from .quantiser import step_of
from .rig import Rig
from .segments import most_frames
from .signals import dequantise_markers, dequantise_skeleton, marker_anchor, pose_part
from .timewarp import smooth_borders

Tier = Literal["preview", "tolerance"]
SMOOTHED_SECONDS = 0.1


def decode(
    index: IndexFile,
    rig: Rig,
    codebook: Codebook,
    *,
    tier: Tier = "tolerance",
    parts: Collection[str] | None = None,
) -> Clip:
    """Return the clip of an index file.

    ``codebook``: the family's patterns as of the file's generation. ``tier``: ``tolerance``
    for the certified clip, ``preview`` for patterns with smoothed borders on the exact root
    path, which needs the preview layer only. ``parts``: names of the body parts wanted; joints
    of parts that are neither wanted nor above a wanted one are left at rest (markers: NaN).
    Raises `DamagedError` where the layers contradict themselves, `UsageError` for unknown parts.
    """
    family = codebook.family
    coded = len(index.preview) + len(index.residual or b"")
    root_channels = 3 * len(family.parts[0].joints)
    check_room(index.frames, root_channels, coded)
    preview, root_left = read_preview(
        index.preview, rig, codebook, index.frames, most_frames(rig.frame_time)
    )
    step = step_of(index.step_code)
    wanted = _with_ancestors(codebook, parts)
    if tier == "preview":
        starts = part_starts(preview, family.parts[0].joints, root_left.shape[1])
        root = unpredicted(root_left, None, None, starts, preview.orders[0])
        return _previewed(rig, codebook, preview, root, step, wanted)
    if index.residual is None:
        raise UsageError("only the preview layer was read", advice="Read the whole index file")
    channels = group_channels(codebook, preview.frame)
    check_room(index.frames, sum(channels), coded)
    lefts = [root_left, *read_rest(index.residual, index.frames, channels[1:])]
    integers: list[IntArray | None] = []
    for number, (part, left) in enumerate(zip(family.parts, lefts, strict=True)):
        if number not in wanted:
            integers.append(None)
            continue
        starts = part_starts(preview, part.joints, left.shape[1])
        course = grid_course(codebook, preview, number, step)
        integers.append(
            unpredicted(left, course, preview.parts[number], starts, preview.orders[number])
        )
    return assemble(rig, codebook, preview, integers, step)


def grid_course(codebook: Codebook, preview: Preview, number: int, step: float) -> IntArray | None:
    """Return a part's patterns laid along the clip on the quantiser grid (frames, channels)."""
    index = preview.parts[number]
    if index is None or not index.predicts.any():
        return None
    return np.rint(pattern_course(codebook, preview, number) / step).astype(np.int64)


def pattern_course(codebook: Codebook, preview: Preview, number: int) -> FloatArray:
    """Return a part's patterns laid along the clip, (frames, channels), centimetres.

    Segments without a pattern stay at 0: the usual pose.
    """
    index = preview.parts[number]
    assert index is not None, "the root part has no patterns"
    table = codebook.centimetres[number]
    if len(index.patterns) and index.patterns.max() >= len(table):
        raise DamagedError(f"names pattern {index.patterns.max()} of {len(table)}")
    padded = np.concatenate([table, np.zeros((1, *table.shape[1:]))])
    return unfold(padded[index.patterns], index.borders)


def assemble(
    rig: Rig, codebook: Codebook, preview: Preview, integers: list[IntArray | None], step: float
) -> Clip:
    """Return the clip of all parts' integers."""
    family = codebook.family
    if preview.frame is None:
        positions = dequantise_markers(family, integers, rig.skeleton.joints, step)
        return _marker_clip(rig, preview, positions)
    world, shifts = dequantise_skeleton(family, preview.frame, rig.skeleton, integers, step)
    return _skeleton_clip(rig, world, shifts)


def _previewed(
    rig: Rig,
    codebook: Codebook,
    preview: Preview,
    root: IntArray,
    step: float,
    wanted: Collection[int],
) -> Clip:
    """Return the preview clip: the root path, and patterns with smoothed borders."""
    family = codebook.family
    path_only = [root, *[None] * (len(family.parts) - 1)]
    width = max(1, round(SMOOTHED_SECONDS / rig.frame_time))
    courses = {}
    for number, index in enumerate(preview.parts):
        if index is not None and number in wanted:
            course = pattern_course(codebook, preview, number)
            courses[number] = smooth_borders(course, index.borders, width)
    if preview.frame is None:
        positions = dequantise_markers(family, path_only, rig.skeleton.joints, step)
        for number, course in courses.items():
            part = family.parts[number]
            anchor = positions[:, [marker_anchor(family, part)]]
            positions[:, part.joints] = course.reshape(len(course), len(part.joints), 3) + anchor
        return _marker_clip(rig, preview, positions)
    world, shifts = dequantise_skeleton(family, preview.frame, rig.skeleton, path_only, step)
    for number, course in courses.items():
        pose_part(family, family.parts[number], course, world)
    return _skeleton_clip(rig, world, shifts)


def _marker_clip(rig: Rig, preview: Preview, positions: FloatArray) -> MarkerClip:
    assert preview.seen is not None
    positions[~preview.seen] = np.nan
    return MarkerClip(rig.skeleton.names, rig.frame_time, positions, rig.layout)


def _skeleton_clip(rig: Rig, world: FloatArray, shifts: FloatArray) -> SkeletonClip:
    world = conformed(rig.skeleton, rig.layout, world)
    local = local_rotations(rig.skeleton, world)
    return SkeletonClip(rig.skeleton, rig.frame_time, local, shifts, rig.layout)


def _with_ancestors(codebook: Codebook, names: Collection[str] | None) -> set[int]:
    parts = codebook.family.parts
    if names is None:
        return set(range(len(parts)))
    known = {part.name: number for number, part in enumerate(parts)}
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise UsageError(
            f"no body part {', '.join(unknown)}", advice=f"Choose from {', '.join(known)}"
        )
    wanted: set[int] = set()
    for name in names:
        number = known[name]
        while number >= 0:
            wanted.add(number)
            number = parts[number].parent
    return wanted
