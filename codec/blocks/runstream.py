"""A run of frames as entropy-coded streams: the core, then the rest.

The core holds the first pose, the blocks' refinements and the coefficients of the root: its
turn and its path. It decodes without the rest. The rest holds all other coefficients, in one
stream, or in one stream a body part, so that a part decodes without others. Numbers stand block
by block, in the order of the nodes, so that a prefix of the frames decodes too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arithmetic.compiled import compiled
from ..clip import BoolArray, IntArray
from ..errors import DamagedError
from ..streams.entropy import SymbolReader, SymbolWriter
from .blockcoder import MOST_FINE, expect, settle
from .blockcontext import pose as pose_node
from .blockwalk import Walk
from .leads import Leads, no_leads
from .motifs import preview_state, read_motifs, write_motifs
from .motionmodel import SIGNS, MotionModel
from .nodegroups import CORE, groups_of
from .nodes import FOLLOWER, KIND, Nodes
from .partnodes import core_nodes
from .recall import FollowArray, KeyArray, Memory, own_memory, own_stride, remember_next
from .startpose import start_classes, start_node

_REFINEMENT_CLASS = 20  # of how a block's refinement differs from the last one's: mostly 0


@dataclass(frozen=True, eq=False)
class Known:
    """What encoder and decoder share of a run's surroundings.

    ``memory`` and ``poses`` are those of the clip's references; pose 0 of ``poses`` (poses,
    rows, 4) is the family's usual one. ``streams``: (nodes,) in which stream of the rest each
    node's coefficients are; core and followers have none there.
    """

    nodes: Nodes
    model: MotionModel
    memory: Memory
    poses: IntArray
    streams: IntArray

    def only(self, kept: IntArray) -> Known:
        """Return the same for the nodes ``kept`` alone; see `Nodes.only`."""
        return replace(self, nodes=self.nodes.only(kept), streams=self.streams[kept])


@dataclass(frozen=True)
class Start:
    """How a first pose is coded: number of the known pose, refinement, (nodes, 3) differences."""

    pose: int
    fine: int
    quantised: IntArray


def write_run(
    known: Known,
    step: int,
    start: Start,
    motifs: IntArray,
    walk: Walk,
    core: SymbolWriter,
    streams: int = 1,
    led: bool = False,
) -> list[bytes]:
    """Write the core of a run to ``core``, and return the streams of its rest.

    ``motifs``: see `motifs`; ``streams``: how many there are; ``led``: whether the first pose
    follows a lead.
    """
    nodes = known.nodes
    core.uniform([start.pose], len(known.poses))
    core.number(start.fine)
    classes = start_classes(nodes, known.model, start.pose, step, start.fine, led)
    core.sized(start.quantised.ravel(), classes.ravel())
    write_motifs(core, motifs, len(known.poses), start.pose)
    in_core = core_nodes(nodes)
    in_rest = nodes.table[:, KIND] != FOLLOWER
    in_rest[in_core] = False
    refined = bool(walk.fines.any())
    core.uniform([int(refined)], 2)
    before = 0
    for block, fine in enumerate(walk.fines.tolist()):
        if refined:
            core.sized(np.array([fine - before]), np.array([_REFINEMENT_CLASS]))
            before = fine
        core.sized(walk.quantised[block, in_core].ravel(), walk.classes[block, in_core].ravel())
    rests = []
    for stream in range(streams):
        members, rest = in_rest & (known.streams == stream), SymbolWriter()
        rest.sized(walk.quantised[:, members].ravel(), walk.classes[:, members].ravel())
        rests.append(rest.to_bytes())
    return rests


def read_run(
    known: Known,
    step: int,
    frames: int,
    core: SymbolReader,
    rests: Sequence[bytes] | None,
    leads: Leads | None = None,
    kept: IntArray | None = None,
) -> IntArray:
    """Return the decoded state (frames, nodes, 4) of a run, its core read from ``core``.

    Without ``rests`` only the core is read: the figure's exact path, and its motifs for the
    rest of the body. ``leads``: of the nodes to decode. ``kept``: the nodes to decode, all that
    are in their streams, and those that they depend on; no other streams are looked at. Raises
    `DamagedError`.
    """
    model = known.model
    number = int(core.uniform(1, len(known.poses))[0])
    fine = core.number()
    if fine > MOST_FINE:
        raise DamagedError(f"claims a first pose refined {fine} times")
    first = None if leads is None else leads.first
    classes = start_classes(known.nodes, model, number, step, fine, first is not None)
    differences = core.sized(classes.ravel()).reshape(-1, 3)
    if kept is not None:
        known, differences = known.only(kept), differences[kept]
    nodes = known.nodes
    blocks = -(-(frames - 1) // model.span)
    state = np.zeros((1 + blocks * model.span, nodes.count, 4), np.int64)
    pose = known.poses[number] if first is None else first
    begin(state, nodes, pose, known.poses[0], Start(number, fine, differences), step)
    motifs = read_motifs(core, frames, len(known.poses), number)
    refined = bool(core.uniform(1, 2)[0])
    walker = _Walker(known, state, step, frames, leads or no_leads(nodes, frames, model.span))
    groups = groups_of(nodes, known.streams, rests is None)
    readers = {CORE: core}
    for stream in {share.stream for group in groups for share in group.shares} - {CORE}:
        assert rests is not None
        readers[stream] = SymbolReader(rests[stream])
    fine = 0
    for block in range(blocks):
        walker.follow(block)
        if refined:
            fine += int(core.sized(np.array([_REFINEMENT_CLASS]))[0])
            if not 0 <= fine <= MOST_FINE:
                raise DamagedError(f"claims a block refined {fine} times")
        for group in groups:
            if group.shares:
                walker.expect(group.nodes, block, fine)
            for share in group.shares:
                kinds = walker.classes[share.low : share.high]
                numbers = readers[share.stream].sized(kinds.ravel())
                walker.quantised[group.nodes[share.low : share.high]] = numbers.reshape(kinds.shape)
            walker.settle(group.nodes, block, fine)
        walker.next(block)
    if rests is None:
        return preview_state(state[:frames], nodes, core_nodes(nodes), known.poses, motifs)
    return state[:frames]


def begin(
    state: IntArray, nodes: Nodes, pose: IntArray, usual: IntArray, start: Start, step: int
) -> None:
    """Write the first pose into ``state``; ``pose`` and ``usual``: (rows, 4)."""
    for node in range(nodes.count):
        differences = start.quantised[node]
        start_node(state, node, nodes.table, pose, usual, differences, step, start.fine)


class _Walker:
    """The decoder's place in a run."""

    def __init__(self, known: Known, state: IntArray, step: int, frames: int, leads: Leads) -> None:
        nodes, model = known.nodes, known.model
        self.state, self.step, self.table, self.span = state, step, nodes.table, model.span
        self.signals = np.zeros((nodes.count, model.span, 3), np.int64)
        self.activity = np.zeros((3, nodes.count), np.int64)
        self.predictions = np.zeros((nodes.count, model.channels), np.int64)
        self.classes = np.zeros((nodes.count, model.channels), np.int64)
        self.quantised = np.zeros((nodes.count, model.channels), np.int64)
        self.basis = model.basis
        self.fixed = (model.span, model.lags, model.up, model.weights, model.base, model.senses)
        self.remembered = (known.memory.keys, known.memory.follows)
        self.own = own_memory(frames, model.rows, model.span)
        self.moments = 0
        self.root = (nodes.top, nodes.path)
        self.leads = leads
        self.led = -1

    def follow(self, block: int) -> None:
        """Go to the lead of a block, if it has one."""
        self.led = int(self.leads.which[block])
        if self.led >= 0:
            self.leads.states[self.led, 0] = self.state[block * self.span]

    def expect(self, group: IntArray, block: int, fine: int) -> None:
        """Predict the nodes of a group, and fill the first rows of ``classes``."""
        _expect_group(
            self.state,
            self.table,
            group,
            1 + block * self.span,
            *self.fixed,
            *self.remembered,
            self.own.keys,
            self.own.follows,
            self.moments,
            self.signals,
            self.activity,
            *self.root,
            self.step,
            fine,
            self.leads.states,
            self.leads.has,
            self.led,
            self.predictions,
            self.classes,
        )

    def settle(self, group: IntArray, block: int, fine: int) -> None:
        """Write the frames of a group's nodes."""
        _settle_group(
            self.state,
            self.table,
            group,
            1 + block * self.span,
            self.span,
            self.basis,
            self.predictions,
            self.quantised,
            self.step,
            fine,
            self.signals,
            self.activity,
        )

    def next(self, block: int) -> None:
        """Remember what a block was, and go on to the next one."""
        self.activity[2] = self.activity[1]
        self.activity[1] = self.activity[0]
        span, lags, up, weights, *_ = self.fixed
        self.moments = remember_next(
            self.state,
            1 + (block + 1) * span,
            self.table,
            span,
            lags,
            up,
            weights,
            own_stride(span),
            self.own.keys,
            self.own.follows,
            self.moments,
        )


@compiled
def _expect_group(
    state: IntArray,
    table: IntArray,
    group: IntArray,
    start: int,
    span: int,
    lags: IntArray,
    up: int,
    weights: IntArray,
    base: IntArray,
    senses: IntArray,
    keys: KeyArray,
    follows: FollowArray,
    own_keys: KeyArray,
    own_follows: FollowArray,
    own: int,
    signals: IntArray,
    activity: IntArray,
    top: int,
    path: int,
    step: int,
    fine: int,
    leads: IntArray,
    has: BoolArray,
    led: int,
    predictions: IntArray,
    classes: IntArray,
) -> None:
    signs = np.empty(SIGNS, np.int64)
    for at in range(len(group)):
        node = group[at]
        if table[node, KIND] != FOLLOWER:
            expect(
                state, table, node, start, span, lags, up, weights, base, senses, keys, follows,
                own_keys, own_follows, own, signals, activity, top, path, step, fine,
                leads, has, led, predictions[node], classes[at], signs,
            )  # fmt: skip


@compiled
def _settle_group(
    state: IntArray,
    table: IntArray,
    group: IntArray,
    start: int,
    span: int,
    basis: IntArray,
    predictions: IntArray,
    quantised: IntArray,
    step: int,
    fine: int,
    signals: IntArray,
    activity: IntArray,
) -> None:
    for at in range(len(group)):
        node = group[at]
        if table[node, KIND] == FOLLOWER:
            pose_node(state, table, node, start, span, signals)
        else:
            settle(
                state, table, node, start, span, basis, predictions[node], quantised[node],
                step, fine, signals, activity,
            )  # fmt: skip
