"""Moments of a clip that a copy of it has, too: how near duplicates find each other.

A landmark is a frame whose pose is the most of something for a while around. An excerpt has the
landmarks of what it was cut from, wherever the cut was, at another frame rate too, and in other
places and headings. So a copy is found by looking up a few poses, not by comparing clips.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter1d

from ..blocks.guided import guided_poses
from ..blocks.nodes import JOINT, ROW, Nodes
from ..clip import FloatArray, IntArray
from ..figure.rig import Rig

NUMBERS = 24
WAYS = 2  # numbers of which a landmark may be the largest or the smallest
GRAIN = 2.0**-16  # centimetres: machines differ far below it
AROUND = 0.15  # seconds to both sides within which a landmark is the largest


@dataclass(frozen=True, eq=False)
class Landmarks:
    """The landmarks of a clip.

    ``frames``: (landmarks,) ascending; ``poses``: (landmarks, 24), whose distances are about
    centimetres, root of the sum over joints; ``length``: of the clip, frames; ``frame_time``:
    seconds.
    """

    frames: IntArray
    poses: npt.NDArray[np.float32]
    length: int
    frame_time: float


def landmarks_of(path: IntArray, nodes: Nodes, rig: Rig) -> Landmarks:
    """Return the landmarks of a clip ``path`` (frames, nodes, 4)."""
    poses = _projected(path, nodes, rig)
    around = max(round(AROUND / rig.frame_time), 1)
    heights = np.concatenate([poses[:, :WAYS], -poses[:, :WAYS]], axis=1)
    most = np.zeros(heights.shape, np.bool_)
    inner = slice(around, max(len(heights) - around, around))  # who knows what was outside
    if len(heights[inner]):
        most[inner] = (heights >= maximum_filter1d(heights, 2 * around + 1, axis=0))[inner]
        most[1:] &= heights[1:] > heights[:-1]  # what stands still has no landmark
    frames = np.flatnonzero(most.any(axis=1))
    return Landmarks(frames, poses[frames].astype(np.float32), len(path), rig.frame_time)


def _projected(path: IntArray, nodes: Nodes, rig: Rig) -> FloatArray:
    """Return (frames, 24) numbers of each pose as guides see it: random projections.

    Distances survive (Johnson and Lindenstrauss), and clips need not have the same nodes. The
    root part is left out: which of its joints has no guide depends on what moves in a clip.
    """
    rows = 2 * rig.skeleton.joints
    roots = [joint for part in rig.parts if part.parent < 0 for joint in part.joints]
    seen = guided_poses(path, nodes, ~np.isin(nodes.table[:, JOINT], roots))
    flat = np.zeros((len(path), rows, 3))
    angles = np.where(seen.turns[..., :1] < 0.0, -2.0, 2.0) * seen.turns[..., 1:]
    flat[:, nodes.table[seen.turning, ROW]] = angles * seen.levers[:, None]
    flat[:, nodes.table[seen.placed, ROW]] = seen.places
    signs = np.random.default_rng(rows).choice([-1.0, 1.0], (3 * rows, NUMBERS))
    projected = flat.reshape(len(path), 3 * rows) @ signs / np.sqrt(NUMBERS)
    return np.asarray(np.rint(projected / GRAIN) * GRAIN)
