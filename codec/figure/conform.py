"""Decoded rotations brought back to what the rig's joints can do.

A hinge in a file has one rotation channel. Rounding in three dimensions leaves it a trace of
turn about its other axes that the file could not hold; the decoder takes it out, so that the
certificate speaks of the motion that a restored file shows.
"""

from __future__ import annotations

import numpy as np

from ..clip import FloatArray, Layout, Skeleton
from ..formats.channels import rotation_order
from ..geometry.rotations import from_euler, to_euler


def conformed(skeleton: Skeleton, layout: Layout, world: FloatArray) -> FloatArray:
    """Return world rotations (frames, joints, 3, 3) that the layout's channels can express.

    Joints with three rotation channels keep their world orientation, whatever changes above
    them; a joint with fewer gets the nearest local rotation that it can make.
    """
    orders = [rotation_order(names) for names in layout.channels]
    if not any(len(order) < 3 for order in orders):
        return world
    out = world.copy()
    for joint, order in enumerate(orders):
        if len(order) == 3:
            continue
        parent = skeleton.parents[joint]
        above = np.eye(3) if parent < 0 else out[:, parent]
        local = np.swapaxes(above, -1, -2) @ world[:, joint]
        out[:, joint] = above @ from_euler(order, to_euler(order, local))
    return out
