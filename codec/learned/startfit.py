"""Fitting how far first poses are from the known poses that they are coded against."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ..blocks.motionmodel import MotionModel
from ..blocks.nodes import ROW
from ..blocks.startpose import choose_start, nearest_pose, start_size
from ..clip import IntArray
from .samples import Sample

_FINE_STEP = 1 << 14  # 2^-24 cm: a thousandth of a centimetre
LEAST_STARTS = 8


def fit_starts(
    samples: Sequence[Sample], model: MotionModel, usual: IntArray, poses: Iterable[IntArray]
) -> MotionModel:
    """Return the model with ``starts`` fitted to the samples' first poses.

    ``usual``: (rows, 4) the usual pose; ``poses``: per sample, (poses, rows, 4) of the clips
    that it may refer to.
    """
    total = np.zeros((2, model.rows, 3))
    seen = np.zeros((2, model.rows))
    for sample, known in zip(samples, poses, strict=True):
        both = np.concatenate([usual[None], known])
        for kind in range(min(len(both), 2)):
            pose = nearest_pose(sample.goal[0], sample.nodes, both) if kind else 0
            table = sample.nodes.table
            nothing = np.zeros((len(table), 3), np.int64)
            _, out = choose_start(
                sample.goal,
                sample.nodes,
                sample.yardstick,
                both[pose],
                usual,
                _FINE_STEP,
                0,
                nothing,
                0.0,
            )
            sizes = np.array([start_size(_FINE_STEP, 0, int(row[0])) for row in table])
            total[kind][table[:, ROW]] += np.abs(out) * sizes[:, None] / float(1 << 24)
            seen[kind][table[:, ROW]] += 1
    starts = model.starts.copy()
    for kind in range(2):
        rows = np.flatnonzero(seen[kind] >= LEAST_STARTS)
        mean = total[kind][rows] / seen[kind][rows, None]
        starts[rows, kind] = np.rint(256 * np.log2(np.maximum(mean, 1e-4)))
    return replace(model, starts=starts)
