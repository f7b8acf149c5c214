"""Nodes of clips in index files of version 2, from docs/format.md alone.

Follows the section "Nodes". Shares no code with ``motifold``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import isqrt
from typing import Any, TypeAlias

from oracle_turns import Three

Record: TypeAlias = dict[str, Any]


@dataclass
class Node:
    """What is coded of a joint or marker; guide, carrier and axes are numbers of nodes.

    ``inertia``: the six numbers, 1/256 cm²; places have none.
    """

    kind: str  # turn, hinge, follower or place
    row: int
    lever: int
    guide: int | None = None
    carrier: int | None = None
    axes: int | None = None
    inertia: tuple[int, ...] = ()

    @property
    def is_place(self) -> bool:
        return self.kind == "place"

    @cached_property
    def scale(self) -> tuple[int, int, int, int, int, int]:
        """a b c d e f of the upper triangular root, in 2^-12 cm per radian."""
        xx, xy, xz, yy, yz, zz = (number << 16 for number in self.inertia)
        a = root(xx)
        b = xy // a
        c = xz // a
        d = root(yy - b * b)
        e = (yz - b * c) // d
        return a, b, c, d, e, root(zz - c * c - e * e)

    @cached_property
    def reciprocal(self) -> tuple[int, int, int, int, int, int]:
        """The inverse of the scale, × 2^30, in the same order."""
        a, b, c, d, e, f = self.scale
        u = 1 << 42
        return (
            *(u // a, -u * b // (a * d), u * (b * e - c * d) // (a * d * f)),
            *(u // d, -u * e // (d * f), u // f),
        )

    def lengths(self, v: Three, n: int) -> Three:
        a, b, c, d, e, f = self.scale
        x, y, z = v
        return ((a * x + b * y + c * z) >> n, (d * y + e * z) >> n, (f * z) >> n)

    def angles(self, signal: Three) -> Three:
        """Return a rotation vector in radians × 2^28."""
        a, b, c, d, e, f = self.reciprocal
        x, y, z = signal
        return ((a * x + b * y + c * z) >> 22, (d * y + e * z) >> 22, (f * z) >> 22)


def root(square: int) -> int:
    return max(isqrt(max(square, 0)), 4096)


@dataclass
class Figure:
    """The nodes of a clip, in order; ``rows``: of poses; top and path: numbers of nodes."""

    nodes: list[Node]
    top: int | None
    path: int | None
    rows: int

    def is_core(self, number: int) -> bool:
        return number in (self.top, self.path)


def figure_of_markers(rig: Record, family: Record) -> Figure:
    parts, markers = family["parts"], len(rig["names"])
    guides: dict[int, int | None] = {}
    for part in parts:
        above = part if part["parent"] < 0 else parts[part["parent"]]
        for marker in part["joints"]:
            guides[marker] = None if above["reference"] == marker else above["reference"]

    def level(marker: int) -> int:
        guide = guides[marker]
        return 0 if guide is None else level(guide) + 1

    order = sorted(guides, key=lambda marker: (level(marker), marker))
    numbers: dict[int | None, int | None] = {marker: k for k, marker in enumerate(order)}
    numbers[None] = None
    nodes = [
        Node("place", markers + marker, family["shift_levers"][marker], numbers[guides[marker]])
        for marker in order
    ]
    (path,) = (numbers[part["reference"]] for part in parts if part["parent"] < 0)
    return Figure(nodes, None, path, 2 * markers)


def figure_of_skeleton(rig: Record, family: Record, still: set[int], sliding: list[int]) -> Figure:
    parents = rig["parents"]
    joints = range(len(parents))

    def ancestors(joint: int) -> Iterator[int]:
        while parents[joint] >= 0:
            joint = parents[joint]
            yield joint

    turning = [joint for joint in joints if joint not in still]
    free = [joint for joint in turning if still.issuperset(ancestors(joint))]
    top = next((joint for joint in sliding[:1] if joint in free), free[0] if free else None)

    turns: dict[int, int] = {}  # level of each joint
    for joint in joints:
        parent = parents[joint]
        level = -len(parents) if parent < 0 else turns[parent] + 1
        turns[joint] = level if joint in still else max(level, 2)
        if joint == top:
            turns[joint] = 0
    listed = [(level, False, joint) for joint, level in turns.items()]
    listed += [(1, True, joint) for joint in sliding]
    numbers = {(place, joint): k for k, (_, place, joint) in enumerate(sorted(listed))}
    top_node = None if top is None else numbers[False, top]
    path = numbers[True, sliding[0]] if sliding else None

    def turn(joint: int) -> Node:
        lever = family["levers"][joint]
        inertia = family["inertia"][joint] if family.get("inertia") else square(lever)
        guide = next((above for above in ancestors(joint) if above not in still), None)
        hinged = guide is not None and joint in family.get("hinged", ())
        return Node(
            "hinge" if hinged else "turn",
            joint,
            lever,
            None if guide is None else numbers[False, guide],
            path,
            numbers[False, joint],
            tuple(inertia),
        )

    def follower(joint: int) -> Node:
        below = [other for other in joints if joint == other or joint in ancestors(other)]
        lever = max(family["levers"][other] for other in below)
        guide = numbers[False, parents[joint]] if parents[joint] >= 0 else None
        return Node("follower", joint, lever, guide, inertia=square(lever))

    def place(joint: int) -> Node:
        node = Node("place", len(parents) + joint, family["shift_levers"][joint])
        if joint == sliding[0]:
            node.guide = node.axes = top_node
        return node

    makers = {True: place, False: turn}
    nodes = [
        follower(joint) if not is_place and joint in still else makers[is_place](joint)
        for _, is_place, joint in sorted(listed)
    ]
    return Figure(nodes, top_node, path, 2 * len(parents))


def square(lever: int) -> tuple[int, ...]:
    """Return the inertia of a joint of which the family says nothing but its lever."""
    return (lever * lever, 0, 0, lever * lever, 0, lever * lever)
