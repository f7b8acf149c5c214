"""The encoder's search for leads: which frames of a clip go as a reference goes.

Somebody says about where to look (a `Hint`); here frame is laid beside frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ..arithmetic.fixedpoint import ONE
from ..blocks.blockcontext import UNIT_BITS
from ..blocks.guided import Guided, guided_poses
from ..blocks.leads import Lead, Move, Track, moved
from ..blocks.nodes import GUIDE, KIND, LEVER, PLACE, Nodes
from ..clip import BoolArray, FloatArray, IntArray
from ..figure.rig import LEVER_SCALE
from ..geometry.rotations import from_quaternions

ALIKE = 1.0  # centimetres apart, root of the mean square over nodes: less is worth a trial
ROUNDED = 3.0  # times the tolerance, besides: references are not what they were
LEAST_BLOCKS = 2  # a shorter lead does not pay for its numbers


@dataclass(frozen=True)
class Hint:
    """Where a clip may go as a reference does.

    ``reference``: its place among the clip's references; ``shift``: the reference's frame that
    the clip's frame 0 is like, or would be, give or take a stride; ``stride``: frames of the
    reference from one to the next.
    """

    reference: int
    shift: int
    stride: int


def find_leads(
    path: IntArray,
    nodes: Nodes,
    tracks: Sequence[Track],
    hints: Sequence[Hint],
    span: int,
    tolerance: float,
) -> tuple[Lead, ...]:
    """Return leads for a clip ``path`` (frames, nodes, 4), as far as hints are right.

    ``tracks``: of its references; ``tolerance``: centimetres, that they were coded with. The
    first hint that is right about a frame has it.
    """
    alike = ALIKE + ROUNDED * tolerance
    free = np.ones(len(path), np.bool_)
    leads: list[Lead] = []
    for hint in hints:
        track = tracks[hint.reference]
        source, there = track.seen_by(nodes)
        compared = there & there[nodes.table[:, GUIDE]]
        if not there.any() or not len(path):
            continue
        own = guided_poses(path, nodes, compared)
        theirs = guided_poses(track.state[:, source], nodes, compared)
        shifts = range(hint.shift - hint.stride, hint.shift + hint.stride + 1)
        apart, shift = min(
            ((_apart(own, theirs, shift, hint.stride), shift) for shift in shifts),
            key=lambda each: float(np.minimum(each[0], alike).sum()),
        )
        for first, stop in _stretches(free & (apart < alike), LEAST_BLOCKS * span + 1):
            start = shift + hint.stride * first
            frames = np.minimum(start + hint.stride * np.arange(stop - first), len(track.state) - 1)
            like = track.state[frames][:, source]
            move = _move_of(path[first:stop], like, nodes, there, 0.1 * tolerance)
            leads.append(Lead(hint.reference, first, stop - first, start, hint.stride, move))
            free[first:stop] = False
    return tuple(sorted(leads, key=lambda lead: lead.first))


def _apart(own: Guided, theirs: Guided, shift: int, stride: int) -> FloatArray:
    """Return how far (frames,) a clip is from a reference, centimetres; infinite outside it."""
    like = shift + stride * np.arange(len(own.turns))
    inside = np.flatnonzero((like >= 0) & (like < len(theirs.turns)))
    out = np.full(len(like), np.inf)
    same = np.abs((own.turns[inside] * theirs.turns[like[inside]]).sum(axis=2))
    off = _angles_squared(same) * np.square(own.levers)
    away = np.square(own.places[inside] - theirs.places[like[inside]]).sum(axis=2)
    count = max(off.shape[1] + away.shape[1], 1)
    out[inside] = np.sqrt((off.sum(axis=1) + away.sum(axis=1)) / count)
    return out


def _angles_squared(same: FloatArray) -> FloatArray:
    """Return about the squared angles between turns; ``same``: products of their quaternions."""
    return np.asarray(8.0 * np.maximum(1.0 - same, 0.0))


def _stretches(wanted: BoolArray, least: int) -> list[tuple[int, int]]:
    """Return (start, stop) of stretches of at least ``least`` wanted frames."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wanted, [False]]).astype(np.int8)))
    pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(start, stop) for start, stop in pairs if stop - start >= least]


def _move_of(
    path: IntArray, like: IntArray, nodes: Nodes, there: BoolArray, least: float
) -> Move | None:
    """Return how a figure is moved from where it is like, or None if it hardly is.

    The rotation that fits the turns of all joints and the points of the path best (Kabsch 1976),
    and then the shift. ``least``: centimetres that a move must bring a figure nearer.
    """
    turning = np.flatnonzero(there & (nodes.table[:, KIND] != PLACE))
    placed = np.flatnonzero(there & (nodes.table[:, KIND] == PLACE))
    if len(turning):
        placed = placed[placed == nodes.path]
    own, theirs = (from_quaternions(each[:, turning] / ONE) for each in (path, like))
    levers = np.square(nodes.table[turning, LEVER] / LEVER_SCALE)
    here, away = (each[:, placed, :3] / float(1 << UNIT_BITS) for each in (path, like))
    middles = [each.mean(axis=(0, 1)) if each.size else np.zeros(3) for each in (here, away)]
    spread = np.einsum("n,fnij,fnkj->ik", levers, own, theirs)
    spread += np.einsum("fni,fnk->ik", here - middles[0], away - middles[1])
    left, _, right = np.linalg.svd(spread)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    vector = Rotation.from_matrix(turn).as_rotvec() * (1 << 20)
    shift = (middles[0] - turn @ middles[1]) * (1 << (UNIT_BITS - 10)) if here.size else np.zeros(3)
    x, y, z, right_on, up, ahead = np.rint([*vector, *shift]).astype(np.int64).tolist()
    move = (x, y, z, right_on, up, ahead)
    off = [_off(path, moved(like, nodes, each), nodes, there) for each in (None, move)]
    return move if off[1] < off[0] - least else None


def _off(path: IntArray, like: IntArray, nodes: Nodes, there: BoolArray) -> float:
    """Return how far a figure is from where it is like, centimetres, in the mean."""
    off = 0.0
    if nodes.path >= 0 and there[nodes.path]:
        apart = (path[:, nodes.path, :3] - like[:, nodes.path, :3]) / float(1 << UNIT_BITS)
        off += float(np.linalg.norm(apart, axis=1).mean())
    if nodes.top >= 0 and there[nodes.top]:
        same = np.abs((path[:, nodes.top] / ONE * (like[:, nodes.top] / ONE)).sum(axis=1))
        lever = nodes.table[nodes.top, LEVER] / LEVER_SCALE
        off += float(np.sqrt(_angles_squared(same)).mean() * lever)
    return off
