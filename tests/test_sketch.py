"""Sketches: clips that move alike are near each other, whatever their joints are called."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from clips import Recipe, family_of, noisy, random_parts, skeleton_clip
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from motifold.codec.blocks.motionmodel import usual_span
from motifold.codec.blocks.recall import STRIDE as MOMENT_STRIDE
from motifold.codec.clip import SkeletonClip
from motifold.codec.figure.bodyparts import body_parts
from motifold.codec.figure.rig import rig_of
from motifold.codec.geometry.limits import uniform_limits
from motifold.codec.learned.sketch import SKETCH_NUMBERS, STRIDE, Sketch, sketch_of
from motifold.codec.version2.motiongoal import goal_of
from motifold.workflows.synthetic import ACTIONS, synthetic_clip


def sketched(clip: SkeletonClip) -> Sketch:
    rig = rig_of(clip, body_parts(clip.skeleton))
    goal = goal_of(clip, rig, family_of(clip, rig), uniform_limits(clip, 0.1))
    return sketch_of(goal.path, goal.nodes, rig)


@cache
def take(action: str, number: int = 1) -> SkeletonClip:
    return synthetic_clip(7, action, 1, "normal", number, seconds=4.0)


def apart(one: Sketch, other: Sketch) -> float:
    """How far the moments of each are from the nearest of the other, in the mean."""
    distances = cdist(one, other)
    return float(distances.min(axis=1).mean() + distances.min(axis=0).mean()) / 2


@pytest.mark.parametrize("action", ACTIONS)
@pytest.mark.parametrize(("degrees", "share"), [(0.02, 0.25), (0.1, 0.9)])
def test_a_noisy_clip_is_nearer_than_any_other_motion(
    action: str, degrees: float, share: float
) -> None:
    """Noise in every joint and frame, which what is compared of accelerations magnifies."""
    own = sketched(take(action))
    near = apart(sketched(noisy(take(action), degrees)), own)
    for other in ACTIONS:
        if other != action:
            assert near < share * apart(sketched(take(other)), own), other


@pytest.mark.parametrize("action", ACTIONS)
def test_a_renamed_clip_is_the_same(action: str) -> None:
    clip = take(action)
    names = {"LeftArm": "lShldr", "RightArm": "rShldr", "Hips": "hip", "Head": "Kopf"}
    others = tuple(names.get(name, name) for name in clip.skeleton.names)
    assert others != clip.skeleton.names
    found = sketched(replace(clip, skeleton=replace(clip.skeleton, names=others)))
    assert apart(found, sketched(clip)) < 1.0


def test_another_take_of_an_action_is_nearer_than_another_action() -> None:
    own = sketched(take("walk"))
    second = apart(sketched(take("walk", 2)), own)
    for other in ("reach", "wave", "sit", "jump"):
        assert second < apart(sketched(take(other)), own), other


def test_a_clip_that_is_turned_and_moved_is_the_same() -> None:
    """Somebody who walks the same way elsewhere."""
    clip = take("walk")
    turn = Rotation.from_rotvec([0.0, 2.0, 0.0]).as_matrix()
    rotations, translations = clip.rotations.copy(), clip.translations.copy()
    rotations[:, 0] = turn @ rotations[:, 0]
    translations[:, 0] = translations[:, 0] @ turn.T + np.array([300.0, 0.0, -50.0])
    found = sketched(replace(clip, rotations=rotations, translations=translations))
    own = sketched(clip)
    size = float(np.linalg.norm(own, axis=1).mean())
    assert np.linalg.norm(found - own, axis=1).max() < 0.05 * size


@pytest.mark.parametrize(("frames", "rate"), [(0, 30.0), (1, 30.0), (5, 30.0), (90, 120.0)])
def test_a_sketch_has_a_row_for_every_eighth_frame(frames: int, rate: float) -> None:
    clip = skeleton_clip(Recipe(joints=6, frames=frames, rate=rate))
    rig = rig_of(clip, random_parts(0, 6))
    goal = goal_of(clip, rig, family_of(clip, rig), uniform_limits(clip, 0.1))
    found = sketch_of(goal.path, goal.nodes, rig)
    last = frames - usual_span(clip.frame_time)  # a moment has a whole block ahead
    assert found.shape == (len(range(1, last + 1, STRIDE * MOMENT_STRIDE)), SKETCH_NUMBERS)
    assert found.dtype == np.float32
    assert np.isfinite(found).all()
