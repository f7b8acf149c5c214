"""The head of an index file, with which its first core begins.

It names the clip's references, and what is coded of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..blocks.blockcoder import MOST_FINE
from ..blocks.leads import Lead, Move
from ..clip import BoolArray
from ..errors import DamagedError
from ..figure.rig import Rig
from ..figure.sliding import can_slide
from ..streams.entropy import SymbolReader, SymbolWriter
from ..streams.envelope import FRAME_LIMIT
from ..streams.gapstream import read_gaps, write_gaps
from .motionfile import MotionFile

MOST_REFERENCES = 64
MOST_MOVED = 1 << 36  # 2^-11 cm: more than 300 km
_RARE = 8  # class of a joint that is not as usual: one in some fifty
_FINE = 36  # class of how a node's fineness differs from the last one's


class Named(NamedTuple):
    """A reference as a head names it: the number of a clip, and whether its mirror image is meant.

    In the order of their numbers; of one clip the image comes after the clip itself.
    """

    number: int
    mirrored: bool = False


@dataclass(frozen=True, eq=False)
class Head:
    """What the head says.

    ``references``: the clips that this one is predicted from, ascending; ``still``
    and ``sliding``: joints, see `nodes`; ``seen``: (frames, markers), None for skeletons;
    ``fines``: per node, see `nodes.FINE`; empty if all are 0; ``leads``: in the order of their
    frames, of which no two have one in common.
    """

    references: tuple[Named, ...]
    still: tuple[int, ...]
    sliding: tuple[int, ...]
    seen: BoolArray | None
    fines: tuple[int, ...] = ()
    leads: tuple[Lead, ...] = ()

    @property
    def mirrored(self) -> bool:
        """Whether any reference is the mirror image of a clip."""
        return any(reference.mirrored for reference in self.references)


def write_head(
    writer: SymbolWriter,
    head: Head,
    rig: Rig,
    usual_still: tuple[int, ...],
    usual_sliding: tuple[int, ...],
) -> None:
    """Write the head; ``usual_*``: what the motion model says of most clips."""
    codes = [reference.number for reference in head.references]
    if head.mirrored:
        codes = [2 * reference.number + reference.mirrored for reference in head.references]
    gaps = np.diff(np.array(codes, np.int64), prepend=-1) - 1
    writer.number(len(gaps))
    if len(gaps):
        bits = int(gaps.max()).bit_length()
        writer.uniform([bits], 48)
        writer.uniform(gaps, 1 << bits)
    if head.leads or head.mirrored:
        _write_leads(writer, head.leads, len(gaps))
    if head.seen is not None:
        write_gaps(writer, head.seen)
        _write_fines(writer, head.fines)
        return
    joints, candidates = rig.skeleton.joints, can_slide(rig)
    _write_set(writer, head.still, usual_still, list(range(joints)))
    _write_set(writer, head.sliding, usual_sliding, candidates)
    _write_fines(writer, head.fines)


def read_head(
    reader: SymbolReader,
    rig: Rig,
    frames: int,
    usual_still: tuple[int, ...],
    usual_sliding: tuple[int, ...],
    led: bool = False,
    mirrored: bool = False,
) -> Head:
    """Return what `write_head` was given; ``led`` and ``mirrored``: see `MotionFile`.

    Raises `DamagedError`.
    """
    references = _read_references(reader, mirrored)
    leads = _read_leads(reader, len(references), frames, led) if led or mirrored else ()
    if rig.kind == "markers":
        seen = read_gaps(reader, frames, rig.skeleton.joints)
        return Head(references, (), (), seen, _read_fines(reader, rig.skeleton.joints), leads)
    joint_numbers, candidates = list(range(rig.skeleton.joints)), can_slide(rig)
    still = _read_set(reader, usual_still, joint_numbers)
    sliding = _read_set(reader, usual_sliding, candidates)
    fines = _read_fines(reader, len(joint_numbers) + len(sliding))
    return Head(references, still, sliding, None, fines, leads)


def read_references(file: MotionFile) -> tuple[Named, ...]:
    """Return the references that a file's first core names. Raises `DamagedError`."""
    return _read_references(SymbolReader(file.cores[0]), file.mirrored)


def read_leads(file: MotionFile) -> tuple[Lead, ...]:
    """Return the leads that a file's first core names. Raises `DamagedError`."""
    if not (file.led or file.mirrored):
        return ()
    reader = SymbolReader(file.cores[0])
    references = _read_references(reader, file.mirrored)
    return _read_leads(reader, len(references), file.frames, file.led)


def _read_references(reader: SymbolReader, mirrored: bool) -> tuple[Named, ...]:
    count = reader.number()
    if count > MOST_REFERENCES:
        raise DamagedError(f"claims {count} references")
    if not count:
        return ()
    bits = int(reader.uniform(1, 48)[0])
    gaps = reader.uniform(count, 1 << bits)
    codes = (np.cumsum(gaps + 1) - 1).tolist()
    return tuple(Named(code >> 1, bool(code & 1)) if mirrored else Named(code) for code in codes)


def _write_leads(writer: SymbolWriter, leads: tuple[Lead, ...], references: int) -> None:
    writer.number(len(leads))
    before = 0
    for lead in leads:
        writer.uniform([lead.reference], references)
        for number in (lead.first - before, lead.frames - 1, lead.start, lead.stride - 1):
            writer.number(number)
        writer.uniform([int(lead.move is not None)], 2)
        for value in lead.move or ():
            writer.number(2 * value if value >= 0 else -2 * value - 1)
        before = lead.stop


def _read_leads(reader: SymbolReader, references: int, frames: int, led: bool) -> tuple[Lead, ...]:
    count, leads, before = reader.number(), [], 0
    if not references or not int(led) <= count <= frames:
        raise DamagedError(f"claims {count} leads by {references} references")
    for _ in range(count):
        reference = int(reader.uniform(1, references)[0])
        first, length, start, stride = (reader.number() for _ in range(4))
        move = _read_move(reader) if int(reader.uniform(1, 2)[0]) else None
        lead = Lead(reference, before + first, length + 1, start, stride + 1, move)
        if lead.stop > frames or lead.start + lead.stride * lead.frames > FRAME_LIMIT:
            raise DamagedError(f"claims a lead from frame {lead.first} to {lead.stop}")
        leads.append(lead)
        before = lead.stop
    return tuple(leads)


def _read_move(reader: SymbolReader) -> Move:
    coded = [reader.number() for _ in range(6)]
    if max(coded) > MOST_MOVED:
        raise DamagedError("claims a figure moved out of this world")
    x, y, z, right, up, ahead = (-(each + 1) // 2 if each & 1 else each // 2 for each in coded)
    return x, y, z, right, up, ahead


def _write_fines(writer: SymbolWriter, fines: tuple[int, ...]) -> None:
    writer.sized(np.array([int(bool(fines))]), np.array([_RARE]))
    if fines:
        numbers = np.array(fines, np.int64)
        changes = numbers - np.append(0, numbers[:-1])
        writer.sized(changes, np.full(len(fines), _FINE))


def _read_fines(reader: SymbolReader, nodes: int) -> tuple[int, ...]:
    if not int(reader.sized(np.array([_RARE]))[0]):
        return ()
    fines = np.cumsum(reader.sized(np.full(nodes, _FINE)))
    if fines.min(initial=0) < 0 or fines.max(initial=0) > MOST_FINE:
        raise DamagedError(f"claims a node refined {fines.max()} times")
    return tuple(fines.tolist())


def _write_set(
    writer: SymbolWriter, chosen: tuple[int, ...], usual: tuple[int, ...], among: list[int]
) -> None:
    odd = set(chosen) ^ set(usual)
    flags = np.array([int(joint in odd) for joint in among], np.int64)
    writer.sized(flags, np.full(len(among), _RARE))


def _read_set(reader: SymbolReader, usual: tuple[int, ...], among: list[int]) -> tuple[int, ...]:
    flags = reader.sized(np.full(len(among), _RARE))
    odd = {joint for joint, flag in zip(among, flags.tolist(), strict=True) if flag}
    return tuple(sorted(odd ^ (set(usual) & set(among))))
