"""Decoded clips in a mirror: left is right, nothing is rounded; strange figures have no image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clips import Recipe, family_of, in_mirror, skeleton_clip
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.arithmetic.fixedpoint import ONE
from motifold.codec.blocks.mirrored import image_of, mirrored
from motifold.codec.blocks.nodes import KIND, PLACE
from motifold.codec.clip import FloatArray, IntArray, SkeletonClip
from motifold.codec.figure.bodyparts import body_parts
from motifold.codec.figure.jointnames import other_side
from motifold.codec.figure.mirror import SIGNS, find_mirror, image_parts
from motifold.codec.figure.rig import Family, Rig, rig_of
from motifold.codec.geometry.kinematics import world_positions, world_rotations
from motifold.codec.geometry.limits import uniform_limits
from motifold.codec.geometry.rotations import from_quaternions
from motifold.codec.version2.motioncodec import clip_of
from motifold.codec.version2.motiongoal import Goal, goal_of
from motifold.workflows.synthetic import synthetic_clip


def as_wide(clip: SkeletonClip) -> SkeletonClip:
    """Return a clip on bones whose left and right are equally long."""
    names = [name.lower() for name in clip.skeleton.names]
    partner = [names.index(other_side(name)) for name in clip.skeleton.names]
    ends = clip.skeleton.end_parents.tolist()
    other = [ends.index(partner[joint]) for joint in ends]
    glass, skeleton = np.array([-1.0, 1.0, 1.0]), clip.skeleton
    offsets = (skeleton.offsets + skeleton.offsets[partner] * glass) / 2
    tips = (skeleton.end_offsets + skeleton.end_offsets[other] * glass) / 2
    translations = np.tile(offsets, (clip.frames, 1, 1))
    translations[:, 0] = clip.translations[:, 0]
    skeleton = replace(skeleton, offsets=offsets, end_offsets=tips)
    return replace(clip, skeleton=skeleton, translations=translations)


def take(action: str = "walk-turn") -> tuple[SkeletonClip, Rig, Family, Goal]:
    clip = as_wide(synthetic_clip(7, action, 1, "normal", 1, seconds=3.0))
    rig = rig_of(clip, body_parts(clip.skeleton))
    usual = as_wide(synthetic_clip(7, "walk", 1, "normal", 1, seconds=3.0))
    family = family_of(usual, rig)  # who waves has one arm up
    return clip, rig, family, goal_of(clip, rig, family, uniform_limits(clip, 0.1))


def places(clip: SkeletonClip) -> FloatArray:
    world = world_rotations(clip.skeleton, clip.rotations)
    return world_positions(clip.skeleton, world, clip.translations)


@pytest.mark.parametrize("action", ["walk-turn", "wave", "jump"])
def test_the_image_is_where_a_mirror_shows_it(action: str) -> None:
    clip, rig, family, goal = take(action)
    image = image_of((goal.path,), goal.nodes, rig, family)
    assert image is not None
    states, nodes = image
    shown = clip_of(rig, nodes, states, None)
    assert isinstance(shown, SkeletonClip)
    partner = [joint for joint, _ in family.mirror]
    assert sorted(partner) == list(range(rig.skeleton.joints)) != partner
    np.testing.assert_allclose(places(shown), places(clip)[:, partner] * [-1, 1, 1], atol=1e-4)
    np.testing.assert_allclose(places(shown), places(in_mirror(clip)), atol=1e-4)


@given(st.integers(0, 40), st.lists(st.integers(0, 3), min_size=7, max_size=7))
@settings(max_examples=30)
def test_two_mirrors_show_the_clip(seed: int, axes: list[int]) -> None:
    """Bit for bit, whatever the axes are; but turns may come back with all signs changed."""
    clip = skeleton_clip(Recipe(seed, joints=7, frames=9, stretchy=0.4, hinges=0.3))
    rig = rig_of(clip, body_parts(clip.skeleton))
    family = replace(family_of(clip, rig), mirror=tuple(enumerate(axes)))
    goal = goal_of(clip, rig, family, uniform_limits(clip, 0.1))
    once = image_of((goal.path,), goal.nodes, rig, family)
    assert once is not None
    twice = image_of(*once, rig, family)
    assert twice is not None
    turning = goal.nodes.table[:, KIND] != PLACE
    same = _front(twice[0][0][:, turning])
    np.testing.assert_array_equal(same, _front(goal.path[:, turning]))
    np.testing.assert_array_equal(twice[0][0][:, ~turning], goal.path[:, ~turning])
    _assert_reflected(goal.path, once[0][0], turning, family, goal)


def _front(turns: IntArray) -> IntArray:
    first = np.take_along_axis(turns, np.abs(turns).argmax(axis=-1)[..., None], axis=-1)
    return np.asarray(turns * np.sign(first))


def _assert_reflected(
    path: IntArray, image: IntArray, turning: np.ndarray, family: Family, goal: Goal
) -> None:
    """Turns are M Q S: what the mirror does to the world, and its axes to the joint."""
    joints = goal.nodes.table[turning, 6]
    signs = SIGNS[[family.mirror[joint][1] for joint in joints]]
    turns = [from_quaternions(each[:, turning] / ONE) for each in (path, image)]
    wanted = np.diag([-1, 1, 1]) @ turns[0] * signs[:, None]
    np.testing.assert_allclose(turns[1], wanted, atol=1e-7)


def test_images_of_some_nodes_are_those_of_the_image() -> None:
    _, rig, family, goal = take()
    whole = image_of((goal.path,), goal.nodes, rig, family)
    assert whole is not None
    partner = [joint for joint, _ in family.mirror]
    number = [part.name for part in rig.parts].index("left_arm")
    (other,) = image_parts(family.mirror, rig.parts, [number])
    assert rig.parts[other].name == "right_arm"
    chain = {*rig.parts[number].joints, *(j for part in rig.parts[:3] for j in part.joints)}
    chain |= {partner[joint] for joint in chain if joint not in rig.parts[number].joints}
    kept = np.flatnonzero(np.isin(goal.nodes.table[:, 6], list(chain)))
    kept = np.union1d(kept, [goal.nodes.top, goal.nodes.path])
    some = goal.nodes.only(kept)
    shown = mirrored((goal.path[:, kept],), some, rig, family, goal.still, goal.sliding)
    assert shown is not None
    rows = whole[1].table[:, 1].tolist()
    there = [rows.index(row) for row in shown[1].table[:, 1].tolist()]
    np.testing.assert_array_equal(shown[0][0], whole[0][0][:, there])


def test_a_figure_without_sides_that_are_alike_has_no_image() -> None:
    clip, rig, family, goal = take()
    names, parents = list(rig.skeleton.names), rig.skeleton.parents
    centres, bones = family.centre_rotations, rig.skeleton.offsets
    assert find_mirror(names, parents, rig.parts, centres, bones) == family.mirror
    left = next(number for number, name in enumerate(names) if other_side(name) != name.lower())
    longer = bones.copy()
    longer[left] *= 1.6
    assert find_mirror(names, parents, rig.parts, centres, longer) == ()
    bent = centres.copy()
    bent[left] = bent[left] @ from_quaternions(np.array([0.8, 0.6, 0.0, 0.0]))
    assert find_mirror(names, parents, rig.parts, bent, bones) == ()
    renamed = [*names[:left], "Left nobody", *names[left + 1 :]]
    assert find_mirror(renamed, parents, rig.parts, centres, bones) == ()
    none = replace(family, mirror=())
    assert image_of((goal.path,), goal.nodes, rig, none) is None
    assert Family.from_record(family.to_record()).mirror == family.mirror
    record = family.to_record()
    del record["mirror"]  # of an archive that is older
    assert Family.from_record(record).mirror == ()
    assert clip.frames


def test_a_path_that_would_be_another_joints_has_no_image() -> None:
    _, rig, family, goal = take()
    left = next(j for j, (other, _) in enumerate(family.mirror) if other != j)
    assert mirrored((goal.path,), goal.nodes, rig, family, goal.still, (left,)) is None


NAMES = {
    "LeftHand": "righthand",
    "Character1:Hand_L": "character1:hand_r",
    "lfemur": "rfemur",
    "rFoot": "lfoot",
    "LHipJoint": "rhipjoint",
    "Bip01 R Calf": "bip01 l calf",
    "Spine_Mid": "spine_mid",
    "Chest": "chest",
    "lowerback": "lowerback",
}


@pytest.mark.parametrize("name", NAMES)
def test_names_of_the_other_side(name: str) -> None:
    assert other_side(name) == NAMES[name]
    assert other_side(other_side(name)) == name.lower()
