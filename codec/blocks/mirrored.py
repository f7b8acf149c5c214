"""A decoded clip in a mirror, so that what the left did is known to the right, too."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ..clip import IntArray
from ..figure.mirror import SIGNS
from ..figure.rig import Family, Rig
from .nodes import FOLLOWER, JOINT, KIND, PLACE, Nodes, skeleton_nodes

# i q u: where w, x, y and z of the image come from, and their signs, for u of 1, i, j and k
_FROM = np.array([[1, 0, 3, 2], [0, 1, 2, 3], [3, 2, 1, 0], [2, 3, 0, 1]])
_SIGNS = np.array([[-1, 1, -1, 1], [1, 1, -1, -1], [1, -1, -1, 1], [1, 1, 1, 1]])


def mirrored(
    states: Sequence[IntArray],
    nodes: Nodes,
    rig: Rig,
    family: Family,
    still: Collection[int],
    sliding: Collection[int],
) -> tuple[tuple[IntArray, ...], Nodes] | None:
    """Return the mirror image of a skeleton clip's runs, (frames, nodes, 4) each, and its nodes.

    ``nodes``: of the runs, some of those that ``still`` and ``sliding`` make; the image has
    their partners. None if the figure has no image: one side of it is another than the other,
    or the root's path would be another joint's.
    """
    partner = dict(enumerate(joint for joint, _ in family.mirror))
    if not partner:
        return None
    images = {partner[joint] for joint in still}, {partner[joint] for joint in sliding}
    whole = skeleton_nodes(rig, family, frozenset(images[0]), tuple(sorted(images[1])))
    source = [
        nodes.of_joint.get((bool(row[KIND] == PLACE), partner[int(row[JOINT])]), -1)
        for row in whole.table
    ]
    kept = np.flatnonzero(np.array(source, np.int64) >= 0)
    if len(kept) != nodes.count:
        return None
    own = whole if len(kept) == whole.count else whole.only(kept)
    order = np.array(source, np.int64)[kept]
    for one, other in ((nodes.top, own.top), (nodes.path, own.path)):
        if one != (order[other] if other >= 0 else -1):
            return None
    return tuple(_image(state[:, order], own, rig, family) for state in states), own


def image_of(
    states: Sequence[IntArray], nodes: Nodes, rig: Rig, family: Family
) -> tuple[tuple[IntArray, ...], Nodes] | None:
    """Return the mirror image of a clip that has all of its nodes; see `mirrored`."""
    kinds, joints = nodes.table[:, KIND], nodes.table[:, JOINT]
    still, sliding = joints[kinds == FOLLOWER].tolist(), joints[kinds == PLACE].tolist()
    return mirrored(states, nodes, rig, family, still, sliding)


def _image(state: IntArray, nodes: Nodes, rig: Rig, family: Family) -> IntArray:
    """Return the image of frames that are in its nodes' order already."""
    out = np.empty_like(state)
    for node, row in enumerate(nodes.table):
        joint = int(row[JOINT])
        if row[KIND] != PLACE:
            axes = family.mirror[joint][1]
            out[:, node] = _SIGNS[axes] * state[:, node][:, _FROM[axes]]
            continue
        above = int(rig.skeleton.parents[joint])
        in_world = node == nodes.path or above < 0
        signs = SIGNS[1] if in_world else SIGNS[family.mirror[above][1]]
        out[:, node, :3] = signs * state[:, node, :3]
        out[:, node, 3] = state[:, node, 3]
    return out
