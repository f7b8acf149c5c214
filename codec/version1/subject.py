"""A clip on its way into an index file: what it becomes at a quantiser step, and how far off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..clip import Clip, FloatArray, IntArray, MarkerClip, SkeletonClip
from ..figure.conform import conformed
from ..figure.rig import Rig
from ..figure.sliding import sliding_joints
from ..geometry.gaps import filled
from ..geometry.kinematics import world_positions, world_rotations
from ..geometry.metrics import frame_blocks, shell_errors
from ..patterns.patterns import Codebook
from ..patterns.signals import (
    Frame,
    choose_bases,
    dequantise_markers,
    quantise_markers,
    quantise_skeleton,
)
from .layers import PartIndex, Preview


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
