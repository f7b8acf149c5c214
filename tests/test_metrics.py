"""Errors against the oracle's, which sums no expanded squares and shares no kinematics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import oracle
import pytest
from clips import Recipe, marker_clip, recipes, skeleton_clip
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from motifold.codec.clip import SkeletonClip
from motifold.codec.geometry import metrics
from motifold.codec.geometry.metrics import Errors, clip_errors, marker_errors, summarise


def shaken(clip: SkeletonClip, seed: int, size: float) -> SkeletonClip:
    """The clip with every rotation and translation off by about ``size``."""
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(size * rng.normal(size=(clip.frames * clip.skeleton.joints, 3)))
    noise = turns.as_matrix().reshape(clip.rotations.shape)
    moved = clip.translations + size * rng.normal(size=clip.translations.shape)
    return replace(clip, rotations=clip.rotations @ noise, translations=moved)


@given(recipes(), st.sampled_from([1e-6, 1e-3, 0.1, 2.0]))
@settings(max_examples=40, deadline=None)
def test_shell_errors_are_the_oracles(recipe: Recipe, size: float) -> None:
    clip = skeleton_clip(recipe)
    other = shaken(clip, recipe.seed, size)
    ours = clip_errors(clip, other)
    theirs = oracle.shell_error(oracle.of_clip(clip), oracle.of_clip(other))
    points = recipe.joints + len(clip.skeleton.end_parents)
    assert ours.shape == theirs.shape == (clip.frames, points)
    assert np.abs(ours - theirs).max(initial=0.0) < 1e-9


def test_long_clips_are_measured_like_short_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    clip = skeleton_clip(Recipe(3, joints=5, frames=50))
    other = shaken(clip, 4, 0.1)
    whole = clip_errors(clip, other)
    monkeypatch.setattr(metrics, "BLOCK_FRAMES", 7)
    assert np.array_equal(clip_errors(clip, other), whole)


def test_a_turn_where_no_child_shows_it_counts() -> None:
    clip = skeleton_clip(Recipe(1, joints=1, frames=3, bone=0.0))
    turned = replace(clip, rotations=clip.rotations @ Rotation.from_rotvec([0, 0, 0.1]).as_matrix())
    errors = clip_errors(clip, turned)
    assert errors[:, 0] == pytest.approx(2 * 3.0 * np.sin(0.05))


@given(st.integers(0, 2**32 - 1), st.integers(0, 40))
@settings(max_examples=40, deadline=None)
def test_marker_errors_are_the_oracles(seed: int, frames: int) -> None:
    clip = marker_clip(seed, 5, frames)
    rng = np.random.default_rng(seed)
    other = replace(clip, positions=clip.positions + rng.normal(size=clip.positions.shape))
    assert np.allclose(marker_errors(clip, other), oracle.marker_error(clip, other), atol=1e-12)


def test_summary() -> None:
    errors = np.arange(101.0).reshape(1, 101)
    assert summarise(errors) == Errors(100.0, 50.0, 99.0)
    assert summarise(np.zeros((0, 4))) == Errors(0.0, 0.0, 0.0)
