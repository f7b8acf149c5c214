"""From an index file back to a clip."""

from __future__ import annotations

from collections.abc import Collection, Container, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from ..clip import Clip, FloatArray, IntArray, MarkerClip, SkeletonClip
from ..errors import DamagedError, UsageError
from ..figure.bodyparts import BodyPart
from ..figure.conform import conformed
from ..figure.partial import with_ancestors
from ..figure.rig import Rig
from ..geometry.kinematics import local_rotations
from ..geometry.metrics import frame_blocks
from ..patterns.patterns import Codebook, unfold
from ..patterns.segments import most_frames
from ..patterns.signals import dequantise_markers, dequantise_skeleton, marker_anchor, pose_part
from ..patterns.timewarp import smooth_borders
from ..streams.envelope import check_room
from ..streams.quantiser import step_of
from .index_file import IndexFile
from .layers import Preview, group_channels, part_starts, read_preview, read_rest, unpredicted

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
    path, which needs the preview layer only. ``parts``: names of the body parts wanted; the
    root part and the parts above a wanted one come with it, joints of all others are left at
    rest (markers: NaN).
    Raises `DamagedError` where the layers contradict themselves, `UsageError` for unknown parts.
    """
    preview, root_left = _opened(index, rig, codebook)
    wanted = with_ancestors(codebook.family.parts, rig.skeleton, parts)
    step = step_of(index.step_code)
    if tier == "preview":
        root = codebook.family.parts[0]
        starts = part_starts(preview, root.joints, root_left.shape[1])
        path = unpredicted(root_left, None, None, starts, preview.orders[0])
        return _previewed(rig, codebook, preview, path, step, wanted)
    integers = _integers(index, codebook, preview, root_left, wanted)
    return assemble(rig, codebook, preview, integers, step)


def decode_integers(index: IndexFile, rig: Rig, codebook: Codebook) -> list[IntArray]:
    """Return the integers (frames, channels) of every part: what the file says, exactly.

    The same on every machine, whatever its sines and matrix products. Raises `DamagedError`.
    """
    preview, root_left = _opened(index, rig, codebook)
    wanted = range(len(codebook.family.parts))
    found = _integers(index, codebook, preview, root_left, wanted)
    return [values for values in found if values is not None]


def _opened(index: IndexFile, rig: Rig, codebook: Codebook) -> tuple[Preview, IntArray]:
    """Return the preview layer, and the prediction residual of the root part's integers."""
    channels = 3 * len(codebook.family.parts[0].joints)
    check_room(index.frames, channels, _coded_bytes(index))
    longest = most_frames(rig.frame_time)
    return read_preview(index.preview, rig, codebook, index.frames, longest)


def _integers(
    index: IndexFile,
    codebook: Codebook,
    preview: Preview,
    root_left: IntArray,
    wanted: Container[int],
) -> list[IntArray | None]:
    """Return the integers of the ``wanted`` parts, None for the others."""
    if index.residual is None:
        raise UsageError("only the preview layer was read", advice="Read the whole index file")
    channels = group_channels(codebook, preview.frame)
    check_room(index.frames, sum(channels), _coded_bytes(index))
    lefts = [root_left, *read_rest(index.residual, index.frames, channels[1:])]
    step = step_of(index.step_code)
    integers: list[IntArray | None] = []
    for number, (part, left) in enumerate(zip(codebook.family.parts, lefts, strict=True)):
        if number not in wanted:
            integers.append(None)
            continue
        starts = part_starts(preview, part.joints, left.shape[1])
        course = grid_course(codebook, preview, number, step)
        index_of_part, order = preview.parts[number], preview.orders[number]
        integers.append(unpredicted(left, course, index_of_part, starts, order))
    return integers


def _coded_bytes(index: IndexFile) -> int:
    return len(index.preview) + len(index.residual or b"")


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
    skipped = [part for part, values in zip(family.parts, integers, strict=True) if values is None]
    frames, joints = preview.frame.bases.shape
    rotations, translations = np.empty((frames, joints, 3, 3)), np.empty((frames, joints, 3))
    for block in frame_blocks(frames):  # what lies between integers and clip takes much memory
        frame = replace(preview.frame, bases=preview.frame.bases[block])
        own = [None if values is None else values[block] for values in integers]
        world, translations[block] = dequantise_skeleton(family, frame, rig.skeleton, own, step)
        rotations[block] = _local(rig, world, skipped)
    return SkeletonClip(rig.skeleton, rig.frame_time, rotations, translations, rig.layout)


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
    skipped = [part for number, part in enumerate(family.parts) if number not in wanted]
    local = _local(rig, world, skipped)
    return SkeletonClip(rig.skeleton, rig.frame_time, local, shifts, rig.layout)


def _marker_clip(rig: Rig, preview: Preview, positions: FloatArray) -> MarkerClip:
    assert preview.seen is not None
    positions[~preview.seen] = np.nan
    return MarkerClip(rig.skeleton.names, rig.frame_time, positions, rig.layout)


def _local(rig: Rig, world: FloatArray, skipped: Sequence[BodyPart]) -> FloatArray:
    """Return local rotations of world ones, with the joints of ``skipped`` parts at rest."""
    local = local_rotations(rig.skeleton, conformed(rig.skeleton, rig.layout, world))
    for part in skipped:
        local[:, part.joints] = np.eye(3)
    return local
