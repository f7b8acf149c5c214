"""SZ3 on the same clips at the same largest shell error (Liang et al. 2022; PyPI ``pysz``).

SZ3 gets, as one row of numbers, channel after channel: the rotation vector of every joint's
local rotation, continued over half a turn, times the joint's lever; and the translation of
the joints that slide, times its weight, as motifold's codec has it. Channels that do not
vary, shapes and rest offsets cost it nothing here. Its absolute bound is the largest found
whose decoded clip, posed by our kinematics, is inside the wanted shell error.

Levers are tried of two kinds. The codec's own are made for world orientations, whose errors do
not add up along the chain; those of local rotations do. The lever by ``reach`` is that of the
farthest point that hangs on the joint, which serves SZ3 better and is thus the harder peer.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from archive_runs import ArchiveRuns, joint_positions
from parallel import in_processes
from rate_curves import Floats

from motifold.codec.clip import Skeleton, SkeletonClip
from motifold.codec.figure.rig import bone_means
from motifold.codec.formats.files import read_clip
from motifold.codec.geometry.kinematics import hanging_joints, levers
from motifold.codec.geometry.metrics import SHELL_CENTIMETRES, clip_errors
from motifold.codec.geometry.rotations import from_axis_angle, to_axis_angle

STILL = 1e-9  # centimetres; a channel that varies less is not given to SZ3
STILL_SHARE = 0.1  # of the tolerance, as in the codec, but at most …
STILL_MOST = 0.02  # centimetres
CLOSE_ENOUGH = 0.99  # of the wanted error
TRIALS = 30


def load_sz3() -> Any:
    """Return the module ``pysz``, or leave with a word on how to get it."""
    try:
        return importlib.import_module("pysz")
    except ImportError as problem:
        raise SystemExit(
            "the comparison with SZ3 needs pysz, which only benchmarks use: pip install pysz "
            "(or leave it out with --only acl growth text)"
        ) from problem


@dataclass(frozen=True, eq=False)
class Channels:
    """A clip as SZ3 sees it: ``values`` (frames, channels), centimetres, and the way back.

    ``varies``: (all channels,) which of them are given; ``rest``: (all channels,) what the
    others are; ``sliding``: joints whose translation is among them.
    """

    clip: SkeletonClip
    values: Floats
    rest: Floats
    varies: np.ndarray[Any, np.dtype[np.bool_]]
    sliding: np.ndarray[Any, np.dtype[np.int64]]
    scale: Floats

    def posed(self, values: Floats) -> SkeletonClip:
        """Return the clip that decoded ``values`` (frames, channels) stand for."""
        clip, joints = self.clip, self.clip.skeleton.joints
        full = np.repeat(self.rest[None], clip.frames, axis=0)
        full[:, self.varies] = values
        full /= self.scale
        vectors = full[:, : 3 * joints].reshape(clip.frames, joints, 3)
        shifts = np.repeat(clip.translations.mean(axis=0)[None], clip.frames, axis=0)
        shifts[:, self.sliding] = full[:, 3 * joints :].reshape(clip.frames, -1, 3)
        return replace(clip, rotations=from_axis_angle(vectors), translations=shifts)


def reach_levers(skeleton: Skeleton) -> Floats:
    """Return levers (joints,), centimetres per radian: to the end of the longest chain below.

    lever² = 3² + (longest sum of offsets from the joint down to a joint or end site)².
    """
    reach = np.zeros(skeleton.joints)
    lengths = np.linalg.norm(skeleton.end_offsets, axis=1)
    np.maximum.at(reach, skeleton.end_parents, lengths)
    for joint in range(skeleton.joints - 1, 0, -1):
        parent = skeleton.parents[joint]
        below = float(np.linalg.norm(skeleton.offsets[joint])) + reach[joint]
        reach[parent] = max(reach[parent], below)
    return np.sqrt(SHELL_CENTIMETRES**2 + reach**2)


LEVERS: Mapping[str, Callable[[Skeleton], Floats]] = {"codec": levers, "reach": reach_levers}


def channels_of(clip: SkeletonClip, tolerance: float, kind: str) -> Channels:
    """Return a clip's channels for a largest error of about ``tolerance`` centimetres.

    ``kind``: of the levers, a key of `LEVERS`.
    """
    skeleton = replace(clip.skeleton, offsets=bone_means(clip))
    vectors = unwrapped(to_axis_angle(clip.rotations))
    moved = np.abs(clip.translations - clip.translations.mean(axis=0)).max(axis=(0, 2))
    sliding = np.flatnonzero(moved > min(STILL_SHARE * tolerance, STILL_MOST))
    turn, weight = LEVERS[kind](skeleton), np.sqrt(hanging_joints(skeleton))
    scale = np.repeat(np.concatenate([turn, weight[sliding]]), 3)
    numbers = np.concatenate([vectors, clip.translations[:, sliding]], axis=1)
    full = numbers.reshape(clip.frames, -1) * scale
    varies = np.ptp(full, axis=0) > STILL
    return Channels(clip, full[:, varies], full.mean(axis=0), varies, sliding, scale)


def unwrapped(vectors: Floats) -> Floats:
    """Return rotation vectors (frames, joints, 3) that jump as little as they can.

    A turn about an axis by an angle is the same turn with the angle one or more full turns
    on; of those each frame takes the nearest to the frame before it.
    """
    out = vectors.copy()
    for frame in range(1, len(out)):
        vector, before = out[frame], out[frame - 1]
        angle = np.linalg.norm(vector, axis=1, keepdims=True)
        axis = vector / np.maximum(angle, 1e-12)
        turns = np.rint(((before * axis).sum(axis=1, keepdims=True) - angle) / (2 * np.pi))
        out[frame] = np.where(angle > 1e-6, vector + turns * 2 * np.pi * axis, vector)
    return out


def through_sz3(pysz: Any, values: Floats, bound: float) -> tuple[int, Floats]:
    """Return the bytes that SZ3 makes of ``values`` (frames, channels), and what they decode to."""
    row = np.ascontiguousarray(values.T).ravel()
    config = pysz.szConfig(row.shape)
    config.errorBoundMode = pysz.szErrorBoundMode.ABS
    config.absErrorBound = bound
    packed, _ = pysz.sz.compress(row, config)
    back, _ = pysz.sz.decompress(packed, row.dtype, row.shape)
    return len(packed), np.asarray(back).reshape(values.shape[::-1]).T


@dataclass(frozen=True)
class Sz3Clip:
    """One clip: bytes, largest shell error and bound; summed joint displacement, and of how many.

    Lengths are centimetres.
    """

    bytes: int
    largest: float
    bound: float
    joint_sum: float
    joint_count: int


def smallest_inside(task: tuple[Path, float, str]) -> Sz3Clip:
    """Return SZ3's smallest clip found whose shell error is inside the wanted one.

    ``task``: the source file, the largest shell error allowed in centimetres, kind of levers.
    """
    source, wanted, kind = task
    pysz = load_sz3()
    clip = read_clip(source)
    assert isinstance(clip, SkeletonClip)
    channels = channels_of(clip, wanted, kind)
    if channels.values.size == 0:
        back, count = channels.posed(channels.values), clip.frames * clip.skeleton.joints
        return Sz3Clip(0, float(clip_errors(clip, back).max(initial=0.0)), 0.0, 0.0, count)
    best: tuple[int, float, float, Floats] | None = None
    inside, outside, bound = 0.0, math.inf, wanted
    for _ in range(TRIALS):
        size, values = through_sz3(pysz, channels.values, bound)
        largest = float(clip_errors(clip, channels.posed(values)).max())
        if largest <= wanted:
            inside = max(inside, bound)
            if best is None or size < best[0]:
                best = size, largest, bound, values
            if largest >= CLOSE_ENOUGH * wanted:
                break
        else:
            outside = min(outside, bound)
        if outside < inside * 1.003:
            break
        bound *= min(max(0.997 * wanted / max(largest, 1e-12), 0.2), 5.0)
        if not inside < bound < outside:
            bound = math.sqrt(inside * outside) if inside else outside / 2.0
    if best is None:
        raise SystemExit(f"{source.name}: SZ3 does not get inside {wanted:g} cm")
    size, largest, bound, values = best
    pair = [joint_positions(motion) for motion in (clip, channels.posed(values))]
    distances = np.linalg.norm(pair[1] - pair[0], axis=2)
    return Sz3Clip(size, largest, bound, float(distances.sum()), distances.size)


def compare_sz3(
    archives: ArchiveRuns, sources: Mapping[str, Path], tolerances: list[float]
) -> dict[str, Any]:
    """Return bytes against SZ3's at each clip's certified largest error, as JSON values.

    ``tolerances``: of the archives, centimetres.
    """
    load_sz3()
    names = sorted(sources)
    figures = []
    for tolerance in tolerances:
        run = archives.at("max", tolerance)
        entry: dict[str, Any] = {
            "tolerance": tolerance,
            "archive_bytes": run.archive_bytes,
            "archive_joint_mean": run.joint_mean,
        }
        for kind in LEVERS:
            limits = zip(names, run.largest, strict=True)
            tasks = [(sources[name], float(limit), kind) for name, limit in limits]
            clips = in_processes(smallest_inside, tasks, archives.workers)
            size, count = (
                sum(getattr(clip, key) for clip in clips) for key in ("bytes", "joint_count")
            )
            shares = [clip.largest / task[1] for clip, task in zip(clips, tasks, strict=True)]
            entry[kind] = {
                "bytes": size,
                "ratio": run.archive_bytes / size,
                "joint_mean": sum(clip.joint_sum for clip in clips) / count,
                "share_of_error": float(np.mean(shares)),
            }
        figures.append(entry)
    return {"figures": figures}
