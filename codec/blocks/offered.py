"""What a decoded clip offers to clips that are predicted from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..clip import IntArray
from .leads import Track
from .motionmodel import MotionModel
from .nodes import ROW, Nodes
from .recall import Memory, joined, remember
from .startpose import poses_of


@dataclass(frozen=True, eq=False)
class Reference:
    """A decoded clip that others may be predicted from.

    ``memory``: its moments; ``poses``: to start from; ``track``: what others may follow.
    """

    memory: Memory
    poses: IntArray
    track: Track

    @property
    def size(self) -> int:
        """Bytes of memory that it takes."""
        moments = self.memory.keys.nbytes + self.memory.follows.nbytes
        return moments + self.poses.nbytes + self.track.state.nbytes


def reference_of(states: Sequence[IntArray], nodes: Nodes, model: MotionModel) -> Reference:
    """Return what a clip's decoded runs, (frames, nodes, 4) each, offer to others."""
    memories = [
        remember(state, len(state), nodes.table, model.span, model.lags, model.up, model.weights)
        for state in states
    ]
    poses = [poses_of(state, len(state), nodes, model.rows) for state in states]
    return Reference(
        joined(memories, model.rows, model.channels),
        np.concatenate([np.zeros((0, model.rows, 4), np.int64), *poses]),
        Track(
            np.concatenate([np.zeros((0, nodes.count, 4), np.int64), *states]),
            nodes.table[:, ROW],
        ),
    )
