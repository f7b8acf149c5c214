"""What a decoded clip offers to clips that are predicted from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..clip import IntArray
from .motionmodel import MotionModel
from .nodes import Nodes
from .recall import Memory, joined, remember
from .startpose import poses_of


@dataclass(frozen=True, eq=False)
class Reference:
    """A decoded clip that others may be predicted from: its moments, and poses to start from."""

    memory: Memory
    poses: IntArray

    @property
    def size(self) -> int:
        """Bytes of memory that it takes."""
        return self.memory.keys.nbytes + self.memory.follows.nbytes + self.poses.nbytes


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
    )
