"""Forward kinematics against an oracle that composes SciPy rotations joint by joint."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
from clips import Recipe, recipes, skeleton_clip
from hypothesis import given, settings

from motifold.codec.clip import Skeleton
from motifold.codec.geometry.kinematics import (
    end_positions,
    hanging_joints,
    levers,
    local_rotations,
    world_positions,
    world_rotations,
)
from motifold.codec.geometry.rotations import from_axis_angle


@given(recipes())
@settings(max_examples=40, deadline=None)
def test_poses_are_the_oracles(recipe: Recipe) -> None:
    clip = skeleton_clip(recipe)
    world = world_rotations(clip.skeleton, clip.rotations)
    positions = world_positions(clip.skeleton, world, clip.translations)
    theirs, where = oracle.pose(oracle.of_clip(clip))
    size = max(1.0, float(np.abs(where).max(initial=0.0)))
    assert np.abs(positions - where).max(initial=0.0) < 1e-12 * size
    if clip.frames:
        matrices = np.stack([turn.as_matrix() for turn in theirs], axis=1)
        assert np.abs(world - matrices).max() < 1e-12
        ends = end_positions(clip.skeleton, world, positions)
        for number, (carrier, offset) in enumerate(oracle.of_clip(clip).ends):
            there = where[:, carrier] + theirs[carrier].apply(offset)
            assert np.abs(ends[:, number] - there).max() < 1e-12 * size


@given(recipes())
@settings(max_examples=40, deadline=None)
def test_local_rotations_invert_world_rotations(recipe: Recipe) -> None:
    clip = skeleton_clip(recipe)
    back = local_rotations(clip.skeleton, world_rotations(clip.skeleton, clip.rotations))
    assert np.abs(back - clip.rotations).max(initial=0.0) < 1e-12


def test_hanging_joints_of_a_small_tree() -> None:
    tree = Skeleton(tuple("abcdef"), np.array([-1, 0, 1, 1, 0, 4]), np.zeros((6, 3)))
    assert hanging_joints(tree).tolist() == [6, 3, 1, 1, 2, 1]


@pytest.mark.parametrize("seed", range(5))
def test_a_lever_is_the_displacement_of_a_small_turn(seed: int) -> None:
    """Summed squared displacements: what hangs on a joint moves along with the child's origin."""
    recipe = Recipe(seed, joints=12, frames=1, motion="smooth")
    skeleton = skeleton_clip(recipe).skeleton
    turn = 1e-6
    expected = []
    for joint in range(skeleton.joints):
        # the worst axis is another for every offset: the lever bounds them by |offset|
        square = 3.0**2
        for child in skeleton.children()[joint]:
            offset = skeleton.offsets[child]
            across = np.linalg.svd(offset[None])[2][1]  # a unit vector at right angles to it
            moved = (from_axis_angle(across * turn) - np.eye(3)) @ offset / turn
            below, waiting = 0, [child]
            while waiting:
                below += 1
                waiting += skeleton.children()[waiting.pop()]
            square += below * (moved**2).sum()
        for carrier, offset in zip(skeleton.end_parents, skeleton.end_offsets, strict=True):
            square += (offset**2).sum() if carrier == joint else 0.0
        expected.append(np.sqrt(square))
    assert np.allclose(levers(skeleton), expected, rtol=1e-5)
