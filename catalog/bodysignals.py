"""What a body does, whatever rig it has: a few points per body part, ten times a second.

A point is measured from its part's own first joint, in the direction that the body faces, and
in centimetres of a body of usual size; so neither place nor heading, actor nor rig matters.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..codec.clip import Clip, FloatArray, MarkerClip
from ..codec.figure.bodyparts import BodyPart
from ..codec.figure.bodysize import head_diagonal, marker_head_diagonal
from ..codec.geometry.kinematics import end_positions, world_positions, world_rotations

RATE = 10.0
"""Samples a second."""
PARTS = ("root", "spine", "head", "left_arm", "right_arm", "left_leg", "right_leg")
"""The body parts that are searched: those that bodies of all kinds of rigs share."""
USUAL_HEAD = 20.0  # centimetres: the head diagonal that bodies are scaled to
TURN_WEIGHT = 20.0  # centimetres for a radian a second of the root's turning
PATH_WEIGHT = 0.3  # centimetres for a centimetre a second of the root's path
_STEADY = 3  # samples that a heading is averaged over
_FOLLOWS = {"arm": "hand", "leg": "foot"}  # the part whose first joint ends a limb

Signals = dict[str, FloatArray]
Points = dict[str, list[int]]


def body_signals(clip: Clip, parts: tuple[BodyPart, ...]) -> Signals:
    """Return the signals (samples, channels) of each of `PARTS` that the clip's body has.

    ``parts``: the clip's body parts. A clip of no frames has no signals. Of a limb: its middle
    joint and its end, in centimetres from its first joint; of the spine and the head: their
    end. Of the root: its velocity, its turning about the vertical and its height, weighted as
    above. Gaps of markers are bridged in a straight line.
    """
    points, chosen, size = _points(clip, parts)
    if not len(points) or "root" not in chosen:
        return {}
    points = _upright(points, chosen) * (USUAL_HEAD / size)
    points = resampled(points, clip.frame_time)
    turn, yaw = _headings(points, chosen)
    found = {}
    for name, (first, *others) in chosen.items():
        if name == "root":
            found[name] = _root_signal(points[:, first], turn, yaw)
        else:
            gaps = points[:, others] - points[:, [first]]
            found[name] = np.einsum("fij,fpj->fpi", turn, gaps).reshape(len(points), -1)
    return {name: found[name] for name in PARTS if name in found}


def joint_points(clip: Clip) -> FloatArray:
    """Return (frames, joints and end sites, or markers, 3) world positions, centimetres."""
    if isinstance(clip, MarkerClip):
        return _bridged(clip.positions)
    world = world_rotations(clip.skeleton, clip.rotations)
    positions = world_positions(clip.skeleton, world, clip.translations)
    return np.concatenate([positions, end_positions(clip.skeleton, world, positions)], axis=1)


def faced(clip: Clip, parts: tuple[BodyPart, ...], *, steady: bool = False) -> FloatArray:
    """Return (frames, joints, 3) positions from the root's, turned so that the body faces +Z.

    In centimetres, at the clip's own frame rate; markers with gaps bridged. Joints above the
    root's, which stand somewhere in the world, are put at the root: where they are from it says
    where the body is. ``steady``: only the first frame faces +Z, so that turns remain.
    """
    points, chosen, _ = _points(clip, parts)
    if not len(points) or "root" not in chosen:
        return np.zeros((0, points.shape[1], 3))
    points = _upright(points, chosen)
    turn, _ = _headings(points, chosen)
    if steady:
        turn = np.broadcast_to(turn[:1], turn.shape)
    own = points if isinstance(clip, MarkerClip) else points[:, : clip.skeleton.joints]
    out = np.einsum("fij,fpj->fpi", turn, own - points[:, chosen["root"]])
    if not isinstance(clip, MarkerClip):
        above = clip.skeleton.parents[chosen["root"][0]]
        while above >= 0:
            out[:, above] = 0.0
            above = clip.skeleton.parents[above]
    return np.asarray(out)


def resampled(points: FloatArray, frame_time: float, rate: float = RATE) -> FloatArray:
    """Return points (frames, …) at ``rate`` samples a second: means of the frames about them."""
    frames = len(points)
    flat = points.reshape(frames, -1)
    width = round(1.0 / (rate * frame_time)) if frame_time > 0 else 1
    if width > 1:
        flat = _smoothed(flat, width)
    at = np.arange(round((frames - 1) * frame_time * rate) + 1) / (rate * frame_time)
    at = np.minimum(at, frames - 1)
    low = at.astype(np.int64)
    high = np.minimum(low + 1, frames - 1)
    share = (at - low)[:, None]
    return np.asarray((flat[low] * (1 - share) + flat[high] * share).reshape(-1, *points.shape[1:]))


def _smoothed(values: FloatArray, width: int) -> FloatArray:
    """Return means of ``width`` frames about each; the first and last are held beyond the ends.

    What SciPy's filter does, which takes longer to import than a search.
    """
    ends = [(width // 2, (width - 1) // 2)] + [(0, 0)] * (values.ndim - 1)
    sums = np.cumsum(np.pad(values, ends, mode="edge"), axis=0)
    sums = np.concatenate([np.zeros_like(sums[:1]), sums])
    return np.asarray((sums[width:] - sums[:-width]) / width)


def _points(clip: Clip, parts: tuple[BodyPart, ...]) -> tuple[FloatArray, Points, float]:
    """Return all points of a clip, those of each part (the first is the origin), body size."""
    named = {part.name: part for part in parts}
    if isinstance(clip, MarkerClip):
        size = marker_head_diagonal(clip.names, clip.positions) if clip.frames else USUAL_HEAD
        chosen = _marker_points(named)
        points = joint_points(clip)
        lost = np.asarray(np.isnan(points).any(axis=(0, 2)))
        chosen = {name: at for name, at in chosen.items() if not lost[at].any()}
        return points, chosen, size
    ends = {
        int(joint): clip.skeleton.joints + i for i, joint in enumerate(clip.skeleton.end_parents)
    }
    return joint_points(clip), _joint_points(named, ends), head_diagonal(clip.skeleton)


def _joint_points(parts: dict[str, BodyPart], ends: dict[int, int]) -> Points:
    chosen: Points = {}
    if "root" in parts:
        chosen["root"] = [parts["root"].reference]
    if "spine" in parts and "root" in parts:
        top = parts["head"].joints[0] if "head" in parts else parts["spine"].reference
        chosen["spine"] = [parts["root"].reference, top]
    if "head" in parts:
        first, last = parts["head"].joints[0], parts["head"].joints[-1]
        chosen["head"] = [first, last if last != first else ends.get(last, last)]
    for name, part in parts.items():
        side, _, limb = name.partition("_")
        if limb not in _FOLLOWS:
            continue
        end = parts.get(f"{side}_{_FOLLOWS[limb]}")
        tip = end.joints[0] if end else ends.get(part.joints[-1], part.joints[-1])
        chosen[name] = [part.joints[0], part.reference, tip]
    return chosen


def _marker_points(parts: dict[str, BodyPart]) -> Points:
    chosen = {"root": [parts["root"].reference]} if "root" in parts else {}
    torso = parts.get("torso")
    if not torso or "root" not in parts:
        return chosen
    chosen["spine"] = [parts["root"].reference, torso.reference]
    if "head" in parts:
        chosen["head"] = [torso.reference, parts["head"].reference]
    for side in ("left", "right"):
        for limb, before in (("arm", f"{side}_shoulder"), ("leg", "root")):
            own, end = parts.get(f"{side}_{limb}"), parts.get(f"{side}_{_FOLLOWS[limb]}")
            if own and end:
                first = parts.get(before, torso).reference
                chosen[f"{side}_{limb}"] = [first, own.reference, end.reference]
    return chosen


def _bridged(positions: FloatArray) -> FloatArray:
    """Return marker positions with gaps filled in a straight line; NaN where never seen."""
    out = positions.copy()
    frames = np.arange(len(out))
    for marker in range(out.shape[1]):
        seen = ~np.isnan(out[:, marker]).any(axis=1)
        if seen.any() and not seen.all():
            for axis in range(3):
                out[:, marker, axis] = np.interp(frames, frames[seen], out[seen, marker, axis])
    return out


def _upright(points: FloatArray, chosen: Points) -> FloatArray:
    """Return the points with +Y up: the axis that the head, or the hips, are highest along."""
    high = chosen.get("head", chosen["root"])[-1]
    low = [chosen[name][-1] for name in ("left_leg", "right_leg") if name in chosen]
    low = low or chosen["root"]
    rise = (points[:, high] - points[:, low].mean(axis=1)).mean(axis=0)
    axis = int(np.abs(rise).argmax())
    if not np.abs(rise).any() or (axis == 1 and rise[1] > 0):
        return points
    up, right = np.zeros(3), np.zeros(3)
    up[axis], right[0 if axis else 1] = np.sign(rise[axis]), 1.0
    return np.asarray(points @ np.stack([right, up, np.cross(right, up)]).T)


def _headings(points: FloatArray, chosen: Points) -> tuple[FloatArray, FloatArray]:
    """Return (frames, 3, 3) turns that make the body face +Z, and its yaw (frames,), radians.

    The body faces away from the line from its right to its left side; without sides, along +Z.
    """
    across = np.zeros((len(points), 3))
    for limb in ("arm", "leg"):
        if {f"left_{limb}", f"right_{limb}"} <= chosen.keys():
            across += points[:, chosen[f"left_{limb}"][0]] - points[:, chosen[f"right_{limb}"][0]]
    if not across.any() and {"left_leg", "right_leg"} <= chosen.keys():  # markers share the root
        across = points[:, chosen["left_leg"][1]] - points[:, chosen["right_leg"][1]]
    yaw = np.unwrap(np.arctan2(-across[:, 2], across[:, 0]))
    yaw = _smoothed(yaw, _STEADY)
    turn = np.zeros((len(points), 3, 3))
    turn[:, 0, 0] = turn[:, 2, 2] = np.cos(yaw)
    turn[:, 0, 2] = -np.sin(yaw)
    turn[:, 2, 0] = np.sin(yaw)
    turn[:, 1, 1] = 1.0
    return turn, yaw


def _root_signal(root: FloatArray, turn: FloatArray, yaw: FloatArray) -> FloatArray:
    if len(root) < 2:
        speed, turning = np.zeros_like(root), np.zeros(len(root))
    else:
        speed, turning = np.gradient(root, 1 / RATE, axis=0), np.gradient(yaw, 1 / RATE)
    ahead = np.einsum("fij,fj->fi", turn, speed) * PATH_WEIGHT
    return np.column_stack([ahead, turning * TURN_WEIGHT, root[:, 1]])


def mirror_signs(part: str, channels: int) -> FloatArray:
    """Return what a part's channels are multiplied with to look into a mirror (channels,)."""
    if part == "root":
        return np.array([-1.0, 1.0, 1.0, -1.0, 1.0])
    return np.tile([-1.0, 1.0, 1.0], channels // 3)


def known_parts(names: Iterable[str]) -> list[str]:
    """Return which of some parts are searched, in the order of `PARTS`."""
    wanted = set(names)
    return [name for name in PARTS if name in wanted]
