"""A clip on its way into an index file: what it becomes at a quantiser step, and how far off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .clip import Clip, FloatArray, IntArray, MarkerClip, SkeletonClip
from .conform import conformed
from .errors import UnsupportedError
from .gaps import filled
from .kinematics import world_positions, world_rotations
from .layers import PartIndex, Preview, can_slide
from .metrics import frame_blocks, shell_errors
from .patterns import Codebook
from .rig import Rig
from .signals import (
    Frame,
    choose_bases,
    dequantise_markers,
    quantise_markers,
    quantise_skeleton,
)

STILL_SHARE = 0.1  # of the tolerance: a translation that varies less is taken as the rest offset


@dataclass(frozen=True, eq=False)
class Subject:
    """A clip with all that the encoder knows of it before it chooses a quantiser step.

    ``preview``: its orders and the use of patterns are still open. ``world``: (frames, joints,
    3, 3) world rotations; of markers: empty. ``positions``: (frames, joints, 3) world
    positions, centimetres; of markers: with gaps filled.
    """

    clip: Clip
    rig: Rig
    codebook: Codebook
    preview: Preview
    world: FloatArray
    positions: FloatArray

    @classmethod
    def of(
        cls,
        clip: Clip,
        rig: Rig,
        codebook: Codebook,
        index: tuple[PartIndex | None, ...],
        tolerance: float,
    ) -> Subject:
        """Return the subject that ``clip`` makes, whose segments have the patterns of ``index``.

        ``tolerance``: centimetres; it decides which joints' translations are worth coding.
        """
        orders = tuple(2 for _ in codebook.family.parts)
        if isinstance(clip, MarkerClip):
            preview = Preview(None, clip.seen, index, orders)
            return cls(clip, rig, codebook, preview, np.zeros(0), filled(clip.positions))
        world = world_rotations(clip.skeleton, clip.rotations)
        positions = world_positions(clip.skeleton, world, clip.translations)
        sliding = sliding_joints(clip, rig, world, positions, tolerance)
        frame = Frame(choose_bases(codebook.family, world), sliding)
        return cls(clip, rig, codebook, Preview(frame, None, index, orders), world, positions)

    def quantised(self, step: float) -> tuple[list[IntArray], float]:
        """Return every part's integers at a quantiser step, and the largest error, centimetres."""
        family, skeleton = self.codebook.family, self.rig.skeleton
        if self.preview.frame is None:
            integers = quantise_markers(family, self.positions, step)
            back = dequantise_markers(family, [*integers], skeleton.joints, step)
            square = np.square(back - self.positions).sum(axis=2)
            seen = self.preview.seen
            assert seen is not None
            return integers, float(np.sqrt(square[seen].max(initial=0.0)))
        blocks = [self._block_quantised(step, at) for at in frame_blocks(self.clip.frames)]
        parts = zip(*(integers for integers, _ in blocks), strict=True)
        return [np.concatenate(part) for part in parts], max(error for _, error in blocks)

    def _block_quantised(self, step: float, block: slice) -> tuple[list[IntArray], float]:
        """Return the integers and the largest error of a skeleton clip's frames ``block``."""
        assert isinstance(self.clip, SkeletonClip)
        assert self.preview.frame is not None
        skeleton = self.rig.skeleton
        integers, world, shifts = quantise_skeleton(
            self.codebook.family,
            replace(self.preview.frame, bases=self.preview.frame.bases[block]),
            skeleton.offsets,
            self.world[block],
            self.clip.translations[block],
            step,
        )
        world = conformed(skeleton, self.rig.layout, world)
        positions = world_positions(skeleton, world, shifts)
        errors = shell_errors(skeleton, self.world[block], self.positions[block], world, positions)
        return integers, float(errors.max(initial=0.0))


def sliding_joints(
    clip: SkeletonClip, rig: Rig, world: FloatArray, positions: FloatArray, tolerance: float
) -> tuple[int, ...]:
    """Return the joints whose translation is coded: those that leave their rest offset."""
    offsets = rig.skeleton.offsets
    moved = np.abs(clip.translations - offsets).max(axis=(0, 2), initial=0.0)
    still = min(STILL_SHARE * tolerance, 0.02)
    candidates = can_slide(rig)
    sliding = [joint for joint in candidates if moved[joint] > still]
    if 2.0 * sum(moved[joint] for joint in candidates if moved[joint] <= still) < tolerance:
        return tuple(sliding)
    # what is neglected adds up along a chain of joints; past the tolerance no step mends it
    kept = np.broadcast_to(offsets, clip.translations.shape).copy()
    kept[:, sliding] = clip.translations[:, sliding]
    missed = np.square(world_positions(clip.skeleton, world, kept) - positions).sum(axis=2)
    if missed.max(initial=0.0) >= tolerance * tolerance:
        still /= rig.skeleton.joints
    return tuple(joint for joint in candidates if moved[joint] > still)


def check_size(clip: Clip) -> None:
    """Raise `UnsupportedError` for a clip of nothing, or too far out for any tolerance."""
    if isinstance(clip, MarkerClip):
        joints, largest = len(clip.names), np.nanmax(np.abs(clip.positions), initial=0.0)
    else:
        joints, lengths = clip.skeleton.joints, (clip.translations, clip.skeleton.end_offsets)
        largest = np.max([np.abs(values).max(initial=0.0) for values in lengths])
    if not joints:
        raise UnsupportedError("the clip has no joints or markers", advice="Leave this file out")
    if not largest < 1e7:
        raise UnsupportedError(
            f"positions reach {largest:.3g} cm", advice="Check the file's unit (--units)"
        )
