"""Synthetic motion on the spot: standing feet, a planned body, and legs that follow.

Arms and trunk go from key pose to key pose by minimum-jerk submovements that overlap and start
a little apart (Flash and Hogan 1985, The Coordination of Arm Movements).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ..codec.clip import FloatArray
from ..codec.geometry.rotations import about_axis
from .performers import (
    INDEX,
    JOINTS,
    Legs,
    Motion,
    Performer,
    Style,
    ease,
    limb_rotations,
    pair,
    smooth_noise,
)

_STANDING_KNEE = 14.0  # degrees


class _Body(NamedTuple):
    """A plan of the body: anatomical ``angles`` (frames, joints, 3) in degrees, with the
    pelvis at joint 0; ``shift`` (frames, 3) of the pelvis from standing, in cm; ``tiptoe``
    (frames,) degrees of heel raise; ``travel`` (frames,) of the feet forwards, in cm."""

    angles: FloatArray
    shift: FloatArray
    tiptoe: FloatArray
    travel: FloatArray


def idle(body: Performer, style: Style, rng: np.random.Generator, times: FloatArray) -> Motion:
    """Return quiet standing: breath, sway, weight shifts, and a look to one side."""
    plan = _standing(style, rng, times)
    count = 1 + int(times[-1] / 2.5)
    onsets = np.sort(rng.uniform(0.0, times[-1], count))
    sides = rng.choice([-1.0, 1.0]) * (-1.0) ** np.arange(count)
    lean = _course(times, onsets, rng.uniform(0.7, 1.3, count), sides * rng.uniform(2, 5, count))
    lean *= style.sway
    plan.shift[:, 0] += lean
    plan.shift[:, 1] -= 0.06 * lean**2
    plan.angles[:, 0, 1] += 0.7 * lean
    plan.angles[:, INDEX["Spine"], 1] -= 0.8 * lean
    look = _course(
        times,
        rng.uniform(0.1, 0.5, 2) * times[-1] + np.array([0.0, 0.4 * times[-1]]),
        rng.uniform(0.4, 0.8, 2),
        np.array([rng.choice([-1.0, 1.0]) * rng.uniform(10, 40), rng.uniform(-5, 5)]),
    )
    plan.angles[:, [INDEX["Neck"], INDEX["Head"]], 2] += 0.5 * look[:, None]
    plan.angles[:, INDEX["Spine2"], 2] += 0.12 * np.interp(times - 0.15, times, look)
    return _on_feet(body, rng, plan)


def wave(body: Performer, style: Style, rng: np.random.Generator, times: FloatArray) -> Motion:
    """Return a raised right hand that waves from the elbow, and comes down."""
    plan = _standing(style, rng, times)
    tempo = style.cadence
    up = rng.uniform(0.2, 0.5)
    rise = rng.uniform(0.65, 0.85) / tempo
    down = max(times[-1] - rng.uniform(0.9, 1.3) / tempo, up + 2 * rise)
    size = 0.85 + 0.15 * style.swing
    hold = np.array([25.0, 68.0, -78.0, 88.0]) * size + rng.normal(0.0, 3.0, 4)
    held = _keys(
        rng, times, np.array([up, down]), np.array([rise, rise]), np.stack([hold, hold * 0])
    )
    arm, elbow, wrist = INDEX["RightArm"], INDEX["RightForeArm"], INDEX["RightHand"]
    rate = rng.uniform(1.7, 2.2) * tempo * (1.0 + 0.05 * smooth_noise(rng, times, 0.7, 1)[:, 0])
    beat = 2 * np.pi * np.cumsum(rate * np.gradient(times))
    going = ease((times - up - 0.7 * rise) / 0.5) * ease((down + 0.2 - times) / 0.5)
    going *= size * (1.0 + 0.12 * smooth_noise(rng, times, 0.6, 1)[:, 0])
    plan.angles[:, arm] += held[:, :3]
    plan.angles[:, arm, 2] += going * 7.0 * np.sin(beat - 0.4)
    plan.angles[:, arm, 1] += going * 4.0 * np.sin(beat - 0.3)
    plan.angles[:, elbow, 0] += held[:, 3] + going * 21.0 * np.sin(beat)
    plan.angles[:, wrist, 1] += going * 12.0 * np.sin(beat - 0.9)
    raised = held[:, 1] / hold[1]
    plan.angles[:, INDEX["RightShoulder"], 1] += 9.0 * raised
    plan.angles[:, INDEX["Spine1"], 1] -= 3.0 * raised + going * 0.7 * np.sin(beat - 0.5)
    plan.angles[:, INDEX["Head"], 2] += rng.uniform(-8, 8) * raised
    plan.shift[:, 0] += 1.6 * raised
    return _on_feet(body, rng, plan)


def reach(body: Performer, style: Style, rng: np.random.Generator, times: FloatArray) -> Motion:
    """Return reaches of the right hand to a shelf in front, with the trunk's help."""
    plan = _standing(style, rng, times)
    count = max(1, int(times[-1] / rng.uniform(2.6, 3.2)))
    begin = (np.arange(count) + rng.uniform(0.08, 0.2, count)) * times[-1] / count
    go = rng.uniform(0.75, 1.0, count) / style.cadence
    back = begin + go + rng.uniform(0.25, 0.6, count)
    onsets = np.stack([begin, back], axis=1).ravel()
    lasting = np.stack([go, go * rng.uniform(1.0, 1.25, count)], axis=1).ravel()
    # shoulder flexion, side, twist; elbow, wrist; spine bend and twist; girdle; pelvis forwards
    far = np.array([84.0, 6.0, 16.0, 22.0, -14.0, 15.0, 17.0, 13.0, 6.5])
    spread = np.array([6.0, 4.0, 4.0, 5.0, 4.0, 2.5, 3.0, 1.5, 1.2])
    aims = np.zeros((2 * count, far.size))
    aims[::2] = far + spread * rng.standard_normal((count, far.size))
    course = _keys(rng, times, onsets, lasting, aims)
    angles = plan.angles
    angles[:, INDEX["RightArm"]] += course[:, :3]
    # the elbow bends on the way and opens late
    passing = sum(
        np.exp(-0.5 * ((times - at - 0.45 * long) / (0.22 * long)) ** 2)
        for at, long in zip(onsets, lasting, strict=True)
    )
    angles[:, INDEX["RightForeArm"], 0] += course[:, 3] + 28.0 * passing
    angles[:, INDEX["RightHand"], 0] += course[:, 4]
    for name, part in (("Spine", 0.3), ("Spine1", 0.35), ("Spine2", 0.35)):
        angles[:, INDEX[name], 0] += part * course[:, 5]
        angles[:, INDEX[name], 2] += part * course[:, 6]
    angles[:, INDEX["Neck"], 0] -= 0.4 * course[:, 5]
    angles[:, INDEX["Neck"], 2] -= 0.5 * course[:, 6]
    angles[:, INDEX["LeftArm"], 0] -= 0.12 * course[:, 0]
    angles[:, INDEX["RightShoulder"], 2] += course[:, 7]
    angles[:, 0, 0] += 0.5 * course[:, 8]
    plan.shift[:, 2] += course[:, 8]
    plan.shift[:, 1] -= 0.25 * np.abs(course[:, 8])
    return _on_feet(body, rng, plan)


def sit(body: Performer, style: Style, rng: np.random.Generator, times: FloatArray) -> Motion:
    """Return sitting down on a stool of 48 cm, and standing up again."""
    plan = _standing(style, rng, times)
    lasting = rng.uniform(1.15, 1.5, 2) / np.sqrt(style.cadence) * min(1.0, times[-1] / 3.2)
    onsets = np.array([rng.uniform(0.05, 0.14), rng.uniform(0.55, 0.62)]) * times[-1]
    seat = np.array([-37.0, -35.0, 12.0, 30.0]) + rng.normal(0.0, [1.0, 1.5, 3.0, 5.0])
    course = _keys(rng, times, onsets, lasting, np.stack([seat, seat * 0]))
    bow = sum(
        np.exp(-0.5 * ((times - at - part * long) / (0.24 * long)) ** 2)
        for at, long, part in zip(onsets, lasting, (0.55, 0.4), strict=True)
    )
    plan.shift[:, 1] += course[:, 0] * body.skeleton.offsets[INDEX["LeftLeg"], 1] / -42.3
    plan.shift[:, 2] += course[:, 1] * body.skeleton.offsets[INDEX["LeftLeg"], 1] / -42.3
    plan.angles[:, 0, 0] += -0.5 * course[:, 2] + 17.0 * bow
    for name in ("Spine", "Spine1"):
        plan.angles[:, INDEX[name], 0] += 0.5 * course[:, 2] + 10.0 * bow
    plan.angles[:, INDEX["Neck"], 0] -= 14.0 * bow
    plan.angles[:, pair("Arm"), 0] += (course[:, 3] + 6.0 * bow)[:, None]
    plan.angles[:, pair("ForeArm"), 0] += 1.1 * course[:, 3, None]
    return _on_feet(body, rng, plan)


def jump(body: Performer, style: Style, rng: np.random.Generator, times: FloatArray) -> Motion:
    """Return a crouch, a jump forwards with an arm swing, and a soft landing."""
    plan = _standing(style, rng, times)
    height = rng.uniform(14.0, 20.0) * style.energy**0.5 * style.stride**0.5
    leave = np.sqrt(2.0 * 981.0 * height)  # cm/s
    flight = 2.0 * leave / 981.0
    crouch = rng.uniform(19.0, 24.0)
    down, push = rng.uniform(0.42, 0.52), 2.0 * crouch / leave * 1.25
    off = max(0.2, 0.45 * times[-1] - 0.5) + down + push
    # knots of the pelvis' height: time, cm from standing, cm/s
    land = off + flight
    knots = np.array(
        [
            [0.0, 0.0, 0.0],
            [off - push - down, 0.0, 0.0],
            [off - push, -crouch, 0.0],
            [off, 2.0, leave],
            [land, 1.0, -leave],
            [land + 0.2, -0.75 * crouch, 0.0],
            [land + 0.95, 0.0, 0.0],
            [times[-1] + land + 2.0, 0.0, 0.0],
        ]
    )
    bent = CubicHermiteSpline(*knots.T)(times)
    air = (times > off) & (times < land)
    fall = 2.0 - (times - off) / flight + leave * (times - off) - 490.5 * (times - off) ** 2
    plan.shift[:, 1] += np.where(air, fall, bent)
    distance = rng.uniform(22.0, 38.0) * style.stride
    plan.shift[:, 2] += distance * ease((times - off + 0.22) / (flight + 0.45))
    plan.travel[:] = distance * ease((times - off - 0.02) / (flight - 0.02))
    low = -np.minimum(bent, 0.0) / crouch
    plan.angles[:, 0, 0] += 22.0 * low
    plan.angles[:, [INDEX["Spine"], INDEX["Spine1"]], 0] += 9.0 * low[:, None]
    plan.angles[:, [INDEX["Neck"], INDEX["Head"]], 0] -= 11.0 * low[:, None]
    plan.shift[:, 2] -= 7.0 * low
    moments = np.array([off - push - down, off - push * 1.15, land - 0.1])
    poses = np.array([[-48.0, 10.0], [70.0 * style.swing**0.5, 30.0], [0.0, 0.0]])
    arms = _keys(rng, times, moments, np.array([down, push + 0.22, 0.9]), poses)
    plan.angles[:, pair("Arm"), 0] += arms[:, :1]
    plan.angles[:, pair("ForeArm"), 0] += arms[:, 1:]
    plan.tiptoe[:] = 38.0 * ease((times - off + 0.14) / 0.18) * ease((land + 0.02 - times) / 0.16)
    return _on_feet(body, rng, plan)


def _standing(style: Style, rng: np.random.Generator, times: FloatArray) -> _Body:
    """Return somebody who stands: posture, breath and the sway of an upright body."""
    angles = np.zeros((times.size, len(JOINTS), 3))
    angles[:, 0, 0] = 3.0 + 0.3 * style.lean
    for name, part in (("Spine", 0.3), ("Spine1", 0.3), ("Spine2", 0.4)):
        angles[:, INDEX[name], 0] = part * (style.lean - 3.0)
    angles[:, INDEX["Neck"], 0] = 0.8 * style.slump - 0.5 * style.lean
    angles[:, INDEX["Head"], 0] = 0.5 * style.slump - 0.3 * style.lean
    habit = rng.normal(0.0, 1.5, (2, 4))
    angles[:, pair("Arm"), 0] = 2.0 + habit[:, 0]
    angles[:, pair("Arm"), 1] = 8.0 + style.spread + habit[:, 1]
    angles[:, pair("Arm"), 2] = 12.0 + habit[:, 2]
    angles[:, pair("ForeArm")] = np.array([15.0, 0.0, 15.0]) + habit[:, 3, None]
    angles[:, pair("Hand"), 0] = 5.0
    angles[:, pair("Shoulder"), 1] = -1.5 + 0.25 * style.slump
    angles[:, pair("Shoulder"), 2] = 0.3 * style.slump
    breaths = rng.uniform(0.22, 0.32) * (1.0 + 0.1 * smooth_noise(rng, times, 1.5, 1)[:, 0])
    cycle = rng.random() + np.cumsum(breaths * np.gradient(times))
    breath = np.sin(2 * np.pi * cycle) + 0.25 * np.sin(4 * np.pi * cycle - 0.5)
    angles[:, INDEX["Spine1"], 0] -= 0.5 * breath
    angles[:, INDEX["Spine2"], 0] -= 0.6 * breath
    angles[:, INDEX["Neck"], 0] += 0.9 * breath
    angles[:, pair("Shoulder"), 1] += 0.8 * breath[:, None]
    slow, fast = smooth_noise(rng, times, 1.6, 3), smooth_noise(rng, times, 0.35, 3)
    shift = style.sway * (slow * np.array([0.7, 0.05, 0.9]) + fast * np.array([0.08, 0.02, 0.1]))
    shift[:, 1] -= 0.3
    angles[:, 0, :2] += 0.4 * slow[:, [2, 0]]
    still = np.zeros(times.size)
    return _Body(angles, shift, still.copy(), still)


def _course(
    times: FloatArray, onsets: FloatArray, lasting: FloatArray, aims: FloatArray
) -> FloatArray:
    """Return the course (frames,) from 0 to each of ``aims`` in turn, by submovements."""
    steps = np.diff(aims, prepend=0.0)
    return np.asarray(ease((times[:, None] - onsets) / lasting) @ steps)


def _keys(
    rng: np.random.Generator,
    times: FloatArray,
    onsets: FloatArray,
    lasting: FloatArray,
    poses: FloatArray,
) -> FloatArray:
    """Return (frames, channels) through key ``poses`` (keys, channels), from 0.

    Every channel starts up to 80 ms early or late and takes its own time.
    """
    shape = poses.shape
    begin = onsets[:, None] + rng.uniform(-0.08, 0.08, shape)
    long = lasting[:, None] * rng.uniform(0.9, 1.12, shape)
    steps = np.diff(poses, axis=0, prepend=0.0)
    return np.asarray((ease((times[:, None, None] - begin) / long) * steps).sum(axis=1))


def _on_feet(body: Performer, rng: np.random.Generator, plan: _Body) -> Motion:
    """Return the planned body on two feet: the legs bend so that the feet stay (or fly)."""
    rig = body.skeleton
    hip, knee, ankle = (rig.offsets[pair(name)] for name in ("UpLeg", "Leg", "Foot"))
    thigh, shank = -knee[:, 1], -ankle[:, 1]
    sole, ball = body.soles[0, :, 1], rig.offsets[pair("ToeBase")]

    # a raised heel turns the foot about its ball, which stays
    outwards = np.array([1.0, -1.0]) * (9.0 + rng.normal(0.0, 2.0, 2))
    level = about_axis(1, np.radians(outwards))
    foot = level @ about_axis(0, np.radians(plan.tiptoe))[:, None]
    balls = np.zeros((len(plan.shift), 2, 3))
    balls += hip * np.array([1.15, 0.0, 1.0]) + np.einsum("sij,sj->si", level, ball)
    balls[:, :, 1] = ball[:, 1] - sole
    balls[:, :, 2] += plan.travel[:, None] - 2.0 + rng.normal(0.0, 1.2, 2)
    ankles = balls - np.einsum("fsij,sj->fsi", foot, ball)

    rotations = limb_rotations(plan.angles)
    standing = (thigh + shank).mean() * np.cos(np.radians(_STANDING_KNEE / 2))
    root = plan.shift + np.array([0.0, standing - sole.mean() - hip[:, 1].mean(), 0.0])
    hips = root[:, None] + np.einsum("fij,sj->fsi", rotations[:, 0], hip)

    # two bones between hip and ankle; a leg that cannot reach takes its foot off the floor
    line = ankles - hips
    wanted = np.sqrt((line**2).sum(axis=2))
    most = 0.9992 * (thigh + shank)
    length = most - 0.25 * np.logaddexp(0.0, (most - wanted) / 0.25)
    down = line / wanted[..., None]
    across = np.cross(-down, np.broadcast_to(level[:, :, 2], down.shape))
    across /= np.sqrt((across**2).sum(axis=2, keepdims=True))
    leg = np.stack([across, -down, np.cross(across, -down)], axis=3)
    hip_cosine = (thigh**2 + length**2 - shank**2) / (2 * thigh * length)
    knee_cosine = (thigh**2 + shank**2 - length**2) / (2 * thigh * shank)
    upper = leg @ about_axis(0, -np.arccos(np.clip(hip_cosine, -1, 1)))
    lower = upper @ about_axis(0, np.pi - np.arccos(np.clip(knee_cosine, -1, 1)))
    toes = np.broadcast_to(level, foot.shape)
    Legs(upper, lower, foot, toes).into(rotations)
    return Motion(rotations, root)
