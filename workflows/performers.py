"""Synthetic performers: their rigs, their styles, and the randomness of a living body.

Axes: X to the performer's left, Y up, Z forward; the rest pose is a T-pose. Body angles are
degrees in anatomical terms (flexion, side, twist), the same sign on the left and the right.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from ..codec.clip import FloatArray, Skeleton
from ..codec.geometry.rotations import from_euler

# name, parent, group of bones that vary together, rest offset in cm at a stature of 172 cm;
# limbs on the left, mirrored for the right
_TRUNK = (
    ("Hips", "", "hip", (0.0, 0.0, 0.0)),
    ("Spine", "Hips", "spine", (0.0, 8.6, -1.2)),
    ("Spine1", "Spine", "spine", (0.0, 11.8, -0.6)),
    ("Spine2", "Spine1", "spine", (0.0, 12.4, 0.4)),
    ("Neck", "Spine2", "spine", (0.0, 16.2, -0.8)),
    ("Head", "Neck", "neck", (0.0, 9.3, 1.6)),
)
_ARM = (
    ("Shoulder", "Spine2", "shoulder", (3.1, 11.6, 1.1)),
    ("Arm", "Shoulder", "shoulder", (14.3, -0.6, -1.4)),
    ("ForeArm", "Arm", "arm", (28.6, 0.0, 0.0)),
    ("Hand", "ForeArm", "arm", (25.4, 0.0, 0.0)),
)
_LEG = (
    ("UpLeg", "Hips", "hip", (8.9, -5.4, 0.4)),
    ("Leg", "UpLeg", "leg", (0.0, -42.3, 0.0)),
    ("Foot", "Leg", "leg", (0.0, -41.1, 0.0)),
    ("ToeBase", "Foot", "foot", (0.0, -5.6, 12.8)),
)
_ENDS = (
    ("Head", "neck", (0.0, 18.4, 0.6)),
    ("Hand", "arm", (17.2, 0.0, 0.0)),
    ("ToeBase", "foot", (0.0, -0.6, 6.9)),
)
_GROUPS = ("hip", "spine", "neck", "shoulder", "arm", "leg", "foot")
SIDES = ("Left", "Right")
_MIRROR = (np.array([1.0, 1.0, 1.0]), np.array([-1.0, 1.0, 1.0]))
_MIDDLE = (("", _MIRROR[0]),)

JOINTS: tuple[str, ...] = tuple(name for name, *_ in _TRUNK) + tuple(
    side + name for limb in (_ARM, _LEG) for side in SIDES for name, *_ in limb
)
INDEX: dict[str, int] = {name: joint for joint, name in enumerate(JOINTS)}


def pair(name: str) -> list[int]:
    """Return the joint indices of the left and the right ``name``."""
    return [INDEX[side + name] for side in SIDES]


class Performer(NamedTuple):
    """One actor: a rig, and the underside of the feet.

    ``soles``: (3, 2, 3) heel, ball and toe tip, per side, in centimetres; heel in the axes of
    the foot, the others in those of the toes.
    """

    skeleton: Skeleton
    soles: FloatArray


@dataclass(frozen=True)
class Style:
    """How somebody moves: factors around 1 and offsets in degrees around 0."""

    cadence: float = 1.0  # steps per second, tempo of gestures
    stride: float = 1.0  # range of the legs
    swing: float = 1.0  # range of the arms
    energy: float = 1.0  # bounce, liveliness of trunk and head
    sway: float = 1.0  # side to side
    lean: float = 0.0  # trunk forwards, degrees
    slump: float = 0.0  # neck and shoulders forwards, degrees
    spread: float = 0.0  # arms away from the body, degrees
    asymmetry: float = 0.0  # left range above right range, as a fraction

    def habit(self, rng: np.random.Generator, spread: float) -> Style:
        """Return this style as one person does it, jittered by ``spread`` (about 0.05)."""
        draws = rng.standard_normal(len(fields(self))).clip(-2, 2) * spread
        values = [getattr(self, item.name) for item in fields(self)]
        factors, offsets = np.array(values[:5]), np.array(values[5:])
        factors = factors * np.exp(draws[:5])
        offsets = offsets + draws[5:] * np.array([30.0, 40.0, 40.0, 0.3])
        return Style(*(float(value) for value in (*factors, *offsets)))


STYLES: dict[str, Style] = {
    "normal": Style(),
    "tired": Style(0.84, 0.80, 0.60, 0.70, 1.25, 7.0, 14.0, -1.0, 0.03),
    "happy": Style(1.08, 1.06, 1.35, 1.45, 1.15, -2.0, -5.0, 3.0, 0.0),
    "proud": Style(0.95, 1.08, 1.10, 1.00, 0.85, -4.0, -8.0, 5.0, 0.0),
    "elderly": Style(0.86, 0.68, 0.55, 0.75, 1.35, 13.0, 17.0, 3.0, 0.06),
    "brisk": Style(1.16, 1.12, 1.25, 1.15, 0.85, 3.0, 0.0, 0.0, 0.0),
    "heavy": Style(0.88, 0.98, 0.95, 1.25, 1.35, 3.0, 4.0, 9.0, 0.02),
    "limping": Style(0.90, 0.90, 0.85, 1.00, 1.25, 4.0, 5.0, 2.0, 0.12),
}


def performer(rng: np.random.Generator) -> Performer:
    """Return an actor of random stature and proportions; offsets have 4 decimals."""
    stature = 1.0 + 0.05 * float(np.clip(rng.standard_normal(), -2.2, 2.2))
    drawn = 1.0 + 0.03 * rng.standard_normal(len(_GROUPS)).clip(-2, 2)
    scale = {group: stature * float(part) for group, part in zip(_GROUPS, drawn, strict=True)}
    rows = [(name, parent, group, np.array(offset)) for name, parent, group, offset in _TRUNK]
    for limb in (_ARM, _LEG):
        for side, mirror in zip(SIDES, _MIRROR, strict=True):
            for name, parent, group, offset in limb:
                above = parent if parent in INDEX else side + parent
                uneven = 1.0 + 0.002 * float(rng.standard_normal())
                rows.append((side + name, above, group, np.array(offset) * mirror * uneven))
    offsets = np.array([scale[group] * offset for _, _, group, offset in rows])
    parents = np.array([INDEX.get(parent, -1) for _, parent, *_ in rows], np.int64)
    carriers, ends = [], []
    for name, group, offset in _ENDS:
        for side, mirror in zip(SIDES, _MIRROR, strict=True) if name != "Head" else _MIDDLE:
            carriers.append(INDEX[side + name])
            ends.append(np.array(offset) * mirror * scale[group])
    skeleton = Skeleton(
        JOINTS,
        parents,
        np.round(offsets, 4),
        np.array(carriers, np.int64),
        np.round(np.array(ends), 4),
    )
    ball, toe = skeleton.offsets[pair("ToeBase")], skeleton.end_offsets[-2:]
    under = 1.9 * scale["foot"]  # flesh and shoe below the ball joint
    heel = np.stack([ball[:, 0] * 0.0, ball[:, 1] - under, -0.33 * ball[:, 2]], axis=1)
    below = np.array([0.0, -under, 0.0])
    tip = toe * np.array([1.0, 0.0, 1.0]) + below
    return Performer(skeleton, np.stack([heel, np.broadcast_to(below, (2, 3)), tip]))


def smooth_noise(
    rng: np.random.Generator, times: FloatArray, spacing: float, channels: int
) -> FloatArray:
    """Return band-limited noise (frames, channels) of unit variance.

    A uniform cubic B-spline through normal draws every ``spacing`` seconds; it depends on the
    moments ``times`` (frames,), seconds from 0, and not on how densely they are sampled.
    """
    # a stream of its own, so that one knot more or less does not change what follows
    own = np.random.Generator(np.random.PCG64(int(rng.integers(2**63))))
    knots = own.standard_normal((int(times[-1] / spacing) + 5, channels))
    place = times / spacing
    first = np.floor(place).astype(np.int64)
    u = (place - first)[:, None]
    weights = ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3)
    total = sum(weight * knots[first + step] for step, weight in enumerate(weights))
    return np.asarray(total / (6.0 * 0.692))  # 0.692: root mean square of the four weights


def ease(progress: FloatArray) -> FloatArray:
    """Return the minimum-jerk course from 0 to 1 of ``progress``, clamped to [0, 1].

    Flash and Hogan 1985, straight reach at rest on both ends: 10 u³ - 15 u⁴ + 6 u⁵.
    """
    u = np.clip(progress, 0.0, 1.0)
    return np.asarray(u * u * u * (10.0 + u * (6.0 * u - 15.0)))


def limb_rotations(angles: FloatArray) -> FloatArray:
    """Return local rotations (frames, joints, 3, 3) of anatomical ``angles``.

    ``angles``: (frames, joints, 3) flexion, side and twist in degrees. Trunk: forwards, to the
    right, to the left. Shoulder girdle: -, up, forwards. Upper arm: forwards, away from hanging,
    inwards. Forearm: elbow flexion, -, pronation. Hand: towards the palm, towards the thumb, -.
    Legs are left at rest: whoever steps or stands places them.
    """
    flexion, side, twist = np.moveaxis(np.radians(angles), 2, 0)
    euler = np.zeros(angles.shape)  # turns about Y, X, Z
    trunk = slice(0, len(_TRUNK))
    euler[:, trunk] = np.stack([twist[:, trunk], flexion[:, trunk], side[:, trunk]], axis=-1)
    mirror = np.array([1.0, -1.0])
    girdle, elbow, wrist, arm = pair("Shoulder"), pair("ForeArm"), pair("Hand"), pair("Arm")
    euler[:, girdle, 0] = -mirror * twist[:, girdle]
    euler[:, girdle, 2] = mirror * side[:, girdle]
    euler[:, elbow, 0] = -mirror * flexion[:, elbow]
    euler[:, elbow, 1] = twist[:, elbow]
    euler[:, wrist, 0] = -mirror * side[:, wrist]
    euler[:, wrist, 2] = -mirror * flexion[:, wrist]
    out = from_euler("YXZ", euler)
    hanging = -mirror * (np.pi / 2 - side[:, arm])
    out[:, arm] = from_euler("XZX", np.stack([-flexion[:, arm], hanging, twist[:, arm]], axis=-1))
    return out


class Legs(NamedTuple):
    """World rotations (frames, 2, 3, 3) of both legs, left first."""

    thigh: FloatArray
    shank: FloatArray
    foot: FloatArray
    toes: FloatArray

    def into(self, rotations: FloatArray) -> None:
        """Write the legs into local ``rotations`` (frames, joints, 3, 3) below their pelvis."""
        parent = rotations[:, :1]
        for name, world in zip(("UpLeg", "Leg", "Foot", "ToeBase"), self, strict=True):
            rotations[:, pair(name)] = np.swapaxes(parent, -1, -2) @ world
            parent = world


class Motion(NamedTuple):
    """Local ``rotations`` (frames, joints, 3, 3) and the ``root`` path (frames, 3) in cm."""

    rotations: FloatArray
    root: FloatArray
