"""How far off a decoded clip may be: what a person allows, and what that means for one clip."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from ..clip import Clip, FloatArray, MarkerClip, SkeletonClip
from .metrics import clip_errors, marker_errors

# Restored texts have six decimals, which may move a joint by so much beyond what is decoded.
TEXT_MARGIN = 3e-6  # centimetres, or a thirtieth of smaller tolerances


@dataclass(frozen=True)
class Bounds:
    """What a person allows, centimetres.

    ``tolerance``: the largest error of any joint, end site or marker; ``mean``: the mean error
    of a clip, None for no such bound. ``joints``: (pattern of joint names, tolerance), which
    holds for these joints instead, be it closer or wider, the closest of several; an end site
    goes with the joint that carries it. ``spans``: (from second, to second, tolerance), which
    holds for all joints that have no closer one.
    """

    tolerance: float
    mean: float | None = None
    joints: tuple[tuple[str, float], ...] = ()
    spans: tuple[tuple[float, float, float], ...] = ()

    @property
    def largest(self) -> float:
        """The largest error that is allowed anywhere."""
        return max(self.tolerance, *(tolerance for _, tolerance in self.joints), 0.0)

    @property
    def plain(self) -> bool:
        """Whether the same holds for all joints and frames."""
        return not self.joints and not self.spans


@dataclass(frozen=True, eq=False)
class Limits:
    """How far off a decoded clip may be, centimetres.

    ``joints``: (joints + end sites, or markers,); ``frames``: (frames,); the lesser of the two
    holds for a joint in a frame. ``mean``: what the mean error must not pass, or None.
    """

    joints: FloatArray
    frames: FloatArray
    mean: float | None = None

    @property
    def least(self) -> float:
        """The smallest limit of all."""
        return float(min(self.joints.min(initial=np.inf), self.frames.min(initial=np.inf)))

    @property
    def uniform(self) -> bool:
        """Whether one limit holds for all joints and frames."""
        both = np.concatenate([self.joints, self.frames])
        return bool((both == both[:1]).all())

    def excess(self, original: Clip, decoded: Clip) -> float:
        """Return the largest error of a decoded clip as a share of its limit."""
        if isinstance(original, MarkerClip):
            assert isinstance(decoded, MarkerClip)
            errors = marker_errors(original, decoded)
        else:
            assert isinstance(decoded, SkeletonClip)
            errors = clip_errors(original, decoded)
        allowed = np.minimum(self.joints, self.frames[:, None])
        return float((errors / allowed).max(initial=0.0))


def uniform_limits(clip: Clip, tolerance: float, mean: float | None = None) -> Limits:
    """Return the same limit for every joint, end site or marker in every frame."""
    if isinstance(clip, MarkerClip):
        points = len(clip.names)
    else:
        points = clip.skeleton.joints + len(clip.skeleton.end_parents)
    return Limits(np.full(points, tolerance), np.full(clip.frames, tolerance), mean)


def limits_of(clip: Clip, bounds: Bounds) -> Limits:
    """Return what ``bounds`` mean for a clip; those of joints that it does not have, nothing."""
    limits = uniform_limits(clip, bounds.tolerance, bounds.mean)
    if bounds.plain:
        return limits
    if isinstance(clip, MarkerClip):
        owners = list(clip.names)
    else:
        names = clip.skeleton.names
        owners = [*names, *(names[carrier] for carrier in clip.skeleton.end_parents.tolist())]
    joints = np.full(len(owners), np.inf)
    for pattern, tolerance in bounds.joints:
        chosen = [fnmatchcase(owner, pattern) for owner in owners]
        joints[chosen] = np.minimum(joints[chosen], tolerance)
    joints[np.isinf(joints)] = bounds.tolerance
    frames = np.full(clip.frames, joints.max(initial=bounds.tolerance))
    times = np.arange(clip.frames) * clip.frame_time
    hair = 1e-3 * clip.frame_time
    for start, stop, tolerance in bounds.spans:
        # a frame on the border is inside, whatever rounding says of its time
        inside = (times >= start - hair) & (times <= stop + hair)
        frames[inside] = np.minimum(frames[inside], tolerance)
    return Limits(joints, frames, bounds.mean)
