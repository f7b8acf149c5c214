"""The two coded layers of an index file as symbols: preview and residual.

The preview layer holds what the integers are measured against (sliding joints, bases, gaps),
per part the sequence of (pattern, frames, whether the pattern predicts), the predictors'
orders, and the root part's integers: the root path. The residual layer holds the integers of
all other parts. Both are ranges of one alphabet of calls, so reading mirrors writing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..clip import BoolArray, IntArray
from ..errors import DamagedError
from ..figure.rig import Rig
from ..figure.sliding import can_slide
from ..patterns.patterns import Codebook
from ..patterns.signals import CUBE, Frame, part_channels
from ..streams.entropy import SymbolReader, SymbolWriter
from ..streams.gapstream import read_gaps, write_gaps
from .prediction import differences, innovations_of, restore, run_starts
from .residual import read_residual, write_residual

ORDERS = (1, 2)
# Bits that the cheapest symbol of the residual costs at the least: bounds what bytes can hold.


@dataclass(frozen=True, eq=False)
class PartIndex:
    """One part's segments as indices into its pattern table.

    ``borders``: (segments + 1,) frames; ``patterns``: (segments,) numbers, -1 for none;
    ``predicts``: (segments,) whether the pattern's course predicts the part's integers.
    """

    borders: IntArray
    patterns: IntArray
    predicts: BoolArray


@dataclass(frozen=True, eq=False)
class Preview:
    """What the preview layer says, beside the root path's integers.

    ``frame`` is None for markers, ``seen`` (frames, markers) None for skeletons. ``parts``:
    None for parts without patterns. ``orders``: the predictor's order per part.
    """

    frame: Frame | None
    seen: BoolArray | None
    parts: tuple[PartIndex | None, ...]
    orders: tuple[int, ...]


def group_channels(codebook: Codebook, frame: Frame | None) -> list[int]:
    """Return how many channels each part has."""
    return [part_channels(part, frame) for part in codebook.family.parts]


def write_preview(
    rig: Rig, codebook: Codebook, preview: Preview, longest: int, root: IntArray
) -> bytes:
    """Return the preview layer; ``root``: prediction residual of the root part's integers.

    ``longest``: the most frames that a segment may have, which both sides derive from the rig.
    """
    writer = SymbolWriter()
    if preview.frame is not None:
        candidates = can_slide(rig)
        sliding = set(preview.frame.sliding)
        # the root slides as a rule, the others hardly ever
        writer.differences(
            np.array([int(joint in sliding) for joint in candidates], np.int64), _RARE
        )
        _write_bases(writer, preview.frame.bases)
    if preview.seen is not None:
        write_gaps(writer, preview.seen)
    for index, patterns in zip(preview.parts, codebook.patterns, strict=True):
        if index is not None:
            _write_index(writer, index, len(patterns), longest)
    writer.uniform([ORDERS.index(order) for order in preview.orders], len(ORDERS))
    write_residual(writer, root, [root.shape[1]])
    return writer.to_words()


def read_preview(
    data: bytes, rig: Rig, codebook: Codebook, frames: int, longest: int
) -> tuple[Preview, IntArray]:
    """Return what `write_preview` was given: (preview, root residual (frames, channels))."""
    reader = SymbolReader(data, "<u4")
    frame, seen = None, None
    if rig.kind == "skeleton":
        candidates = can_slide(rig)
        flags = reader.differences(len(candidates), _RARE)
        chosen = (joint for joint, flag in zip(candidates, flags, strict=True) if flag)
        sliding = tuple(chosen)
        frame = Frame(_read_bases(reader, frames, rig.skeleton.joints), sliding)
    else:
        seen = read_gaps(reader, frames, rig.skeleton.joints)
    parts = tuple(
        _read_index(reader, frames, len(patterns), longest) if patterns.shape[2] else None
        for patterns in codebook.patterns
    )
    orders = tuple(ORDERS[code] for code in reader.uniform(len(parts), len(ORDERS)))
    root = part_channels(codebook.family.parts[0], frame)
    return Preview(frame, seen, parts, orders), read_residual(reader, frames, [root])


def write_rest(left: list[IntArray]) -> bytes:
    """Return the residual layer: prediction residuals of all parts but the root part."""
    writer = SymbolWriter()
    if left:
        write_residual(writer, np.concatenate(left, axis=1), [part.shape[1] for part in left])
    return writer.to_words()


def read_rest(data: bytes, frames: int, channels: list[int]) -> list[IntArray]:
    """Return what `write_rest` was given; ``channels`` per part."""
    both = read_residual(SymbolReader(data, "<u4"), frames, channels)
    return np.split(both, np.cumsum(channels)[:-1], axis=1) if channels else []


def part_starts(preview: Preview, part_joints: tuple[int, ...], channels: int) -> BoolArray:
    """Return where the predictor starts anew, (frames, channels), for one part's integers."""
    if preview.frame is None:
        frames = 0 if preview.seen is None else len(preview.seen)
        return run_starts(np.zeros((frames, channels), bool))
    bases = preview.frame.bases[:, part_joints]
    changes = np.zeros((len(bases), channels), bool)
    changed = bases[1:] != bases[:-1]
    if changed.any():
        changes[1:, : 3 * len(part_joints)] = np.repeat(changed, 3, axis=1)
    return run_starts(changes)


def predicted(
    values: IntArray,
    course: IntArray | None,
    index: PartIndex | None,
    starts: BoolArray,
    order: int,
) -> IntArray:
    """Return the prediction residual of one part's integers (frames, channels).

    ``course``: (frames, pattern channels) the part's patterns on the quantiser grid.
    """
    return differences(
        values, _innovations(values.shape, course, index, starts, order), starts, order
    )


def unpredicted(
    left: IntArray, course: IntArray | None, index: PartIndex | None, starts: BoolArray, order: int
) -> IntArray:
    """Return the integers whose `predicted` residual is ``left``."""
    innovations = _innovations(left.shape, course, index, starts, order)
    return restore(left, innovations, starts, order)


def _innovations(
    shape: tuple[int, ...],
    course: IntArray | None,
    index: PartIndex | None,
    starts: BoolArray,
    order: int,
) -> IntArray:
    out = np.zeros(shape, np.int64)
    if index is not None and course is not None and shape[0]:
        wide = course.shape[1]
        out[:, :wide] = innovations_of(
            course, index.predicts, index.borders, starts[:, :wide], order
        )
    return out


_RARE = 1


def _write_bases(writer: SymbolWriter, bases: IntArray) -> None:
    based = np.flatnonzero(bases.any(axis=0)) if len(bases) else np.zeros(0, np.int64)
    writer.number(len(based))
    for joint in based.tolist():
        course = bases[:, joint]
        starts = np.flatnonzero(np.diff(course, prepend=-1))
        writer.uniform([joint], bases.shape[1])
        writer.number(len(starts) - 1)
        writer.uniform(course[starts], len(CUBE))
        for gap in np.diff(starts).tolist():
            writer.number(gap - 1)


def _read_bases(reader: SymbolReader, frames: int, joints: int) -> IntArray:
    bases = np.zeros((frames, joints), np.int64)
    count = reader.number()
    if count > joints:
        raise DamagedError(f"names {count} turned joints of {joints}")
    for _ in range(count):
        joint = int(reader.uniform(1, joints)[0])
        runs = reader.number() + 1
        if runs > max(frames, 1):
            raise DamagedError(f"joint {joint} changes its base more often than there are frames")
        chosen = reader.uniform(runs, len(CUBE))
        start = 0
        for base in chosen[:-1]:
            stop = start + reader.number() + 1
            bases[start:stop, joint] = base
            start = stop
        bases[start:, joint] = chosen[-1]
    return bases


def _write_index(writer: SymbolWriter, index: PartIndex, known: int, longest: int) -> None:
    for number, frames, predicts in zip(
        index.patterns.tolist(), np.diff(index.borders).tolist(), index.predicts, strict=True
    ):
        writer.uniform([frames - 1], longest)
        writer.uniform([number + 1], known + 1)
        if number >= 0:
            writer.uniform([int(predicts)], 2)


def _read_index(reader: SymbolReader, frames: int, known: int, longest: int) -> PartIndex:
    borders, patterns, predicts = [0], [], []
    while borders[-1] < frames:
        borders.append(borders[-1] + 1 + int(reader.uniform(1, longest)[0]))
        patterns.append(int(reader.uniform(1, known + 1)[0]) - 1)
        predicts.append(bool(patterns[-1] >= 0 and reader.uniform(1, 2)[0]))
    if borders[-1] != frames:
        raise DamagedError("a segment goes on after the last frame")
    return PartIndex(np.array(borders), np.array(patterns, np.int64), np.array(predicts, bool))
