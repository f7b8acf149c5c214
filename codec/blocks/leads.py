"""Clips that go as another one went: copies, excerpts, takes that were cleaned twice.

A *lead* says that for some frames a clip goes as one of its references does, frame by frame. In
blocks inside, the reference's own frames stand in for linear prediction and retrieval: where a
clip is a copy, nothing is left to code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ..arithmetic.compiled import compiled
from ..arithmetic.fixedpoint import product, rotated, turn_of, unit
from ..clip import BoolArray, IntArray
from .nodes import AXES, GUIDE, HINGE, KIND, PLACE, ROW, Nodes

LEAD_CLASS = 8  # of a first pose's differences: one in some fifty is not 0


Move: TypeAlias = tuple[int, int, int, int, int, int]


@dataclass(frozen=True)
class Lead:
    """Frames of a clip that go as a reference does.

    ``reference``: its place among the clip's references; ``first`` and ``frames``: the clip's
    own; ``start``: the reference's frame that the first is like; ``stride``: frames of the
    reference from one to the next; ``move``: how the figure is moved from where it is there, a
    rotation vector about the origin (2^-20 radians), then a shift (2^-10 cm), or None.
    """

    reference: int
    first: int
    frames: int
    start: int
    stride: int
    move: Move | None = None

    @property
    def stop(self) -> int:
        """The frame after its last."""
        return self.first + self.frames

    def like(self, frames: IntArray, known: int) -> IntArray:
        """Return the frames of a reference of ``known`` frames that own ``frames`` are like.

        What would be after its last is its last.
        """
        return np.minimum(self.start + self.stride * (frames - self.first), known - 1)


@dataclass(frozen=True, eq=False)
class Track:
    """A decoded clip as others follow it: ``state`` (frames, nodes, 4), ``rows`` (nodes,)."""

    state: IntArray
    rows: IntArray

    def seen_by(self, nodes: Nodes) -> tuple[IntArray, BoolArray]:
        """Return which node of the track each of other ``nodes`` is, and whether it is there.

        A node is there only if what its signal is measured against is there, too.
        """
        known = {row: node for node, row in enumerate(self.rows.tolist())}
        table = nodes.table
        source = np.array([known.get(row, -1) for row in table[:, ROW].tolist()], np.int64)
        there = source >= 0
        for column, kind in ((GUIDE, HINGE), (AXES, PLACE)):
            other = table[:, column]
            there &= (table[:, KIND] != kind) | (other < 0) | (source[other] >= 0)
        return source, there


@dataclass(frozen=True, eq=False)
class Leads:
    """The leads of one run, block by block.

    ``which``: (blocks,) numbers of the led blocks, -1 of others; ``states``: (led blocks, span +
    1, nodes, 4) room for the frame before a block, and the reference in its frames; ``has``:
    (led blocks, nodes); ``first``: (rows, 4) the pose that the run begins with, or None.
    """

    which: IntArray
    states: IntArray
    has: BoolArray
    first: IntArray | None


def leads_of_run(
    leads: Sequence[Lead],
    tracks: Sequence[Track],
    nodes: Nodes,
    rows: int,
    span: int,
    low: int,
    high: int,
) -> Leads:
    """Return the leads of the run of frames ``low`` to ``high``.

    A block is led if the frame before it and all of its frames are inside one lead; those that
    would be after the run's last are like that one. ``tracks``: of the references. ``rows``: of
    the motion model.
    """
    blocks = -(-(high - low - 1) // span) if high > low else 0
    before = low + span * np.arange(blocks)
    after = np.minimum(before + span + 1, high)
    which, first = np.full(blocks, -1, np.int64), None
    states = [np.zeros((0, span + 1, nodes.count, 4), np.int64)]
    has = [np.zeros((0, nodes.count), np.bool_)]
    count = 0
    for lead in leads:
        if lead.stop <= low or lead.first >= high:
            continue
        track = tracks[lead.reference]
        source, there = track.seen_by(nodes)
        if lead.first <= low < lead.stop:
            first = np.zeros((rows, 4), np.int64)
            pose = track.state[lead.like(np.array([low]), len(track.state))][:, source]
            first[nodes.table[there, ROW]] = moved(pose, nodes, lead.move)[0, there]
        led = np.flatnonzero((before >= lead.first) & (after <= lead.stop))
        which[led] = count + np.arange(len(led))
        count += len(led)
        own = np.minimum(before[led, None] + np.arange(span + 1), high - 1)
        frames = lead.like(own, len(track.state))
        like = track.state[frames.ravel()][:, source]
        states.append(moved(like, nodes, lead.move).reshape(-1, *states[0].shape[1:]))
        has.append(np.repeat(there[None], len(led), axis=0))
    return Leads(which, np.concatenate(states), np.concatenate(has), first)


def no_leads(nodes: Nodes, frames: int, span: int) -> Leads:
    """Return what a run of frames without leads has."""
    return leads_of_run((), (), nodes, 0, span, 0, frames)


def moved(state: IntArray, nodes: Nodes, move: Move | None) -> IntArray:
    """Return a state (frames, nodes, 4) of a figure that is moved as a whole."""
    if move is None:
        return state
    out = np.array(state, order="C")
    kinds = nodes.table[:, KIND].copy()
    if (kinds != PLACE).any():  # of a skeleton, only its path is in the world
        local = kinds == PLACE
        local[nodes.path] = False
        kinds[local] = -1
    _move(out, kinds, *move)
    return out


@compiled
def _move(state: IntArray, kinds: IntArray, a: int, b: int, c: int, x: int, y: int, z: int) -> None:
    turn = turn_of(a << 8, b << 8, c << 8)
    for frame in range(len(state)):
        for node in range(len(kinds)):
            own = state[frame, node]
            if kinds[node] == PLACE:
                p, q, r = rotated(turn, own[0], own[1], own[2])
                own[0], own[1], own[2] = p + (x << 10), q + (y << 10), r + (z << 10)
            elif kinds[node] >= 0:
                known = (own[0], own[1], own[2], own[3])
                own[0], own[1], own[2], own[3] = unit(product(turn, known))
