"""What a clip looks like in the poses of others: its preview, and its words for a search.

Every sixteen frames a clip names the pose, among those that its reference clips offer, that is most
like its own. Poses in between are blended: the preview scheme of Gu, Peng & Deng (2009,
Section 4.2), with whole poses on the exact path of the root.
"""

from __future__ import annotations

import numpy as np

from ..arithmetic.fixedpoint import ONE
from ..clip import FloatArray, IntArray
from ..geometry.quaternions import multiply
from ..streams.entropy import SymbolReader, SymbolWriter
from .nodes import GUIDE, KIND, PLACE, ROW, Nodes
from .startpose import POSE_STRIDE, pose_distances

MOTIF_FRAMES = 2 * POSE_STRIDE  # a clip that goes on like its reference goes on by two poses
LOYALTY = 3.0  # a motif goes on from the last if its squared distance is not larger by this


def motif_frames(frames: int) -> list[int]:
    """Return the frames of a run that name a pose: evenly spaced, and the last one."""
    return sorted({*range(0, frames, MOTIF_FRAMES), frames - 1}) if frames else []


def choose_motifs(goal: IntArray, nodes: Nodes, poses: IntArray, first: int) -> IntArray:
    """Return the number of a pose that is like the clip at every motif frame of a run.

    The nearest one, or the one that goes on from the last, where that is nearly as near.
    ``goal``: (frames, nodes, 4); ``poses``: (poses, rows, 4), as for `pose_distances`;
    ``first``: the pose that the first frame is coded against.
    """
    found, follower = [], first
    for frame in motif_frames(len(goal)):
        away = pose_distances(goal[frame], nodes, poses)
        nearest = int(away.argmin())
        if 0 < follower < len(poses) and away[follower] <= LOYALTY * away[nearest]:
            nearest = follower
        found.append(nearest)
        follower = nearest + 2
    return np.array(found, np.int64)


def write_motifs(writer: SymbolWriter, motifs: IntArray, poses: int, first: int) -> None:
    """Write pose numbers; one that goes on from the last is a single bit.

    ``first``: the pose that the first frame is coded against.
    """
    before = first - 2
    for motif in motifs.tolist() if poses > 2 else ():
        writer.uniform([int(motif == before + 2)], 2)
        if motif != before + 2:
            writer.uniform([motif], poses)
        before = motif


def read_motifs(reader: SymbolReader, frames: int, poses: int, first: int) -> IntArray:
    """Return what `write_motifs` was given for a run of ``frames``. Raises `DamagedError`."""
    count = len(motif_frames(frames))
    if poses <= 2:
        return np.full(count, poses - 1, np.int64)
    out, before = [], first - 2
    for _ in range(count):
        follows = bool(reader.uniform(1, 2)[0]) and before + 2 < poses
        before = before + 2 if follows else int(reader.uniform(1, poses)[0])
        out.append(before)
    return np.array(out, np.int64)


def preview_state(
    core: IntArray, nodes: Nodes, exact: list[int], poses: IntArray, motifs: IntArray
) -> IntArray:
    """Return the state (frames, nodes, 4) of a run's preview.

    ``core``: a state in which the nodes ``exact`` are decoded; all others are posed by the
    motifs, blended from one to the next.
    """
    frames = np.array(motif_frames(len(core)), np.int64)
    state = core.copy()
    times = np.arange(len(core))
    after = np.clip(np.searchsorted(frames, times, side="right"), 1, max(len(frames) - 1, 1))
    after = np.minimum(after, len(frames) - 1)
    before = np.maximum(after - 1, 0)
    gap = np.maximum(frames[after] - frames[before], 1)
    share = ((times - frames[before]) / gap)[:, None]
    for node in range(nodes.count):
        if node in exact:
            continue
        row, guide = nodes.table[node, ROW], nodes.table[node, GUIDE]
        known = _of_row(poses, int(row))
        if nodes.table[node, KIND] == PLACE:
            if guide >= 0:
                known = known - _of_row(poses, int(nodes.table[guide, ROW]))
            chosen = known[motifs].astype(np.float64)
            blend = chosen[before] * (1.0 - share) + chosen[after] * share
            state[:, node] = np.rint(blend) + (state[:, guide] if guide >= 0 else 0)
            continue
        local = known / ONE
        if guide >= 0:
            held = _of_row(poses, int(nodes.table[guide, ROW])) / ONE
            local = multiply(held * np.array([1.0, -1.0, -1.0, -1.0]), local)
        turned = _blended(local[motifs], before, after, share)
        if guide >= 0:
            turned = multiply(state[:, guide] / ONE, turned)
        state[:, node] = np.rint(turned * ONE)
    return state


def _of_row(poses: IntArray, row: int) -> IntArray:
    """Return a row of all poses (poses, 4); the usual pose's where one does not have it."""
    there = np.asarray(poses[:, row].any(axis=1))
    return np.asarray(np.where(there[:, None], poses[:, row], poses[0, row]))


def _blended(turns: FloatArray, before: IntArray, after: IntArray, share: FloatArray) -> FloatArray:
    """Return quaternions between those of two motifs, the short way round."""
    first, second = turns[before], turns[after]
    second = np.where((first * second).sum(axis=1)[:, None] < 0.0, -second, second)
    mixed = first * (1.0 - share) + second * share
    return np.asarray(mixed / np.maximum(np.linalg.norm(mixed, axis=1)[:, None], 1e-9))
