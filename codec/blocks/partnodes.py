"""The nodes of body parts: which are decoded for some parts, and in which streams they are.

What a node is predicted from is above it: joints on the way to the root (of markers, reference
markers of the parts above), and the core. What it recalls is its own row of the references, so
there the same parts must be decoded, and no others.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ..clip import IntArray
from ..figure.bodyparts import BodyPart
from ..figure.partial import above
from ..figure.rig import Rig
from .nodes import JOINT, Nodes


def core_nodes(nodes: Nodes) -> list[int]:
    """Return the nodes of the core."""
    return sorted(node for node in {nodes.top, nodes.path} if node >= 0)


def stream_numbers(nodes: Nodes, parts: Sequence[BodyPart], streams: int) -> IntArray:
    """Return the stream (nodes,) of each node, where a rest has so many: one, or one a part."""
    return part_numbers(nodes, parts) if streams > 1 else np.zeros(nodes.count, np.int64)


def part_numbers(nodes: Nodes, parts: Sequence[BodyPart]) -> IntArray:
    """Return the number (nodes,) of the body part that each node is in."""
    owner = {joint: number for number, part in enumerate(parts) for joint in part.joints}
    joints = nodes.table[:, JOINT].tolist()
    return np.array([owner[joint] for joint in joints], np.int64)


def needed_parts(nodes: Nodes, rig: Rig, wanted: Iterable[int]) -> frozenset[int]:
    """Return the numbers of the parts that must be decoded for some parts, those included.

    Those above them; and those of the core's joints, because other clips may not have these in
    their cores.
    """
    owners = part_numbers(nodes, rig.parts)[core_nodes(nodes)].tolist()
    return frozenset(above(rig.parts, rig.skeleton, [*wanted, *owners]))


def nodes_of_parts(nodes: Nodes, parts: Sequence[BodyPart], wanted: Iterable[int]) -> IntArray:
    """Return the nodes, ascending, of some parts (as by `needed_parts`) and of the core."""
    chosen = np.isin(part_numbers(nodes, parts), list(wanted))
    chosen[core_nodes(nodes)] = True
    return np.flatnonzero(chosen)
