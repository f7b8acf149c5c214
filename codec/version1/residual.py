"""The residual layer: what prediction left of a clip's integers, as symbols.

Frame 0 is coded first, then blocks of 8 frames. Every channel of a block is coded under a
class of tables that is chosen from what the decoder knows: the mean |difference| of the
channel so far (a running average that halves the past at each block), mixed with that of the
two other channels of the same joint. Only where nothing is known yet (frame 0, first block)
are the classes sent, one per group of channels (a body part).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..clip import IntArray
from ..errors import DamagedError
from ..streams.entropy import CLASS_FLOORS, CLASSES, FIXED_POINT, SymbolReader, SymbolWriter

BLOCK_FRAMES = 8
_ACTIVITY_LIMIT = 1 << 44


def write_residual(writer: SymbolWriter, left: IntArray, groups: Sequence[int]) -> None:
    """Write prediction residuals ``left``, (frames, channels).

    ``groups``: how many channels each part has, in order; each a multiple of three.
    """
    if not left.size:
        return
    opening = _opening_classes(left[:1], groups)
    _write_classes(writer, opening)
    _write_block(writer, left[:1], np.repeat(opening, groups))
    opening = _opening_classes(left[1 : 1 + BLOCK_FRAMES], groups)
    _write_classes(writer, opening)
    classes, activity = np.repeat(opening, groups), None
    for start in range(1, len(left), BLOCK_FRAMES):
        block = left[start : start + BLOCK_FRAMES]
        _write_block(writer, block, classes)
        activity = _updated(activity, block)
        classes = _classes(_mixed(activity))


def read_residual(reader: SymbolReader, frames: int, groups: Sequence[int]) -> IntArray:
    """Read what `write_residual` wrote: (frames, channels)."""
    channels = sum(groups)
    left = np.zeros((frames, channels), np.int64)
    if not left.size:
        return left
    left[:1] = _read_block(reader, 1, np.repeat(_read_classes(reader, len(groups)), groups))
    classes, activity = np.repeat(_read_classes(reader, len(groups)), groups), None
    for start in range(1, frames, BLOCK_FRAMES):
        stop = min(start + BLOCK_FRAMES, frames)
        block = _read_block(reader, stop - start, classes)
        left[start:stop] = block
        activity = _updated(activity, block)
        classes = _classes(_mixed(activity))
    return left


def _updated(activity: IntArray | None, block: IntArray) -> IntArray:
    """Return the running mean |difference| (channels,) in 1/256 after ``block``."""
    size = np.minimum(np.abs(block), _ACTIVITY_LIMIT >> 20).sum(axis=0) * FIXED_POINT // len(block)
    return np.asarray(size if activity is None else (activity + size + 1) >> 1)


def _mixed(activity: IntArray) -> IntArray:
    """Return each channel's activity mixed 3 : 2 with its joint's mean over three channels."""
    joint = activity.reshape(-1, 3).sum(axis=1).repeat(3)
    return np.asarray((9 * activity + 2 * joint) // 15)


def _classes(activity: IntArray) -> IntArray:
    return np.searchsorted(CLASS_FLOORS, activity, side="right") - 1


def _opening_classes(block: IntArray, groups: Sequence[int]) -> IntArray:
    """Return the class (groups,) that fits each part's channels in ``block``."""
    if not len(block):
        return np.zeros(len(groups), np.int64)
    activity = np.zeros(len(groups), np.int64)
    start = 0
    for index, channels in enumerate(groups):
        part = np.minimum(np.abs(block[:, start : start + channels]), _ACTIVITY_LIMIT >> 20)
        activity[index] = part.sum() * FIXED_POINT // max(part.size, 1)
        start += channels
    return _classes(activity)


def _write_classes(writer: SymbolWriter, classes: IntArray) -> None:
    """Write classes as differences from the previous part's, which is mostly close."""
    previous = 12
    for index in classes.tolist():
        writer.differences(np.array([index - previous], np.int64), _STEP_CLASS)
        previous = index


def _read_classes(reader: SymbolReader, count: int) -> IntArray:
    classes = np.zeros(count, np.int64)
    previous = 12
    for part in range(count):
        previous += int(reader.differences(1, _STEP_CLASS)[0])
        if not 0 <= previous < CLASSES:
            raise DamagedError("the coded stream names a class of tables that does not exist")
        classes[part] = previous
    return classes


_STEP_CLASS = int(_classes(np.array([3 * FIXED_POINT]))[0])


def _write_block(writer: SymbolWriter, block: IntArray, classes: IntArray) -> None:
    for index in np.unique(classes).tolist():
        writer.differences(block[:, classes == index].ravel(), index)


def _read_block(reader: SymbolReader, frames: int, classes: IntArray) -> IntArray:
    block = np.zeros((frames, len(classes)), np.int64)
    for index in np.unique(classes).tolist():
        columns = classes == index
        count = int(columns.sum())
        block[:, columns] = reader.differences(frames * count, index).reshape(frames, count)
    return block
