"""Runs of index files of versions 2 to 4, from docs/format.md alone: first frames and blocks.

Follows "Core and rest streams", "First frame", "One node of one block" and "Index file, version
4". Shares no code with ``motifold``.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from oracle_blocks import Moments, Signals, States, Viewer, joined, recall
from oracle_model import Model
from oracle_nodes import Figure, Node, Record
from oracle_stream import SymbolReader
from oracle_turns import (
    ONE,
    SAME,
    Four,
    Three,
    added,
    between,
    class_of,
    difference,
    log,
    product,
    refined,
    rotated,
    turn_of,
    unit,
)

Pose: TypeAlias = list[Four]  # by row


class Lead(NamedTuple):
    reference: int
    first: int
    stop: int
    start: int
    stride: int
    move: list[int]  # six numbers, or none


class Track(NamedTuple):
    """All states of a reference, and its nodes."""

    states: States
    nodes: list[Node]


NOWHERE: Four = (0, 0, 0, 0)


def usual_pose(rig: Record, family: Record) -> Pose:
    joints = len(rig["names"])
    pose = [NOWHERE] * (2 * joints)
    parts = family["parts"]
    for part in parts:
        above = SAME if part["parent"] < 0 else pose[parts[part["parent"]]["reference"]]
        for joint in part["joints"]:
            w, x, y, z = (v * ONE // 32767 for v in family["centres"][joint])
            pose[joint] = product(above, unit(unit((w, x, y, z))))
    for joint in range(joints):
        x, y, z = (round(v * 2**20) for v in rig["offsets"][joint])
        pose[joints + joint] = (x, y, z, 0)
    return pose


def over_lever(signal: Three, lever: int) -> Three:
    x, y, z = signal
    return ((x << 4) // lever, (y << 4) // lever, (z << 4) // lever)


class RunReader:
    """Decodes one run; states, activities and moments gather here."""

    def __init__(
        self, figure: Figure, model: Model, step: int, fineness: list[int], poses: list[Pose]
    ) -> None:
        self.figure, self.model, self.step = figure, model, step
        self.nodes, self.fineness, self.poses = figure.nodes, fineness, poses
        self.states: States = []
        self.viewer = Viewer(figure, model, self.states)
        self.activities: list[list[int]] = [[0] * len(self.nodes)] * 2  # newest block first
        self.moments: list[Moments] = []
        self.streams = [0] * len(self.nodes)  # of the rest, by node
        self.leads: list[tuple[Lead, Track]] = []
        self.low = self.frames = 0
        self.leader: States = []  # of this block: the frame before it, and its frames

    def follow(self, leads: list[tuple[Lead, Track]], low: int) -> None:
        """Take the clip's leads; ``low``: the run's first frame in the clip."""
        self.leads, self.low = leads, low

    def led_by(self, before: int, stop: int) -> tuple[Lead, Track] | None:
        """Return the lead that has the frames of the run from ``before`` up to ``stop``."""
        for lead, track in self.leads:
            if lead.first <= self.low + before and self.low + stop <= lead.stop:
                return lead, track
        return None

    def seen(self, lead: Lead, track: Track, t: int) -> list[Four]:
        """Return what the reference does at a frame of the run, in the clip's nodes."""
        own = self.low + min(t, self.frames - 1)
        at = min(lead.start + lead.stride * (own - lead.first), len(track.states) - 1)
        known = {node.row: track.states[at][k] for k, node in enumerate(track.nodes)}
        found = [known.get(node.row, NOWHERE) for node in self.nodes]
        if lead.move:
            found = [self.moved(k, values, lead.move) for k, values in enumerate(found)]
        against = [
            node.guide if node.kind == "hinge" else node.axes if node.is_place else None
            for node in self.nodes
        ]
        there = [
            node.row in known and (other is None or self.nodes[other].row in known)
            for node, other in zip(self.nodes, against, strict=True)
        ]
        self.there = there
        return found

    def moved(self, k: int, values: Four, move: list[int]) -> Four:
        """Return what a node does in a figure that is moved as a whole."""
        x, y, z, *shift = move
        turn = turn_of((x << 8, y << 8, z << 8))
        if not self.nodes[k].is_place:
            return unit(product(turn, values))
        if k != self.figure.path and not all(node.is_place for node in self.nodes):
            return values
        place = rotated(turn, values[:3])
        return added((*place, 0), (shift[0] << 10, shift[1] << 10, shift[2] << 10))

    def read(
        self, core: SymbolReader, rests: list[SymbolReader], frames: int, offered: Moments | None
    ) -> States:
        """Decode; ``offered``: the moments of the references."""
        span = self.model.span
        self.moments = [offered] if offered else []
        self.frames = frames
        self.read_first(core)
        if len(self.poses) > 2:
            self.skip_motifs(core, frames)
        any_refined = core.uniform(2)
        refinement, t = 0, 1
        for first in range(1, frames, span):
            if any_refined:
                refinement += core.sized(20)
                assert 0 <= refinement <= 24
            while t + span <= first:
                self.moments.append(self.viewer.moments([t]))
                t += max(span // 4, 1)
            self.moments = [joined(self.moments)] if self.moments else []
            self.read_block(core, rests, first - 1, refinement)
        return self.states[:frames]

    def skip_motifs(self, core: SymbolReader, frames: int) -> None:
        """Read the motifs, which only the preview needs."""
        for _ in {*range(0, frames, 16), frames - 1}:
            if not core.uniform(2):
                core.uniform(len(self.poses))

    def read_first(self, core: SymbolReader) -> None:
        number = core.uniform(len(self.poses))
        refinement = core.number()
        assert refinement <= 24
        state: list[Four] = []
        self.states.append(state)
        pose = self.poses[number]
        led = self.led_by(0, 1)
        if led:
            pose = [NOWHERE] * len(pose)
            for node, values in zip(self.nodes, self.seen(*led, 0), strict=True):
                pose[node.row] = values
            for node, there in zip(self.nodes, self.there, strict=True):
                if not there:
                    pose[node.row] = NOWHERE
        for node, fine in zip(self.nodes, self.fineness, strict=True):
            f = refinement + fine + (12 if node.kind == "follower" else 0)
            step = refined(self.step, f)
            starts = self.model.rows[node.row].starts[0 if number == 0 else 1]
            d = [core.sized(8 if led else class_of(start - log(step) + 6144)) for start in starts]
            x = ((d[0] * step) >> 4, (d[1] * step) >> 4, (d[2] * step) >> 4)
            expected = self.expected(node, pose, state)
            if node.is_place:
                state.append(added(expected, over_lever(x, node.lever)))
            else:
                state.append(unit(product(expected, turn_of(node.angles(x)))))

    def expected(self, node: Node, pose: Pose, state: list[Four]) -> Four:
        usual = self.poses[0]
        guide = None if node.guide is None else self.nodes[node.guide]
        if pose[node.row] == NOWHERE:
            pose = usual
        if node.is_place:
            if guide is None or node.guide is None or not guide.is_place:
                return pose[node.row]
            return added(state[node.guide], difference(pose[node.row], pose[guide.row]))
        if guide is None or node.guide is None:
            return pose[node.row]
        if pose[guide.row] == NOWHERE:
            pose = usual
        return unit(product(state[node.guide], between(pose[guide.row], pose[node.row])))

    def read_block(
        self, core: SymbolReader, rests: list[SymbolReader], before: int, refinement: int
    ) -> None:
        span = self.model.span
        signals: Signals = {}
        self.leader = []
        led = self.led_by(before, min(before + span + 1, self.frames))
        if led:
            self.leader = [self.seen(*led, before + i) for i in range(span + 1)]
            self.leader[0] = self.states[before]
        active = [0] * len(self.nodes)
        self.activities.insert(0, active)
        self.states += [[] for _ in range(span)]
        for k, node in enumerate(self.nodes):
            if node.kind == "follower":
                for state in self.states[-span:]:
                    state.append(self.followed(node, k, state))
                continue
            stream = core if self.figure.is_core(k) else rests[self.streams[k]]
            f = refinement + self.fineness[k]
            signals[k], active[k] = self.read_node(stream, k, before, f, signals)
            for state, signal in zip(self.states[-span:], signals[k], strict=True):
                state.append(self.settled(node, k, before, state, signal))

    def followed(self, node: Node, k: int, state: list[Four]) -> Four:
        first = self.states[0]
        if node.guide is None:
            return first[k]
        return unit(product(state[node.guide], between(first[node.guide], first[k])))

    def settled(self, node: Node, k: int, before: int, state: list[Four], signal: Three) -> Four:
        last = self.states[before]
        if node.is_place:
            v = over_lever(signal, node.lever)
            return added(last[k], v if node.axes is None else rotated(last[node.axes], v))
        turn = turn_of(node.angles(signal))
        if node.kind == "turn":
            return unit(product(last[k], turn))
        assert node.guide is not None
        bent = unit(product(between(last[node.guide], last[k]), turn))
        return unit(product(state[node.guide], bent))

    def read_node(
        self, stream: SymbolReader, k: int, before: int, f: int, signals: Signals
    ) -> tuple[list[Three], int]:
        """Return a node's signal in the block, and its activity."""
        span, node = self.model.span, self.nodes[k]
        row, step = self.model.rows[node.row], refined(self.step, f)
        active, last, before_last = self.activities[:3]

        def steps(v: int) -> int:
            return log(((v << 8) // step) + 3)

        signs = [last[k] + 64 * f, before_last[k] + 64 * f, *[0] * 8]
        if node.guide is not None:
            signs[2] = active[node.guide] + 64 * f
        if node.carrier is not None and k != self.figure.top:
            assert self.figure.top is not None
            assert self.figure.path is not None
            signs[3] = ((active[self.figure.top] + active[self.figure.path]) >> 1) + 64 * f
        if self.leader and self.there[k]:
            viewer = Viewer(self.figure, self.model, self.leader)
            prediction = [v for i in range(span) for v in viewer.own(k, 0, 1 + i)]
            signs[4:10] = [*[log(3)] * 5, 256]
        else:
            features = self.viewer.features(k, before, signals)
            prediction = self.viewer.prediction(k, features)
            signs[4] = steps(sum(map(abs, features[:12])) // 12)
            if self.moments and self.moments[0].keys.shape[1]:
                keys, followed = self.moments[0].keys[node.row], self.moments[0].followed[node.row]
                found = recall(keys, followed, self.viewer.key(features))
                prediction = [v + mean for v, mean in zip(prediction, found.mean, strict=True)]
                near, last_near = found.nearest << 14, found.last << 14
                signs[6:9] = (steps(found.spread), steps(near), steps(last_near))
                signs[9] = 256
            signs[5] = steps(sum(map(abs, prediction)) // (3 * span))

        levels = [sum(s * v for s, v in zip(sense, signs, strict=True)) for sense in row.senses]
        d = [
            stream.sized(class_of(row.base[c] + (levels[c // span] >> 8))) for c in range(3 * span)
        ]
        basis = (np.array(d, np.int64) @ row.basis).tolist()
        signal = [
            v + ((total * step + (1 << 17)) >> 18)
            for v, total in zip(prediction, basis, strict=True)
        ]
        activity = log((16 * sum(map(abs, d))) // (3 * span) + 1) - 64 * f
        triples = [(signal[c], signal[c + 1], signal[c + 2]) for c in range(0, 3 * span, 3)]
        return triples, activity
