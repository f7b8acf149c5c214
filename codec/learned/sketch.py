"""A clip in a few numbers a moment, to find the clips that it could be predicted from."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..blocks.motionmodel import fixed_model, usual_span
from ..blocks.nodes import FOLLOWER, KIND, ROW, Nodes
from ..blocks.recall import remember
from ..clip import IntArray
from ..figure.rig import Rig

SKETCH_NUMBERS = 24
COMPARED = 12  # of the keys: velocity, acceleration, pose and up; not the guide's future
STRIDE = 4  # remembered moments from one sketched moment to the next

Sketch = npt.NDArray[np.float32]


def sketch_of(path: IntArray, nodes: Nodes, rig: Rig) -> Sketch:
    """Return (moments, 24) numbers whose distances are like those of whole-body motion.

    ``path``: (frames, nodes, 4) turns and places. What retrieval compares of every node,
    projected by fixed random signs (Johnson and Lindenstrauss): distances survive, and clips
    need not share their varying joints. They are whole, 1/64 cm, so that distances are exact and
    every machine finds the same neighbours.
    """
    rows = 2 * rig.skeleton.joints
    span = usual_span(rig.frame_time)
    model = fixed_model(rows, span)
    nothing = np.zeros_like(model.weights)
    memory = remember(path, len(path), nodes.table, span, model.lags, model.up, nothing)
    keys = memory.keys[:, ::STRIDE, :COMPARED].astype(np.float64)
    active = nodes.table[nodes.table[:, KIND] != FOLLOWER, ROW]
    flat = np.zeros((rows, keys.shape[1], COMPARED))
    flat[active] = keys[active]
    signs = np.random.default_rng(rows).choice([-1.0, 1.0], (rows * COMPARED, SKETCH_NUMBERS))
    moments = flat.transpose(1, 0, 2).reshape(keys.shape[1], rows * COMPARED)
    projected = moments @ signs / np.sqrt(SKETCH_NUMBERS)
    return np.asarray(np.rint(projected), np.float32)
