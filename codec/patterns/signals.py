"""The numbers that are coded: a clip as integers on a quantiser grid, part by part, and back.

Every body part is measured against the *decoded* motion of its parent part's reference joint,
so that an error of the parent is not added to the child's: a joint's decoded world orientation
is off by its own rounding only.

Skeletons: per joint the rotation vector of its orientation relative to the reference joint,
around the family's usual orientation turned by one of the 24 rotations of the cube (its
*base*, which keeps the vector far from half a turn), times the joint's lever: centimetres.
Then, for the joints whose own translation varies (*sliding* joints; the root, as a rule),
the translation minus the rest offset, times its weight.

Markers: positions relative to the parent part's reference marker; the root part relative to
its own reference marker, which is coded absolutely. Integers on one grid subtract exactly, so
no error is added either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from ..clip import FloatArray, IntArray, Skeleton
from ..figure.bodyparts import BodyPart
from ..figure.rig import Family
from ..geometry.rotations import from_axis_angle, to_axis_angle

BASE_ENTER = 2.0  # radians; beyond it a nearer base is chosen when a clip starts
BASE_LEAVE = 2.6  # radians; beyond it the base is changed within a clip


def _cube_rotations() -> FloatArray:
    """Return the 24 rotations of the cube (24, 3, 3), the identity first."""
    found = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                found.append(matrix)
    return np.array(found)


CUBE = _cube_rotations()


@dataclass(frozen=True, eq=False)
class Frame:
    """What the integers of one skeleton clip are measured against, beside its family.

    ``bases``: (frames, joints) index of each joint's base in `CUBE`; ``sliding``: indices of
    the joints whose translation is coded, ascending.
    """

    bases: IntArray
    sliding: tuple[int, ...]

    def sliding_in(self, part: BodyPart) -> list[int]:
        """Return the sliding joints of ``part``."""
        return [joint for joint in part.joints if joint in self.sliding]


def part_channels(part: BodyPart, frame: Frame | None) -> int:
    """Return how many channels ``part`` has; ``frame`` is None for markers."""
    return 3 * len(part.joints) + (3 * len(frame.sliding_in(part)) if frame else 0)


def relative_rotations(parts: Sequence[BodyPart], part: BodyPart, world: FloatArray) -> FloatArray:
    """Return (frames, joints of the part, 3, 3): orientations in the reference joint's axes."""
    own = world[:, part.joints]
    if part.parent < 0:
        return own
    reference = world[:, parts[part.parent].reference]
    return np.asarray(np.swapaxes(reference, -1, -2)[:, None] @ own)


def choose_bases(family: Family, world: FloatArray) -> IntArray:
    """Return the base of every joint in every frame, (frames, joints), for a clip.

    A joint keeps base 0, its usual orientation, while it stays within `BASE_ENTER` of it;
    others get the nearest base whenever they are more than `BASE_LEAVE` from the current one.
    """
    frames, joints = world.shape[:2]
    bases = np.zeros((frames, joints), np.int64)
    if frames == 0:
        return bases
    for part in family.parts:
        columns = list(part.joints)
        centres = family.centre_rotations[columns]
        turned = np.swapaxes(centres, -1, -2) @ relative_rotations(family.parts, part, world)
        # the trace says the angle: 1 + 2 cos(angle)
        far = np.einsum("fjii->fj", turned) < 1.0 + 2.0 * np.cos(BASE_ENTER)
        for position in np.flatnonzero(far.any(axis=0)):
            bases[:, columns[position]] = _follow_bases(turned[:, position])
    return bases


def _follow_bases(turned: FloatArray) -> IntArray:
    """Return the bases (frames,) of one joint from its rotations (frames, 3, 3)."""
    traces = np.einsum("fij,bij->fb", turned, CUBE)
    leave = 1.0 + 2.0 * np.cos(BASE_LEAVE)
    bases = np.zeros(len(turned), np.int64)
    start = 0
    while start < len(turned):
        keep_usual = start == 0 and traces[0, 0] >= 1.0 + 2.0 * np.cos(BASE_ENTER)
        base = 0 if keep_usual else int(traces[start].argmax())
        gone = np.flatnonzero(traces[start:, base] < leave)
        stop = start + int(gone[0]) if len(gone) else len(turned)
        bases[start:stop] = base
        start = stop
    return bases


def turn_signals(family: Family, part: BodyPart, world: FloatArray) -> FloatArray:
    """Return the part's rotation signals around base 0, (frames, 3 × joints), centimetres.

    These are what segments and patterns are made of. A signal that passes half a turn goes on
    beyond it instead of jumping to the other side.
    """
    columns = list(part.joints)
    centres = np.swapaxes(family.centre_rotations[columns], -1, -2)
    vectors = to_axis_angle(centres @ relative_rotations(family.parts, part, world))
    vectors = _unwrapped(vectors) * family.turn_scale[columns, None]
    return vectors.reshape(len(world), 3 * len(columns))


def _unwrapped(vectors: FloatArray) -> FloatArray:
    """Continue rotation vectors (frames, joints, 3) over half a turn."""
    if len(vectors) < 2:
        return vectors
    along = (vectors[1:] * vectors[:-1]).sum(axis=2)
    length = np.sqrt(np.square(vectors).sum(axis=2))
    crossed = (along < 0) & (length[1:] > np.pi / 2) & (length[:-1] > np.pi / 2)
    if not crossed.any():
        return vectors
    other = np.zeros(length.shape, bool)
    other[1:] = np.logical_xor.accumulate(crossed, axis=0)
    factor = np.where(other, 1.0 - 2.0 * np.pi / np.maximum(length, 1e-9), 1.0)
    return np.asarray(vectors * factor[..., None])


def quantise_skeleton(
    family: Family,
    frame: Frame,
    offsets: FloatArray,
    world: FloatArray,
    translations: FloatArray,
    step: float,
) -> tuple[list[IntArray], FloatArray, FloatArray]:
    """Return (integers per part, decoded world rotations, decoded translations).

    ``offsets``: (joints, 3) the rig's rest offsets; ``world``: (frames, joints, 3, 3);
    ``translations``: (frames, joints, 3); ``step``: the quantiser step; centimetres. Integers
    of a part are (frames, channels): rotations joint by joint, then sliding translations.
    """
    decoded = np.empty_like(world)
    shifts = np.broadcast_to(offsets, translations.shape).copy()
    integers = []
    for part in family.parts:
        columns = list(part.joints)
        bases = _base_rotations(family, frame, columns)
        reference = _reference(family, part, decoded)
        own = world[:, columns]
        if reference is not None:
            own = np.swapaxes(reference, -1, -2)[:, None] @ own
        scale = family.turn_scale[columns, None] / step
        turns = np.rint(to_axis_angle(np.swapaxes(bases, -1, -2) @ own) * scale)
        decoded[:, columns] = _posed(bases, turns / scale, reference)
        sliding = frame.sliding_in(part)
        weights = family.shift_scale[sliding, None] / step
        moves = np.rint((translations[:, sliding] - offsets[sliding]) * weights)
        shifts[:, sliding] += moves / weights
        both = np.concatenate([turns, moves], axis=1).astype(np.int64)
        integers.append(both.reshape(len(world), part_channels(part, frame)))
    return integers, decoded, shifts


def dequantise_skeleton(
    family: Family,
    frame: Frame,
    skeleton: Skeleton,
    integers: Sequence[IntArray | None],
    step: float,
) -> tuple[FloatArray, FloatArray]:
    """Return (world rotations, local translations) of the integers: the decoder's half.

    A part whose integers are None is skipped (its joints are left at the identity and at their
    rest offsets); its child parts must be None too. Shapes as in `quantise_skeleton`.
    """
    frames = len(frame.bases)
    world = np.broadcast_to(np.eye(3), (frames, skeleton.joints, 3, 3)).copy()
    shifts = np.broadcast_to(skeleton.offsets, (frames, skeleton.joints, 3)).copy()
    for part, values in zip(family.parts, integers, strict=True):
        if values is None:
            continue
        columns = list(part.joints)
        turns = values[:, : 3 * len(columns)].reshape(frames, len(columns), 3)
        scale = family.turn_scale[columns, None] / step
        reference = _reference(family, part, world)
        world[:, columns] = _posed(
            _base_rotations(family, frame, columns), turns / scale, reference
        )
        sliding = frame.sliding_in(part)
        moves = values[:, 3 * len(columns) :].reshape(frames, len(sliding), 3)
        shifts[:, sliding] += moves / (family.shift_scale[sliding, None] / step)
    return world, shifts


def pose_part(family: Family, part: BodyPart, signal: FloatArray, world: FloatArray) -> None:
    """Set the part's world rotations in ``world`` from its signals around base 0, in place.

    ``signal``: (frames, 3 × joints) as `turn_signals` gives it; ``world``: (frames, joints,
    3, 3), in which the part's ancestors are posed already.
    """
    columns = list(part.joints)
    vectors = signal.reshape(len(world), len(columns), 3) / family.turn_scale[columns, None]
    centres = family.centre_rotations[columns][None]
    world[:, columns] = _posed(centres, vectors, _reference(family, part, world))


def _reference(family: Family, part: BodyPart, world: FloatArray) -> FloatArray | None:
    return None if part.parent < 0 else world[:, family.parts[part.parent].reference]


def _base_rotations(family: Family, frame: Frame, columns: list[int]) -> FloatArray:
    """Return the orientations (frames or 1, joints, 3, 3) that rotation vectors start from."""
    centres = family.centre_rotations[columns]
    chosen = frame.bases[:, columns]
    if not chosen.any():
        return centres[None]
    return np.asarray(centres @ CUBE[chosen])


def _posed(bases: FloatArray, vectors: FloatArray, reference: FloatArray | None) -> FloatArray:
    own = bases @ from_axis_angle(vectors)
    return own if reference is None else reference[:, None] @ own


def quantise_markers(family: Family, positions: FloatArray, step: float) -> list[IntArray]:
    """Return the integers per part, (frames, 3 × markers), of gap-free positions.

    ``positions``: (frames, markers, 3), ``step``: centimetres.
    """
    grid = np.rint(positions / step).astype(np.int64)
    integers = []
    for part in family.parts:
        own = grid[:, part.joints] - grid[:, [marker_anchor(family, part)]]
        if part.parent < 0:
            own[:, part.joints.index(part.reference)] = grid[:, part.reference]
        integers.append(own.reshape(len(grid), 3 * len(part.joints)))
    return integers


def dequantise_markers(
    family: Family, integers: Sequence[IntArray | None], markers: int, step: float
) -> FloatArray:
    """Return positions (frames, markers, 3), centimetres, of `quantise_markers`' integers.

    Markers of parts that are None are NaN.
    """
    frames = next(len(values) for values in integers if values is not None)
    grid = np.zeros((frames, markers, 3), np.int64)
    known = np.zeros(markers, bool)
    for part, values in zip(family.parts, integers, strict=True):
        if values is None:
            continue
        own = values.reshape(frames, len(part.joints), 3)
        if part.parent < 0:
            centre = part.joints.index(part.reference)
            anchor = own[:, [centre]]
            own = own + anchor
            own[:, centre] = anchor[:, 0]
        else:
            own = own + grid[:, [marker_anchor(family, part)]]
        grid[:, part.joints] = own
        known[list(part.joints)] = True
    return np.where(known[:, None], grid * step, np.nan)


def marker_signals(family: Family, part: BodyPart, positions: FloatArray) -> FloatArray:
    """Return a part's marker signals (frames, 3 × markers), centimetres, for its segments."""
    own = positions[:, part.joints] - positions[:, [marker_anchor(family, part)]]
    return np.asarray(own.reshape(len(positions), 3 * len(part.joints)))


def marker_anchor(family: Family, part: BodyPart) -> int:
    """Return the marker that the positions of ``part`` are relative to."""
    return part.reference if part.parent < 0 else family.parts[part.parent].reference
