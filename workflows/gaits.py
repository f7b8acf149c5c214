"""Synthetic locomotion: legs driven by the phase of the gait, the root driven by the feet.

Thigh, knee and foot follow the curves of a gait; the root goes where the standing foot pushes
it, and as high as the lower foot allows.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..codec.clip import FloatArray
from ..codec.geometry.rotations import about_axis, from_euler
from .gait_curves import RUN, SHUFFLE, WALK, Gait, leg_angles
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


def walk(body: Performer, style: Style, rng: np.random.Generator, times: FloatArray) -> Motion:
    """Return a walk, more or less straight on."""
    return _locomotion(body, style, rng, times, WALK, np.zeros(0))


def run(body: Performer, style: Style, rng: np.random.Generator, times: FloatArray) -> Motion:
    """Return a run, more or less straight on."""
    return _locomotion(body, style, rng, times, RUN, np.zeros(0))


def walk_turn(body: Performer, style: Style, rng: np.random.Generator, times: FloatArray) -> Motion:
    """Return a walk with a bend of 60 to 130 degrees to the left."""
    return _locomotion(body, style, rng, times, WALK, rng.uniform(60, 130, 1))


def turn(body: Performer, style: Style, rng: np.random.Generator, times: FloatArray) -> Motion:
    """Return a turn on the spot by about 90 degrees, and back again where there is time."""
    there = 90.0 + 12.0 * float(np.clip(rng.standard_normal(), -2, 2))
    back = -there + 8.0 * float(np.clip(rng.standard_normal(), -2, 2))
    turns = [there] if times[-1] < 4.5 else [there, back]
    return _locomotion(body, style, rng, times, SHUFFLE, np.array(turns))


def _locomotion(
    body: Performer,
    style: Style,
    rng: np.random.Generator,
    times: FloatArray,
    gait: Gait,
    turns: FloatArray,
) -> Motion:
    phase, effort = _phase(style, rng, times, gait)
    heading = _heading(rng, times, phase, turns)
    stroke = np.stack([phase, phase + 0.5], axis=1)
    legs_range = style.stride**gait.freedom * (1.0 + style.asymmetry * np.array([0.5, -0.5]))
    legs_range = legs_range * (1.0 + 0.035 * smooth_noise(rng, times, 0.9, 2))

    pelvis = _pelvis(style, rng, times, phase, effort, heading)
    legs = _legs(style, gait, stroke, effort, legs_range, _planted(phase, stroke, heading))
    angles = _upper_body(style, rng, times, gait, phase, effort, heading)
    rotations = limb_rotations(angles)
    rotations[:, 0] = pelvis
    legs.into(rotations)
    return Motion(rotations, _root(body, gait, times, stroke, effort, pelvis, legs))


def _phase(
    style: Style, rng: np.random.Generator, times: FloatArray, gait: Gait
) -> tuple[FloatArray, FloatArray]:
    """Return the left leg's phase in strides, and the effort (0 standing, 1 going), (frames,).

    Somebody who stands is in the middle of one foot's stance with no effort, and takes the first
    step with the other foot.
    """
    rests = rng.random(2) < gait.rests  # stands at the start, at the end
    pace = (
        gait.strides
        * style.cadence**gait.freedom
        * (1.0 + 0.035 * smooth_noise(rng, times, 0.8, 1)[:, 0])
    )
    start, stop = rng.uniform(0.1, 0.4, 2)
    if rests[0]:
        pace = pace * ease((times - start) / 0.7)
    if rests[1]:
        pace = pace * ease((times[-1] - stop - times) / 0.7)
    step = np.diff(times, prepend=times[0])
    strides = np.cumsum(pace * step)
    first = 0.3 + 0.5 * rng.integers(2) if rests[0] else rng.random()
    last = first + strides[-1]
    if rests[1]:  # stretch time a little, to halt in the middle of a stance
        last = max(np.round((last - 0.3) * 2.0), np.ceil((first - 0.3) * 2.0) + 1.0) / 2.0 + 0.3
        strides *= (last - first) / strides[-1]
    phase = first + strides
    effort = np.ones_like(phase)
    if rests[0]:
        effort = ease((phase - first) / 0.22)
    if rests[1]:
        effort = effort * ease((last - phase) / 0.22)
    return phase, effort


def _heading(
    rng: np.random.Generator, times: FloatArray, phase: FloatArray, turns: FloatArray
) -> FloatArray:
    """Return where the body faces (frames,), degrees to the left of the start."""
    heading = 2.5 * smooth_noise(rng, times, 2.0, 1)[:, 0]
    gone = (phase - phase[0]) / (phase[-1] - phase[0])
    for place, angle in enumerate(turns):
        begin = (place + rng.uniform(0.04, 0.2)) / turns.size
        heading = heading + angle * ease((gone - begin) * turns.size / rng.uniform(0.6, 0.8))
    return heading


def _planted(phase: FloatArray, stroke: FloatArray, heading: FloatArray) -> FloatArray:
    """Return where each foot points (frames, 2), degrees: held in stance, turned in swing."""
    stride = np.floor(stroke)
    ahead = ease((stroke - stride - 0.62) / 0.34)
    behind = np.array([0.0, 0.5])  # the right foot's middle of stance comes half a stride later
    now = np.interp(stride + 0.3 - behind, phase, heading)
    after = np.interp(stride + 1.3 - behind, phase, heading)
    return np.asarray(now + ahead * (after - now) + np.array([7.0, -7.0]))


def _pelvis(
    style: Style,
    rng: np.random.Generator,
    times: FloatArray,
    phase: FloatArray,
    effort: FloatArray,
    heading: FloatArray,
) -> FloatArray:
    """Return the pelvis' world rotations (frames, 3, 3)."""
    turn = 2 * np.pi * phase
    size = effort * (1.0 + 0.06 * smooth_noise(rng, times, 0.9, 1)[:, 0])
    yaw = heading - 4.5 * style.stride * size * np.cos(turn)
    tilt = 3.0 + 0.3 * style.lean + 1.4 * style.energy * size * np.cos(2 * turn - 0.6)
    roll = size * (2.3 * np.sqrt(style.sway) * np.sin(turn + 0.15) + 0.7 * np.sin(3 * turn))
    wander = smooth_noise(rng, times, 1.1, 3) * np.array([0.5, 0.4, 0.4])
    return from_euler("YXZ", np.radians(np.stack([yaw, tilt, roll], axis=1) + wander))


def _legs(
    style: Style,
    gait: Gait,
    stroke: FloatArray,
    effort: FloatArray,
    reach: FloatArray,
    pointing: FloatArray,
) -> Legs:
    """Return both legs at the phases ``stroke`` (frames, 2)."""
    thigh, knee, foot = leg_angles(gait, stroke)
    size = effort[:, None]
    rest = 6.0 + 0.5 * abs(style.lean)  # a standing knee is a little bent
    thigh = rest / 2 + size * (reach * (thigh - 4.0) + 4.0 - rest / 2)
    knee = np.maximum(rest + size * ((0.4 + 0.6 * reach) * (knee - rest)), 1.0)
    # short steps, and the first and the last one, have to clear the floor too
    late = np.exp(6.0 * (np.cos(2 * np.pi * (stroke - 0.87)) - 1.0))
    swing = np.exp(2.0 * (np.cos(2 * np.pi * (stroke - 0.75)) - 1.0))
    lift = size * (48.0 * np.maximum(1.0 - reach, 0.0) * late + 200.0 * (1.0 - size) * swing)
    thigh, knee = thigh + 0.55 * lift, knee + lift
    foot = size * reach**1.6 * foot  # short steps are flat-footed
    spread = np.array([1.0, -1.0]) * (-1.6 + 0.5 * style.spread)
    rock = 2.2 * style.sway * effort * np.sin(2 * np.pi * (stroke[:, 0] - 0.05))
    side = spread + rock[:, None] * (0.4 if gait is RUN else 1.0)
    plane = about_axis(1, np.radians(pointing))
    leg = plane @ about_axis(2, np.radians(side))
    upper = leg @ about_axis(0, np.radians(-thigh))
    lower = leg @ about_axis(0, np.radians(knee - thigh))
    sole = plane @ about_axis(0, np.radians(-foot))
    toes_up = 0.75 * np.logaddexp(0.0, -(foot + 12.0) / 5.0) * 5.0  # toes stay on the ground
    toes = plane @ about_axis(0, np.radians(-np.minimum(foot + toes_up, foot + 45.0)))
    return Legs(upper, lower, sole, toes)


def _upper_body(
    style: Style,
    rng: np.random.Generator,
    times: FloatArray,
    gait: Gait,
    phase: FloatArray,
    effort: FloatArray,
    heading: FloatArray,
) -> FloatArray:
    """Return anatomical angles (frames, joints, 3): the trunk turns and sways against the legs."""
    angles = np.zeros((times.size, len(JOINTS), 3))
    size = effort * (1.0 + 0.06 * smooth_noise(rng, times, 0.8, 1)[:, 0])
    turn = 2 * np.pi * phase
    ahead = np.interp(times + 0.3, times, heading) - heading  # eyes lead, shoulders follow
    spine = [INDEX["Spine"], INDEX["Spine1"], INDEX["Spine2"]]
    twist = 7.5 * style.swing * size * np.cos(turn - 0.2) + 0.25 * ahead
    bend = -size * 3.4 * style.sway * np.sin(turn + 0.1)
    bob = 1.2 * style.energy * size * np.cos(2 * turn + 0.8)
    lean = style.lean + gait.lean * effort - 3.0
    angles[:, spine, 0] = (lean + bob)[:, None] * np.array([0.3, 0.3, 0.4])
    angles[:, spine, 1] = bend[:, None] * np.array([0.4, 0.35, 0.25])
    angles[:, spine, 2] = twist[:, None] * np.array([0.25, 0.35, 0.4])
    neck, head = INDEX["Neck"], INDEX["Head"]
    angles[:, neck, 0] = 0.8 * style.slump - 0.5 * lean - 0.4 * bob
    angles[:, head, 0] = 0.5 * style.slump - 0.4 * lean - 0.3 * bob
    angles[:, neck, 2] = 0.4 * ahead - 0.25 * twist
    angles[:, head, 2] = 0.4 * ahead - 0.2 * twist
    arm, elbow, wrist, girdle = pair("Arm"), pair("ForeArm"), pair("Hand"), pair("Shoulder")
    opposite = turn[:, None] + np.array([np.pi, 0.0])  # against the leg of the same side
    range_ = (
        gait.swing * style.swing * size[:, None] * (1 + style.asymmetry * np.array([0.6, -0.6]))
    )
    range_ = range_ * (1.0 + 0.07 * smooth_noise(rng, times, 1.0, 2))
    bent = 14.0 + (gait.elbow - 14.0) * effort[:, None]
    angles[:, arm, 0] = range_ * np.cos(opposite - 0.15) + 0.12 * range_ * np.cos(2 * opposite)
    angles[:, arm, 1] = 8.0 + style.spread + 0.1 * range_ * np.cos(2 * opposite - 0.8)
    angles[:, arm, 2] = 12.0 + 0.15 * range_ * np.cos(opposite)
    angles[:, elbow, 0] = bent + 0.42 * range_ * (1.0 + np.cos(opposite - 0.75))
    angles[:, elbow, 2] = 15.0 + 0.1 * range_ * np.cos(opposite - 0.9)
    angles[:, wrist, 0] = 5.0 - 0.2 * range_ * np.cos(opposite - 1.3)
    angles[:, girdle, 1] = -1.5 + 0.25 * style.slump + 0.03 * range_ * np.cos(2 * opposite)
    angles[:, girdle, 2] = 0.3 * style.slump + 0.15 * range_ * np.cos(opposite - 0.1)
    return angles


def _root(
    body: Performer,
    gait: Gait,
    times: FloatArray,
    stroke: FloatArray,
    effort: FloatArray,
    pelvis: FloatArray,
    legs: Legs,
) -> FloatArray:
    """Return the root path (frames, 3) that leaves the carrying foot where it stands."""
    rig = body.skeleton

    def hung(name: str, carrier: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("fsij,sj->fsi", carrier, rig.offsets[pair(name)]))

    ankle = hung("UpLeg", pelvis[:, None]) + hung("Leg", legs.thigh) + hung("Foot", legs.shank)
    ball = ankle + hung("ToeBase", legs.foot)
    heel, under, tip = body.soles
    soles = np.stack(
        [
            ankle + np.einsum("fsij,sj->fsi", legs.foot, heel),
            ball + np.einsum("fsij,sj->fsi", legs.toes, under),
            ball + np.einsum("fsij,sj->fsi", legs.toes, tip),
        ],
        axis=2,
    )  # (frames, side, point, 3)

    # weight on each point of a foot: the lower ones carry
    height = soles[..., 1]
    share = np.exp(-(height - height.min(axis=2, keepdims=True)) / 0.5)
    share /= share.sum(axis=2, keepdims=True)
    inside = (stroke - gait.contact) % 1.0
    carries = ease(inside / gait.shift) - ease((inside - gait.stance) / gait.shift)
    weight = share * carries[..., None]
    weight = 0.5 * (weight[1:] + weight[:-1])
    total = weight.sum(axis=(1, 2))
    push = -(weight[..., None] * np.diff(soles, axis=0)).sum(axis=(1, 2))[:, [0, 2]]
    grounded = np.flatnonzero(total > 0.5)
    place = np.arange(total.size)
    steps = np.stack(
        [np.interp(place, grounded, push[grounded, axis] / total[grounded]) for axis in range(2)],
        axis=1,
    )
    rate = 1.0 / (times[1] - times[0])
    aloft = np.maximum(0.0, 1.0 - carries.sum(axis=1))
    level = -np.logaddexp.reduce(-height.reshape(times.size, -1) / 0.2, axis=1) * 0.2
    down = np.flatnonzero(aloft < 0.5)
    level = np.interp(np.arange(times.size), down, level[down])
    flight = (0.5 - gait.stance - gait.shift) / gait.strides  # s; free fall rises by g T² / 8
    rise = 981.0 / 8.0 * max(flight, 0.0) ** 2 * effort * np.sin(0.5 * np.pi * aloft)
    root = np.zeros((times.size, 3))
    root[1:, [0, 2]] = np.cumsum(steps, axis=0)
    root[:, 1] = gaussian_filter1d(rise - level, 0.012 * rate)
    return root
