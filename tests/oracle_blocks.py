"""Features, keys and predictions of index files of version 2, from docs/format.md alone.

Follows "One node of one block" and the moments of "What references offer". Shares no code with
``motifold``.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isqrt
from typing import NamedTuple, TypeAlias

import numpy as np
from oracle_model import Model, Whole
from oracle_nodes import Figure
from oracle_turns import (
    SAME,
    Four,
    Three,
    between,
    clamped,
    difference,
    inverse,
    product,
    rotated,
    vector_of,
)

States: TypeAlias = list[list[Four]]  # of one run: frame by frame, node by node
Signals: TypeAlias = dict[int, list[Three]]  # of one block: per node, frame by frame
LOST = 32767  # all of the key of a moment that has no node


class Moments(NamedTuple):
    """What references did: keys (rows, moments, 24) and what followed (rows, moments, 3 S)."""

    keys: Whole
    followed: Whole


class Recalled(NamedTuple):
    mean: list[int]
    spread: int
    nearest: int
    last: int


class Viewer:
    """Looks at the states of one run under one model."""

    def __init__(self, figure: Figure, model: Model, states: States) -> None:
        self.figure, self.model, self.states = figure, model, states
        self.nodes = figure.nodes

    def turned(self, node: int, before: int, t: int) -> Three:
        states = self.states
        return vector_of(between(states[before][node], states[max(t, 0)][node]))

    def bend(self, node: int, t: int) -> Four:
        """Return a node's turn as its guide sees it."""
        guide = self.nodes[node].guide
        assert guide is not None
        return between(self.states[t][guide], self.states[t][node])

    def moved(self, number: int, before: int, t: int, as_turn: bool = False) -> Three:
        t, node = max(t, 0), self.nodes[number]
        if node.is_place:
            x, y, z = difference(self.states[t][number], self.states[before][number])
            return ((x * node.lever) >> 4, (y * node.lever) >> 4, (z * node.lever) >> 4)
        if node.kind == "hinge" and not as_turn:
            bent = vector_of(between(self.bend(number, before), self.bend(number, t)))
            return node.lengths(bent, 22)
        return node.lengths(self.turned(number, before, t), 22)

    def inverse_of_axes(self, number: int, before: int) -> Four:
        axes = self.nodes[number].axes
        return SAME if axes is None else inverse(self.states[before][axes])

    def own(self, number: int, before: int, t: int) -> Three:
        """Return what a node moved, of a place in its axes."""
        moved = self.moved(number, before, t)
        if self.nodes[number].is_place and self.nodes[number].axes is not None:
            return rotated(self.inverse_of_axes(number, before), moved)
        return moved

    def features(self, number: int, before: int, signals: Signals) -> list[int]:
        span, node = self.model.span, self.nodes[number]
        found = [0] * (31 + 6 * span)
        for i, lag in enumerate(self.model.lags):
            found[3 * i : 3 * i + 3] = self.own(number, before, before - lag)
        if not node.is_place and node.guide is not None:
            found[12:15] = [(v * 10) >> 10 for v in vector_of(self.bend(number, before))]
        if node.guide is not None:
            found[15 : 21 + 3 * span] = self.doings(number, node.guide, before, signals)
        if node.carrier is not None:
            doings = self.doings(number, node.carrier, before, signals)
            found[21 + 3 * span : 27 + 6 * span] = doings
        if node.axes is not None:
            up = [0, 0, 0]
            up[self.model.vertical] = 20 << 20
            seen = rotated(self.inverse_of_axes(number, before), (up[0], up[1], up[2]))
            found[27 + 6 * span : 30 + 6 * span] = seen
        found[30 + 6 * span] = 10 << 20
        return [clamped(v, 1 << 38) for v in found]

    def doings(self, number: int, other: int, before: int, signals: Signals) -> list[int]:
        """Return what another node does in the block, and did: 3 S + 6 numbers."""
        node, o = self.nodes[number], self.nodes[other]
        turn = self.inverse_of_axes(number, before)
        m = turn if o.axes is None else product(turn, self.states[before][o.axes])
        both_turn = not node.is_place and not o.is_place
        found: list[int] = []
        for i in range(self.model.span):
            if number == self.figure.top and other == node.carrier:
                found += (0, 0, 0)
            elif both_turn and o.kind == "hinge":
                x, y, z = self.turned(other, before, before + i + 1)
                found += node.lengths(rotated(m, (x >> 2, y >> 2, z >> 2)), 20)
            elif both_turn:
                found += node.lengths(rotated(m, o.angles(signals[other][i])), 20)
            else:
                found += rotated(m, signals[other][i])
        for lag in self.model.lags[:2]:
            if both_turn:
                found += node.lengths(rotated(m, self.turned(other, before, before - lag)), 22)
            else:
                moved = self.moved(other, before, before - lag, as_turn=True)
                found += rotated(turn if o.is_place else m, moved)
        return found

    def prediction(self, number: int, features: list[int]) -> list[int]:
        weights = self.model.rows[self.nodes[number].row].weights
        found: list[int] = ((np.array(features, np.int64) @ weights + (1 << 15)) >> 16).tolist()
        return found

    def key(self, f: list[int]) -> list[int]:
        span = self.model.span
        e, h, up = 3 * (span - 1), 3 * (span // 2 - 1), 27 + 6 * span
        guide, carrier = 15, 21 + 3 * span
        found = [
            *(24 * f[a] for a in range(3)),
            *(24 * (f[3 + a] - 2 * f[a]) for a in range(3)),
            *(8 * f[12 + a] for a in range(3)),
            *(6 * f[up + a] for a in range(3)),
            *(10 * f[guide + e + a] for a in range(3)),
            *(26 * (f[guide + h + a] - f[guide + e + a] // 2) for a in range(3)),
            *(2 * f[carrier + e + a] for a in range(3)),
            *(20 * (f[carrier + h + a] - f[carrier + e + a] // 2) for a in range(3)),
        ]
        return [clamped(v >> 18, LOST) for v in found]

    def moments(self, times: Sequence[int]) -> Moments:
        """Return what a run's nodes did at some frames t, of all rows."""
        span = self.model.span
        shape = (self.figure.rows, len(times))
        keys = np.full((*shape, 24), LOST, np.int64)
        followed = np.zeros((*shape, 3 * span), np.int64)
        seen = [k for k, node in enumerate(self.nodes) if node.kind != "follower"]
        for at, t in enumerate(times):
            frames = range(t, t + span)
            signals = {k: [self.own(k, t - 1, frame) for frame in frames] for k in seen}
            for k in seen:
                row = self.nodes[k].row
                features = self.features(k, t - 1, signals)
                keys[row, at] = self.key(features)
                flat = [v for signal in signals[k] for v in signal]
                predicted = self.prediction(k, features)
                followed[row, at] = [
                    clamped(v - w, (1 << 31) - 1) for v, w in zip(flat, predicted, strict=True)
                ]
        return Moments(keys, followed)


def joined(parts: list[Moments]) -> Moments:
    return Moments(*(np.concatenate(arrays, axis=1) for arrays in zip(*parts, strict=True)))


def recall(keys: Whole, followed: Whole, key: list[int]) -> Recalled:
    """Recall from a row's moments, of which there are some."""
    distances = ((keys - np.array(key)) ** 2).sum(axis=1)
    order = np.argsort(distances, kind="stable")[:8]
    near = [int(d) for d in distances[order]]
    z = near[0] + 1
    shares = [((2048 * z) // (d + z)) ** 2 for d in near]
    total = sum(shares)
    means, spread = [], 0
    for values in followed[order].T.tolist():
        mean = sum(s * v for s, v in zip(shares, values, strict=True)) // total
        spread += sum(s * abs(v - mean) for s, v in zip(shares, values, strict=True)) // total
        means.append(mean)
    return Recalled(means, spread // len(means), isqrt(near[0]), isqrt(near[-1]))
