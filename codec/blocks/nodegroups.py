"""Which nodes are decoded together, and which stream each of them is read from."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..clip import IntArray
from .nodes import FOLLOWER, KIND, Nodes
from .partnodes import core_nodes

CORE = -1  # the number that stands for the core's stream


@dataclass(frozen=True)
class Share:
    """What a stream has of a group: its nodes from ``low`` to ``high`` (exclusive)."""

    stream: int
    low: int
    high: int


@dataclass(frozen=True, eq=False)
class Group:
    """Nodes that are decoded together: followers, which are in no stream, or others."""

    nodes: IntArray
    shares: list[Share]


def groups_of(nodes: Nodes, streams: IntArray, core_only: bool) -> list[Group]:
    """Return the core's nodes one by one, then the others level by level.

    ``streams``: (nodes,) of the rest, see `partnodes.stream_numbers`.
    """
    in_core = core_nodes(nodes)
    groups = [Group(np.array([node]), [Share(CORE, 0, 1)]) for node in in_core]
    for low, high in [] if core_only else pairwise(nodes.levels.tolist()):
        level = np.setdiff1d(np.arange(low, high), in_core)
        held = nodes.table[level, KIND] == FOLLOWER
        coded = level[~held]
        coded = coded[np.argsort(streams[coded], kind="stable")]
        numbers, firsts = np.unique(streams[coded], return_index=True)
        borders = pairwise([*firsts.tolist(), len(coded)])
        shares = [Share(n, *border) for n, border in zip(numbers.tolist(), borders, strict=True)]
        groups += [Group(level[held], []), Group(coded, shares)]
    return [group for group in groups if len(group.nodes)]
