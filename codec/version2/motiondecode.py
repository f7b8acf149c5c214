"""From an index file of version 2 back to a clip."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from ..arithmetic.fixedpoint import ONE
from ..blocks.leads import leads_of_run
from ..blocks.motionmodel import MotionModel
from ..blocks.nodes import Nodes, marker_nodes, skeleton_nodes
from ..blocks.offered import Reference
from ..blocks.partnodes import needed_parts, nodes_of_parts
from ..blocks.runstream import read_run
from ..clip import Clip, IntArray
from ..errors import DamagedError, UsageError
from ..figure.rig import Family, Rig
from ..streams.entropy import SymbolReader
from ..streams.envelope import check_room
from ..streams.quantiser import step_of
from .motioncodec import clip_of, known_of
from .motionfile import MotionFile, runs_of
from .motionhead import Head, read_head
from .pieces import size_of

STEP_UNITS = float(1 << 24)
# A frame of a clip in which nothing moves costs nothing; so many nodes of it count as one
# channel when a file's claim is held against its bytes.
ROOM_NODES = 64


@dataclass(frozen=True, eq=False)
class Decoded:
    """A decoded index file in whole numbers: the same on every machine.

    ``states``: per run (frames, nodes, 4), turns × 2^30 and places in 2^-20 cm.
    """

    head: Head
    nodes: Nodes
    states: tuple[IntArray, ...]

    @property
    def size(self) -> int:
        """Bytes of memory that it takes."""
        return self.nodes.table.nbytes + sum(state.nbytes for state in self.states)


def step_units(code: int) -> int:
    """Return the step of a code in 2^-24 cm."""
    return max(int(step_of(code) * STEP_UNITS), 1)


def _coded_bytes(file: MotionFile) -> int:
    """Return the bytes of a file's streams, with something on account for a clip at rest."""
    return size_of(file.cores) + size_of(file.rests or ()) + 240


def _head_of(core: SymbolReader, file: MotionFile, rig: Rig, model: MotionModel) -> Head:
    usual = model.still, model.sliding
    return read_head(core, rig, file.frames, *usual, file.led, file.mirrored)


def nodes_of(rig: Rig, family: Family, head: Head) -> Nodes:
    """Return the nodes that a head names."""
    if rig.kind == "markers":
        nodes = marker_nodes(family)
    else:
        nodes = skeleton_nodes(rig, family, frozenset(head.still), head.sliding)
    return nodes.refined(np.array(head.fines, np.int64)) if head.fines else nodes


def decode_states(
    file: MotionFile,
    rig: Rig,
    family: Family,
    model: MotionModel,
    references: Sequence[Reference],
    *,
    core_only: bool = False,
    start: int = 0,
    stop: int | None = None,
    parts: Collection[int] | None = None,
) -> Decoded:
    """Return the decoded runs of an index file that the frames ``start`` to ``stop`` touch.

    ``references``: in the order of the head. With ``core_only`` the figure follows its
    root's path and does what is expected of it. ``parts``: as by `parts_read`; only their
    nodes, and the core's, are decoded, and of the references only the same parts must be.
    Nothing else is taken from the file's streams. Raises `DamagedError`.
    """
    if file.streams not in (1, len(rig.parts)):
        raise DamagedError(f"claims {file.streams} streams a run for {len(rig.parts)} body parts")
    first = SymbolReader(file.cores[0])
    head = _head_of(first, file, rig, model)
    if len(references) != len(head.references):
        raise UsageError(f"{len(references)} references for {len(head.references)}")
    nodes = nodes_of(rig, family, head)
    known = known_of(nodes, rig, family, model, references, file.streams)
    kept = None if parts is None else nodes_of_parts(nodes, rig.parts, parts)
    decoded = nodes if kept is None else nodes.only(kept)
    check_room(file.frames, 1 + nodes.count // ROOM_NODES, _coded_bytes(file))
    step, states = step_units(file.step_code), []
    tracks = [reference.track for reference in references]
    if any(lead.start >= len(tracks[lead.reference].state) for lead in head.leads):
        raise DamagedError("follows a reference beyond its end")
    last = file.frames if stop is None else stop
    for number, (low, high) in enumerate(runs_of(file.frames)):
        if high <= start or low >= last:
            untouched = np.zeros((high - low, decoded.count, 4), np.int64)
            untouched[..., 0] = ONE  # standing in for what nobody asked for
            states.append(untouched)
            continue
        core = first if number == 0 else SymbolReader(file.cores[number])
        rests = None if core_only else file.rests_of(number)
        leads = leads_of_run(head.leads, tracks, decoded, model.rows, model.span, low, high)
        states.append(read_run(known, step, high - low, core, rests, leads, kept))
    return Decoded(head, decoded, tuple(states))


def parts_read(
    file: MotionFile,
    rig: Rig,
    family: Family,
    model: MotionModel,
    wanted: Collection[int] | None,
    core_only: bool = False,
) -> frozenset[int] | None:
    """Return the parts of an index file to decode for the ``wanted`` ones; None means all.

    All, too, where a run's rest is one stream. Raises `DamagedError`.
    """
    if wanted is None or (file.streams == 1 and not core_only):
        return None
    core = SymbolReader(file.cores[0])
    head = _head_of(core, file, rig, model)
    return needed_parts(nodes_of(rig, family, head), rig, wanted)


def decode_motion(
    file: MotionFile,
    rig: Rig,
    family: Family,
    model: MotionModel,
    references: Sequence[Reference],
    *,
    core_only: bool = False,
    start: int = 0,
    stop: int | None = None,
    parts: Collection[int] | None = None,
) -> Clip:
    """Return the clip of an index file; see `decode_states`. Raises `DamagedError`."""
    decoded = decode_states(
        *(file, rig, family, model, references),
        core_only=core_only,
        start=start,
        stop=stop,
        parts=parts,
    )
    return decoded_clip(decoded, rig)


def decoded_clip(decoded: Decoded, rig: Rig) -> Clip:
    """Return the clip of decoded runs. Raises `DamagedError`."""
    try:
        return clip_of(rig, decoded.nodes, decoded.states, decoded.head.seen)
    except (FloatingPointError, ValueError) as problem:
        raise DamagedError(f"does not decode to a clip ({problem})") from problem
