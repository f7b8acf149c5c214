"""Poses as guides see them: what a figure does, wherever it stands and faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arithmetic.fixedpoint import ONE
from ..clip import BoolArray, FloatArray, IntArray
from ..figure.rig import LEVER_SCALE
from ..geometry.quaternions import multiply
from .blockcontext import UNIT_BITS
from .nodes import GUIDE, KIND, LEVER, PLACE, Nodes


@dataclass(frozen=True, eq=False)
class Guided:
    """Poses of nodes that have guides: the turns of a skeleton, or the places of markers.

    ``turning`` and ``placed``: numbers of the nodes; ``turns``: (frames, turning nodes, 4) unit
    quaternions; ``levers``: (turning nodes,) centimetres a radian; ``places``: (frames, placed
    nodes, 3) centimetres, in the axes of the world.
    """

    turning: IntArray
    turns: FloatArray
    levers: FloatArray
    placed: IntArray
    places: FloatArray


def guided_poses(state: IntArray, nodes: Nodes, among: BoolArray) -> Guided:
    """Return the poses of a state (frames, nodes, 4), of the nodes ``among`` (nodes,) only."""
    table = nodes.table
    guided = among & (table[:, GUIDE] >= 0)
    turning = np.flatnonzero(guided & (table[:, KIND] != PLACE))
    placed = np.flatnonzero(guided & (table[:, KIND] == PLACE))
    if (table[:, KIND] != PLACE).any():
        placed = placed[:0]
    above = state[:, table[turning, GUIDE]] / ONE * np.array([1.0, -1.0, -1.0, -1.0])
    away = state[:, placed, :3] - state[:, table[placed, GUIDE], :3]
    return Guided(
        turning,
        multiply(above, state[:, turning] / ONE),
        table[turning, LEVER] / LEVER_SCALE,
        placed,
        away / float(1 << UNIT_BITS),
    )
