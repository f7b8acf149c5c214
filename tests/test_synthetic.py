"""The synthetic library: reproducible, readable, and moving like people."""

from __future__ import annotations

import time
from collections import Counter
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.clip import FloatArray, SkeletonClip
from motifold.codec.errors import UsageError
from motifold.codec.formats.bvh import format_bvh, parse_bvh
from motifold.codec.geometry.kinematics import end_positions, world_positions, world_rotations
from motifold.codec.geometry.rotations import to_axis_angle
from motifold.workflows.performers import STYLES, ease
from motifold.workflows.synthetic import (
    ACTIONS,
    ACTORS,
    SyntheticSpec,
    plan_library,
    synthetic_clip,
    write_library,
)

ON_THE_SPOT = ["idle", "wave", "reach", "sit"]
specs = st.builds(
    SyntheticSpec,
    seed=st.integers(0, 2**40),
    action=st.sampled_from(sorted(ACTIONS)),
    actor=st.integers(1, 20),
    style=st.sampled_from(sorted(STYLES)),
    take=st.integers(1, 50),
    seconds=st.floats(2.0, 8.0),
    rate=st.sampled_from([30.0, 60.0, 120.0]),
)


@lru_cache(maxsize=256)
def clip_of(action: str, style: str = "normal", actor: int = 1, take: int = 1) -> SkeletonClip:
    return synthetic_clip(11, action, actor, style, take, seconds=4.0)


def posed(clip: SkeletonClip) -> tuple[FloatArray, FloatArray]:
    """Return the world rotations and the positions of the joints and end sites."""
    world = world_rotations(clip.skeleton, clip.rotations)
    positions = world_positions(clip.skeleton, world, clip.translations)
    return world, np.concatenate([positions, end_positions(clip.skeleton, world, positions)], 1)


def place(clip: SkeletonClip, joint: str) -> FloatArray:
    return posed(clip)[1][:, clip.skeleton.names.index(joint)]


def soles(clip: SkeletonClip) -> FloatArray:
    """Return (frames, 2, 3, 3): heel, ball and toe tip of both feet, down where the shoe ends.

    In the rest pose a foot stands flat on the floor, 1.9 cm of shoe (for a foot of 12.8 cm from
    ankle to ball) below the ball joint; the heel lies a third of that length behind the ankle.
    """
    world, positions = posed(clip)
    rig = clip.skeleton
    points = []
    for side in ("Left", "Right"):
        foot, toes = rig.names.index(f"{side}Foot"), rig.names.index(f"{side}ToeBase")
        ball = rig.offsets[toes]
        tip = rig.end_offsets[list(rig.end_parents).index(toes)]
        under = -1.9 / 12.8 * ball[2]
        heel = positions[:, foot] + world[:, foot] @ [0.0, ball[1] + under, -0.33 * ball[2]]
        tread = [[0.0, under, 0.0], [tip[0], under, tip[2]]]
        points.append([heel, *(positions[:, toes] + world[:, toes] @ point for point in tread)])
    return np.moveaxis(np.array(points), 2, 0)


def slides(clip: SkeletonClip) -> list[float]:
    """Return how far each stance's point of contact drifts over the floor, in cm."""
    found = []
    for foot in np.moveaxis(soles(clip), 1, 0):
        height = foot[:, :, 1]
        stands = height.min(axis=1) < 0.8
        edges = np.flatnonzero(np.diff(stands, prepend=False, append=False))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            if stop - start < 5:
                continue
            lowest = height[start : stop - 1].argmin(axis=1)
            steps = np.diff(foot[start:stop], axis=0)[np.arange(stop - start - 1), lowest]
            found.append(float(np.hypot(*steps[:, [0, 2]].sum(axis=0))))
    return found


def knee_bends(clip: SkeletonClip) -> FloatArray:
    """Return both knees' flexion (frames, 2), degrees; negative would be backwards."""
    joints = [clip.skeleton.names.index(f"{side}Leg") for side in ("Left", "Right")]
    return np.asarray(np.degrees(to_axis_angle(clip.rotations[:, joints])[..., 0]))


@given(specs)
@settings(max_examples=60, deadline=None)
def test_every_clip_is_valid_and_human(spec: SyntheticSpec) -> None:
    clip = spec.clip()
    assert clip.frames == round(spec.seconds * spec.rate)
    assert clip.frame_time == 1.0 / spec.rate
    identity = np.swapaxes(clip.rotations, -1, -2) @ clip.rotations
    np.testing.assert_allclose(identity, np.broadcast_to(np.eye(3), identity.shape), atol=1e-9)
    _, positions = posed(clip)
    speeds = np.linalg.norm(np.diff(positions[:, : clip.skeleton.joints], axis=0), axis=2)
    assert speeds.max() * spec.rate / 100.0 < 12.0  # m/s
    bends = knee_bends(clip)
    assert bends.min() > -10.0
    assert bends.max() < 150.0
    legs = -clip.skeleton.offsets[[clip.skeleton.names.index(f"Left{n}") for n in ("Leg", "Foot")]]
    pelvis = clip.translations[:, 0, 1] / legs[:, 1].sum()
    assert 0.55 < pelvis.min() < 1.25
    assert pelvis.max() < (1.6 if spec.action == "jump" else 1.25)
    assert soles(clip)[..., 1].min() > -3.0
    if spec.action not in ("jump", "run"):
        assert soles(clip)[..., 1].min(axis=(1, 2)).max() < 1.5


@given(specs)
@settings(max_examples=15, deadline=None)
def test_the_same_specification_gives_the_same_bytes(spec: SyntheticSpec) -> None:
    assert format_bvh(spec.clip()) == format_bvh(spec.clip())


@given(specs)
@settings(max_examples=15, deadline=None)
def test_files_read_back(spec: SyntheticSpec) -> None:
    clip = spec.clip()
    back = parse_bvh(format_bvh(clip), units="cm")
    assert back.repairs == ()
    assert back.skeleton.names == clip.skeleton.names
    assert back.frame_time == clip.frame_time
    np.testing.assert_array_equal(back.skeleton.parents, clip.skeleton.parents)
    np.testing.assert_array_equal(back.skeleton.offsets, clip.skeleton.offsets)
    np.testing.assert_array_equal(back.skeleton.end_offsets, clip.skeleton.end_offsets)
    np.testing.assert_allclose(posed(back)[1], posed(clip)[1], atol=1e-4)


@given(st.integers(0, 300), st.integers(0, 300), st.integers(0, 2**40))
@settings(max_examples=20, deadline=None)
def test_a_small_plan_starts_a_large_one(few: int, more: int, seed: int) -> None:
    assert plan_library(few + more, seed)[:few] == plan_library(few, seed)


@pytest.mark.parametrize("clips", [27, 100, 1000])
def test_plans_are_balanced(clips: int) -> None:
    plan = plan_library(clips, 5)
    assert len({spec.name for spec in plan}) == clips
    actions = Counter(spec.action for spec in plan)
    assert max(actions.values()) - min(actions.values()) <= 3
    takes = Counter((spec.action, spec.actor, spec.style) for spec in plan)
    assert list(takes.values())[:-1] == [3] * (len(takes) - 1)


def test_a_full_plan_has_every_actor_in_every_style() -> None:
    full = len(ACTIONS) * len(STYLES) * ACTORS * 3
    plan = plan_library(full)
    met = {(spec.action, spec.style, spec.actor) for spec in plan}
    assert len(met) == full / 3
    slow = sum(spec.rate == 30.0 for spec in plan)
    assert 0.85 < slow / full < 0.95
    assert all(2.0 <= spec.seconds <= 8.0 for spec in plan)


def test_libraries_are_files_of_their_plan(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    small = write_library(tmp_path / "small", 4, 9)
    large = write_library(tmp_path / "new" / "large", 6, 9, lambda *done: seen.append(done))
    assert [path.name for path in large] == [f"{spec.name}.bvh" for spec in plan_library(6, 9)]
    assert [path.read_bytes() for path in small] == [path.read_bytes() for path in large[:4]]
    assert seen == [(done, 6) for done in range(1, 7)]
    assert write_library(tmp_path / "none", 0) == []


def test_names_say_what_it_is() -> None:
    spec = SyntheticSpec(0, "walk", 2, "tired", 3, 4.0, 30.0)
    assert spec.name == "walk_tired_actor2_take03"


@pytest.mark.parametrize("style", sorted(STYLES))
@pytest.mark.parametrize("action", ["walk", "walk-turn", "run"])
def test_standing_feet_do_not_slide(action: str, style: str) -> None:
    found = [
        slide
        for actor in range(1, 6)
        for take in (1, 2)
        for slide in slides(clip_of(action, style, actor, take))
    ]
    assert len(found) >= 30
    assert np.median(found) < 3.0
    assert np.quantile(found, 0.95) < 8.0
    if action == "walk":
        assert max(found) < 8.0


@pytest.mark.parametrize("action", ON_THE_SPOT)
def test_feet_stay_where_they_stand(action: str) -> None:
    for style in sorted(STYLES):
        feet = soles(clip_of(action, style))
        assert np.ptp(feet, axis=0).max() < 1.0


@pytest.mark.parametrize("style", sorted(STYLES))
def test_people_go_where_they_face(style: str) -> None:
    for action, least, most in (("walk", 0.5, 2.2), ("run", 1.5, 5.0)):
        clip = clip_of(action, style, 3)
        path = clip.translations[[40, 80], 0]
        way = path[1] - path[0]
        facing = clip.rotations[40:80, 0, :, 2].mean(axis=0)
        speed = np.hypot(way[0], way[2]) / 100.0 / (40 * clip.frame_time)
        assert least < speed < most
        cosine = (way @ facing) / np.linalg.norm(way) / np.linalg.norm(facing)
        assert cosine > 0.9


def test_arms_swing_against_the_legs() -> None:
    clip = clip_of("walk", "happy", 2)
    forwards = clip.rotations[40:80, 0, :, 2]
    for side in ("Left", "Right"):
        pelvis = clip.translations[40:80, 0]
        hand = ((place(clip, f"{side}Hand")[40:80] - pelvis) * forwards).sum(axis=1)
        foot = ((place(clip, f"{side}Foot")[40:80] - pelvis) * forwards).sum(axis=1)
        assert np.corrcoef(hand, foot)[0, 1] < -0.5


def test_actions_do_what_they_say() -> None:
    for actor in range(1, 5):
        waving = clip_of("wave", "normal", actor)
        up = place(waving, "RightHand")[:, 1] - place(waving, "Head")[:, 1]
        assert up.max() > 5.0
        assert (place(waving, "LeftHand")[:, 1] < place(waving, "Spine")[:, 1]).all()
        reaching = clip_of("reach", "normal", actor)
        away = place(reaching, "RightHand") - place(reaching, "Hips")
        facing = reaching.rotations[0, 0, :, 2]
        assert np.ptp(away @ facing) > 35.0
        assert 35.0 < place(clip_of("sit", "normal", actor), "Hips")[:, 1].min() < 70.0
        in_air = soles(clip_of("jump", "normal", actor))[..., 1].min(axis=(1, 2))
        assert 6.0 < in_air.max() < 40.0
        turning = clip_of("turn", "normal", actor).rotations[:, 0, :, 2]
        angle = np.degrees(np.unwrap(np.arctan2(turning[:, 0], turning[:, 2])))
        assert 60.0 < angle.max() - angle[0] < 125.0
        assert np.ptp(place(clip_of("idle", "normal", actor), "Hips"), axis=0).max() < 15.0


def pose_features(clip: SkeletonClip) -> FloatArray:
    """Return the mean and the spread of all joints around the pelvis, in its own axes, cm."""
    _, positions = posed(clip)
    around = positions - clip.translations[:, :1]
    local = np.einsum("fij,fki->fkj", clip.rotations[:, 0], around)
    return np.concatenate([local.mean(axis=0).ravel(), local.std(axis=0).ravel()])


def test_retakes_are_alike_and_other_actions_are_not() -> None:
    keys = [(action, take) for action in ACTIONS for take in (1, 2, 3)]
    features = np.array(
        [pose_features(clip_of(action, "normal", 4, take)) for action, take in keys]
    )
    apart = np.sqrt(((features[:, None] - features) ** 2).mean(axis=2))
    same = np.array([[a == b for b, _ in keys] for a, _ in keys])
    itself = np.eye(len(keys), dtype=bool)
    assert apart[same & ~itself].mean() < 0.4 * apart[~same].mean()
    nearest = np.where(itself, np.inf, apart).argmin(axis=1)
    alike = np.mean(
        [keys[found][0] == action for found, (action, _) in zip(nearest, keys, strict=True)]
    )
    assert alike > 0.85


@pytest.mark.parametrize("action", sorted(ACTIONS))
def test_retakes_differ_by_more_than_noise(action: str) -> None:
    first, second = (pose_features(clip_of(action, "normal", 4, take)) for take in (1, 2))
    assert (
        np.abs(first - second).mean() > 0.1
    )  # cm, of means over 120 frames: the noise gives 0.003
    for one, other in (("take", 2), ("actor", 5)):
        changed = clip_of(action, "normal", **{"actor": 4, "take": 1, one: other})
        assert not np.array_equal(changed.rotations, clip_of(action, "normal", 4, 1).rotations)


def test_an_actor_keeps_one_rig() -> None:
    rigs = {
        tuple(clip_of(action, style, actor).skeleton.offsets.ravel())
        for actor in (1, 2, 3)
        for action in ("walk", "wave")
        for style in ("normal", "tired")
    }
    assert len(rigs) == 3
    for rig in rigs:
        assert tuple(round(length, 4) for length in rig) == rig


@pytest.mark.parametrize("action", ["walk", "wave", "idle", "jump"])
def test_a_faster_camera_sees_the_same_motion(action: str) -> None:
    slow = synthetic_clip(2, action, 1, "normal", 1, seconds=4.0, rate=30.0)
    fast = synthetic_clip(2, action, 1, "normal", 1, seconds=4.0, rate=120.0)
    gap = np.linalg.norm(posed(slow)[1] - posed(fast)[1][::4], axis=2)
    assert np.median(gap) < 3.0


def test_sensor_noise_is_small_and_present() -> None:
    clip = synthetic_clip(4, "idle", 1, "normal", 1, seconds=4.0)
    path = clip.translations[:, 0]
    width = 9
    smooth = np.stack([np.convolve(axis, np.ones(width) / width, "valid") for axis in path.T], 1)
    rest = path[width // 2 : -(width // 2)] - smooth
    assert 0.005 < rest.std() < 0.1  # cm


@given(st.floats(-2.0, 3.0))
def test_submovements_start_and_end_at_rest(progress: float) -> None:
    here = ease(np.array([progress]))[0]
    assert 0.0 <= here <= 1.0
    np.testing.assert_allclose(here + ease(np.array([1.0 - progress]))[0], 1.0, atol=1e-9)


def test_wrong_arguments_say_what_is_known() -> None:
    with pytest.raises(UsageError, match="walk-turn"):
        synthetic_clip(0, "fly", 1, "normal", 1)
    with pytest.raises(UsageError, match="tired"):
        synthetic_clip(0, "walk", 1, "sleepy", 1)
    for wrong in ({"seconds": 1.0}, {"seconds": 1e12}, {"rate": 0.0}, {"seconds": float("nan")}):
        with pytest.raises(UsageError, match="2 to 600 s"):
            synthetic_clip(0, "walk", 1, "normal", 1, **wrong)
    with pytest.raises(UsageError, match="negative"):
        synthetic_clip(-1, "walk", 1, "normal", 1)
    with pytest.raises(UsageError):
        plan_library(-1)


def test_a_core_makes_fifty_clips_a_second() -> None:
    synthetic_clip(0, "walk", 1, "normal", 0, seconds=4.0)
    start = time.process_time()
    for take in range(3):
        for action in ACTIONS:
            synthetic_clip(0, action, 1, "normal", take, seconds=4.0)
    assert 3 * len(ACTIONS) / (time.process_time() - start) > 50.0
