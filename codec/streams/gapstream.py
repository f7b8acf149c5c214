"""The gaps of marker clips as symbols: where each marker turns to unseen and back."""

from __future__ import annotations

import numpy as np

from ..clip import BoolArray, IntArray
from ..errors import DamagedError
from ..geometry.gaps import from_runs, to_runs
from .entropy import SymbolReader, SymbolWriter


def write_gaps(writer: SymbolWriter, seen: BoolArray) -> None:
    """Write which markers are seen when, (frames, markers)."""
    writer.uniform([int(not seen.all())], 2)
    if seen.all():
        return
    for turns in to_runs(seen):
        writer.number(len(turns))
        for gap in np.diff(turns, prepend=0).tolist():
            writer.number(gap)


def read_gaps(reader: SymbolReader, frames: int, markers: int) -> BoolArray:
    """Return what `write_gaps` was given. Raises `DamagedError`."""
    if not reader.uniform(1, 2)[0]:
        return np.ones((frames, markers), bool)
    runs: list[IntArray] = []
    for marker in range(markers):
        count = reader.number()
        if count > frames:
            raise DamagedError(f"marker {marker} has more gaps than there are frames")
        turns = [0]
        for _ in range(count):
            turns.append(turns[-1] + reader.number())
        if turns[-1] >= max(frames, 1):
            raise DamagedError(f"marker {marker} has a gap after the last frame")
        runs.append(np.array(turns[1:], np.int64))
    return from_runs(runs, frames)
