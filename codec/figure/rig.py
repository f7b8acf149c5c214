"""What clips share: the rig they were recorded on, and the family that its patterns serve.

A *rig* is a skeleton or marker set with its body parts, frame time and file layout; clips that
agree in all of it share one record in the store. A *rig family* is what two rigs must share to
share patterns: joint names, hierarchy and body parts. Bone lengths may differ.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ..arithmetic.scaling import bounded
from ..clip import Clip, FloatArray, IntArray, Layout, MarkerClip, Skeleton, SkeletonClip
from ..errors import UnsupportedError
from ..geometry.kinematics import hanging_joints, inertia, levers
from ..geometry.rotations import from_quaternions, to_quaternions
from .bodyparts import BodyPart
from .mirror import Mirror, find_mirror

Kind = Literal["skeleton", "markers"]

CENTRE_SCALE = 32767
LEVER_SCALE = 16
STIFF = 1e-8  # squared sines: less than this is no turn
HINGE_SHARE = 1e-4  # of the squared turns about its axis: what a hinge turns about another


@dataclass(frozen=True, eq=False)
class Rig:
    """One skeleton or marker set as source files lay it out.

    ``skeleton``: for markers a flat one, with every marker a child of nothing and zero offsets.
    ``frame_time``: seconds.
    """

    kind: Kind
    skeleton: Skeleton
    parts: tuple[BodyPart, ...]
    frame_time: float
    layout: Layout

    def to_record(self) -> dict[str, Any]:
        """Return a JSON-serialisable record; `from_record` is its inverse."""
        skeleton = self.skeleton
        return {
            "kind": self.kind,
            "names": list(skeleton.names),
            "parents": skeleton.parents.tolist(),
            "offsets": skeleton.offsets.tolist(),
            "end_parents": skeleton.end_parents.tolist(),
            "end_offsets": skeleton.end_offsets.tolist(),
            "parts": [asdict(part) for part in self.parts],
            "frame_time": self.frame_time,
            "layout": asdict(self.layout),
        }

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> Rig:
        """Return the rig of a record that `to_record` made."""
        layout = record["layout"]
        return cls(
            record["kind"],
            Skeleton(
                tuple(record["names"]),
                np.array(record["parents"], np.int64),
                np.array(record["offsets"], np.float64).reshape(-1, 3),
                np.array(record["end_parents"], np.int64),
                np.array(record["end_offsets"], np.float64).reshape(-1, 3),
            ),
            tuple(
                BodyPart(part["name"], tuple(part["joints"]), part["parent"], part["reference"])
                for part in record["parts"]
            ),
            record["frame_time"],
            Layout(
                **{
                    **layout,
                    "channels": tuple(tuple(names) for names in layout["channels"]),
                    "details": tuple((key, text) for key, text in layout["details"]),
                }
            ),
        )

    @cached_property
    def key(self) -> str:
        """Digest of the whole record: equal for rigs that can share a record."""
        return _digest(self.to_record())

    @cached_property
    def family_key(self) -> str:
        """Digest of names, hierarchy and parts: equal for rigs that can share patterns."""
        skeleton = self.skeleton
        return _digest(
            {
                "kind": self.kind,
                "names": list(skeleton.names),
                "parents": skeleton.parents.tolist(),
                "parts": [asdict(part) for part in self.parts],
            }
        )


def rig_of(clip: Clip, parts: tuple[BodyPart, ...]) -> Rig:
    """Return the rig of a clip whose body parts are ``parts``.

    Raises `UnsupportedError` for a frame time that is none.
    """
    if not 1e-7 < clip.frame_time < 1e7:
        raise UnsupportedError(
            f"a frame time of {clip.frame_time:g} s", advice="Mend the file's frame rate"
        )
    if isinstance(clip, MarkerClip):
        markers = len(clip.names)
        flat = Skeleton(clip.names, np.full(markers, -1), np.zeros((markers, 3)))
        return Rig("markers", flat, parts, clip.frame_time, clip.layout)
    return Rig("skeleton", clip.skeleton, parts, clip.frame_time, clip.layout)


@dataclass(frozen=True, eq=False)
class Family:
    """What a rig family's signals are measured against; fixed when its first clip is archived.

    ``centres``: (joints, 4) int16 quaternions × 32767, the usual orientation of each joint
    relative to its parent part's reference joint; zeros for markers. ``levers``: (joints,)
    turn levers in 1/16 cm per radian; ``inertia``: (joints, 6) in 1/256 cm², what a turn does by
    its axis (xx, xy, xz, yy, yz, zz; see `kinematics.inertia`); ``shift_levers``: (joints,)
    weight of a joint's own translation, in 1/16 (dimensionless). Integers, so that every machine
    reads the same.
    ``head_diagonal``: body size in centimetres (Gu's ADDH); thresholds are multiples of it.
    ``hinged``: joints that bend about one axis of their parent, or about none. ``mirror``: how
    the figure looks in a mirror; empty if its sides are not alike.
    """

    key: str
    kind: Kind
    parts: tuple[BodyPart, ...]
    centres: IntArray
    levers: IntArray
    inertia: IntArray
    shift_levers: IntArray
    head_diagonal: float
    hinged: tuple[int, ...] = ()
    mirror: Mirror = ()

    @cached_property
    def centre_rotations(self) -> FloatArray:
        """(joints, 3, 3) rotation matrices of the centres; identity for markers."""
        return from_quaternions(self.centres / CENTRE_SCALE)

    @cached_property
    def turn_scale(self) -> FloatArray:
        """(joints,) centimetres per radian."""
        return self.levers / LEVER_SCALE

    @cached_property
    def shift_scale(self) -> FloatArray:
        """(joints,) weight of a translation in centimetres."""
        return self.shift_levers / LEVER_SCALE

    def to_record(self) -> dict[str, Any]:
        """Return a JSON-serialisable record; `from_record` is its inverse."""
        return {
            "key": self.key,
            "kind": self.kind,
            "parts": [asdict(part) for part in self.parts],
            "centres": self.centres.tolist(),
            "levers": self.levers.tolist(),
            "inertia": self.inertia.tolist(),
            "shift_levers": self.shift_levers.tolist(),
            "head_diagonal": self.head_diagonal,
            "hinged": list(self.hinged),
            "mirror": [list(each) for each in self.mirror],
        }

    @classmethod
    def from_record(cls, record: dict[str, Any]) -> Family:
        """Return the family of a record that `to_record` made."""
        return cls(
            record["key"],
            record["kind"],
            tuple(
                BodyPart(part["name"], tuple(part["joints"]), part["parent"], part["reference"])
                for part in record["parts"]
            ),
            np.array(record["centres"], np.int64).reshape(-1, 4),
            np.array(record["levers"], np.int64),
            np.array(record.get("inertia", []), np.int64).reshape(-1, 6),
            np.array(record["shift_levers"], np.int64),
            record["head_diagonal"],
            tuple(record.get("hinged", ())),
            tuple((partner, axes) for partner, axes in record.get("mirror", ())),
        )


def found_family(
    rig: Rig,
    usual: FloatArray,
    bones: FloatArray,
    bends: FloatArray,
    head_diagonal: float,
    local: bool = False,
) -> Family:
    """Return the family that ``rig`` founds.

    ``usual``: (joints, 3, 3) sums (or means) of each joint's orientation relative to its parent
    part's reference; projected onto the rotations by SVD (the chordal mean). ``bones``:
    (joints, 3) mean local translations in centimetres, which give the levers; a joint's lever
    is at least the 3 cm of the shell. ``bends``: (joints, 3, 3) as by `bends_of`, summed.
    ``head_diagonal``: body size in centimetres. ``local``: all joints count as hinged.
    """
    joints = rig.skeleton.joints
    if rig.kind == "markers":
        ones = np.full(joints, LEVER_SCALE, np.int64)
        centres = np.tile(np.array([CENTRE_SCALE, 0, 0, 0], np.int64), (joints, 1))
        still = np.zeros((0, 6), np.int64)
        return Family(
            rig.family_key, rig.kind, rig.parts, centres, ones, still, ones, head_diagonal
        )
    u, _, vt = np.linalg.svd(usual + 1e-9 * np.eye(3))
    signs = np.ones((joints, 3))
    signs[:, 2] = np.linalg.det(u @ vt)
    usually = (u * signs[:, None, :]) @ vt
    centres = np.rint(to_quaternions(usually) * CENTRE_SCALE)
    # of half a turn both signs are the same: the one whose first number is positive
    first = np.take_along_axis(centres, (centres != 0).argmax(axis=1)[:, None], axis=1)
    centres *= np.sign(first)
    skeleton = replace(rig.skeleton, offsets=bones)
    mirror = find_mirror(skeleton.names, skeleton.parents, rig.parts, usually, bones)
    hinged = tuple(range(1, joints)) if local else _hinged(bends)
    turn = np.rint(np.clip(levers(skeleton), 3.0, 1000.0) * LEVER_SCALE)
    tensors = np.rint(bounded(inertia(skeleton, frozenset(hinged))) * LEVER_SCALE**2)
    shift = np.rint(np.sqrt(hanging_joints(skeleton)) * LEVER_SCALE)
    return Family(
        rig.family_key,
        rig.kind,
        rig.parts,
        centres.astype(np.int64),
        turn.astype(np.int64),
        tensors[:, *np.triu_indices(3)].astype(np.int64),
        shift.astype(np.int64),
        head_diagonal,
        hinged,
        mirror,
    )


def bends_of(rotations: FloatArray) -> FloatArray:
    """Return what local rotations (frames, joints, 3, 3) do (joints, 3, 3): their axes' spread.

    The summed outer products of the turns from the first frame to the others, each as an axis
    times the sine of the angle.
    """
    turns = np.swapaxes(rotations[:1], -1, -2) @ rotations
    lower = turns[..., [2, 0, 1], [1, 2, 0]]
    upper = turns[..., [1, 2, 0], [2, 0, 1]]
    axes = (lower - upper) / 2.0
    return np.asarray(np.einsum("fji,fjk->jik", axes, axes))


def _hinged(bends: FloatArray) -> tuple[int, ...]:
    """Return the joints whose turns are all about one axis, but for a file's rounding.

    Those that never turn are among them, unless no joint does: then nothing is known.
    """
    if not bends.any():
        return ()
    spread = np.linalg.eigvalsh(bends)
    alone = spread[:, 1] <= HINGE_SHARE * spread[:, 2] + STIFF
    return tuple((np.flatnonzero(alone[1:]) + 1).tolist())


def bone_means(clip: SkeletonClip) -> FloatArray:
    """Return the mean local translation of every joint (joints, 3), centimetres.

    The root's is zero: how far the figure stands from the origin is nobody's lever. Of a clip
    without frames they are the rest offsets.
    """
    means = (clip.translations if clip.frames else clip.skeleton.offsets[None]).mean(axis=0)
    means[0] = 0.0
    return np.asarray(means)


def _digest(record: dict[str, Any]) -> str:
    text = json.dumps(record, sort_keys=True, separators=(",", ":"))
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
