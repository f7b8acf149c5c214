"""How far a decoded clip is from its original.

The shell error of a joint at a frame is the largest displacement, between original and
decoded, of three points 3 cm from the joint's origin along its local axes, in world space, so
that a rotation counts even where no child shows it (the metric of the Animation Compression
Library). End sites are held to it too, in the axes of the joint that carries them. The error of
a marker is its displacement, in frames where it was seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..clip import Clip, FloatArray, MarkerClip, Skeleton, SkeletonClip
from .kinematics import end_positions, world_positions, world_rotations

SHELL_CENTIMETRES = 3.0
BLOCK_FRAMES = 4096


@dataclass(frozen=True)
class Errors:
    """Summary of one clip's errors over its joints, end sites and frames, centimetres."""

    maximum: float
    mean: float
    percentile_99: float


def shell_errors(
    skeleton: Skeleton,
    world: FloatArray,
    positions: FloatArray,
    decoded_world: FloatArray,
    decoded_positions: FloatArray,
) -> FloatArray:
    """Return the shell error (frames, joints + end sites), centimetres.

    ``world``: (frames, joints, 3, 3) world rotations, ``positions``: (frames, joints, 3)
    world positions in centimetres, of the original; ``decoded_*`` the same of the decoded clip.
    """
    turned = (decoded_world - world) * SHELL_CENTIMETRES
    centres = decoded_positions - positions
    if len(skeleton.end_parents):
        ends = end_positions(skeleton, decoded_world, decoded_positions)
        ends -= end_positions(skeleton, world, positions)
        centres = np.concatenate([centres, ends], axis=1)
        turned = np.concatenate([turned, turned[:, skeleton.end_parents]], axis=1)
    # squared length of centre + turned column, expanded so that no (…, 3, 3) sum is made thrice
    points = centres[..., :, None] + turned
    square = np.square(points[..., 0, :])
    square += np.square(points[..., 1, :])
    square += np.square(points[..., 2, :])
    return np.asarray(np.sqrt(square.max(axis=-1)))


def clip_errors(original: SkeletonClip, decoded: SkeletonClip) -> FloatArray:
    """Return `shell_errors` of two clips of the same skeleton, (frames, joints + end sites)."""
    skeleton = original.skeleton
    blocks = []
    for block in frame_blocks(original.frames):
        posed = []
        for clip in (original, decoded):
            world = world_rotations(skeleton, clip.rotations[block])
            posed += [world, world_positions(skeleton, world, clip.translations[block])]
        blocks.append(shell_errors(skeleton, *posed))
    return np.concatenate(blocks)


def frame_blocks(frames: int) -> list[slice]:
    """Return slices that cover a clip's frames in order, each few enough to keep memory small."""
    return [slice(at, at + BLOCK_FRAMES) for at in range(0, max(frames, 1), BLOCK_FRAMES)]


def marker_errors(original: MarkerClip, decoded: MarkerClip) -> FloatArray:
    """Return the displacement (frames, markers), centimetres; 0 where a marker was not seen."""
    distance = np.sqrt(np.square(decoded.positions - original.positions).sum(axis=2))
    return np.asarray(np.where(original.seen, distance, 0.0))


def summarise(errors: FloatArray) -> Errors:
    """Return maximum, mean and 99th percentile of ``errors``; zeros when there are none."""
    if errors.size == 0:
        return Errors(0.0, 0.0, 0.0)
    return Errors(float(errors.max()), float(errors.mean()), float(np.percentile(errors, 99)))


def measure(original: Clip, decoded: Clip) -> Errors:
    """Return the errors of a decoded clip, over joints, end sites and frames, centimetres."""
    if isinstance(original, MarkerClip):
        assert isinstance(decoded, MarkerClip)
        return summarise(marker_errors(original, decoded)[original.seen])
    assert isinstance(decoded, SkeletonClip)
    return summarise(clip_errors(original, decoded))
