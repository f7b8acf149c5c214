"""The order of coding: whatever a node is predicted from is decoded before it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from clips import MARKS, Marks, Recipe, family_of, marker_clip, random_parts, skeleton_clip
from hypothesis import given
from hypothesis import strategies as st
from joint_trees import BIPED, CMU_ASF, UNREAL, XSENS, skeleton

from motifold.codec.blocks.nodes import (
    AXES,
    CARRIER,
    FOLLOWER,
    GUIDE,
    HINGE,
    JOINT,
    KIND,
    LEVER,
    PLACE,
    ROW,
    TURN,
    Nodes,
    marker_nodes,
    skeleton_nodes,
)
from motifold.codec.clip import IntArray, Skeleton, SkeletonClip
from motifold.codec.figure.bodyparts import body_parts
from motifold.codec.figure.rig import Family, Rig, rig_of


@dataclass(frozen=True, eq=False)
class Case:
    """What `skeleton_nodes` takes."""

    rig: Rig
    family: Family
    still: frozenset[int]
    sliding: tuple[int, ...]

    @property
    def nodes(self) -> Nodes:
        return skeleton_nodes(self.rig, self.family, self.still, self.sliding)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Random trees of which some joints are still, and some slide."""
    recipe = Recipe(
        seed=draw(st.integers(0, 2**32 - 1)),
        joints=draw(st.integers(1, 24)),
        frames=0,
        tree=draw(st.sampled_from(["tree", "chain", "star"])),
    )
    clip = skeleton_clip(recipe)
    rig = rig_of(clip, random_parts(recipe.seed, recipe.joints))
    some = st.sets(st.integers(0, recipe.joints - 1))
    every = st.just(set(range(recipe.joints)))
    still = draw(st.one_of(some, every, st.just(set())))
    sliding = draw(st.one_of(some, st.just({0}), st.just(set()), every))
    family = replace(family_of(clip, rig), hinged=tuple(sorted(draw(some))))
    return Case(rig, family, frozenset(still), tuple(sorted(sliding)))


def levels_of(nodes: Nodes) -> IntArray:
    """The level of every node."""
    assert nodes.levels[0] == 0
    assert nodes.levels[-1] == nodes.count
    assert (np.diff(nodes.levels) > 0).all()
    return np.repeat(np.arange(len(nodes.levels) - 1), np.diff(nodes.levels))


def above(skeleton: Skeleton, joint: int) -> list[int]:
    """A joint's ancestors, the nearest first."""
    found = []
    while (joint := int(skeleton.parents[joint])) >= 0:
        found.append(joint)
    return found


@given(cases())
def test_what_a_node_is_predicted_from_is_in_lower_levels(case: Case) -> None:
    nodes = case.nodes
    level = levels_of(nodes)
    for node, row in enumerate(nodes.table.tolist()):
        if row[GUIDE] >= 0:
            assert level[row[GUIDE]] < level[node]
        if row[CARRIER] >= 0 and node != nodes.top:  # the top looks at its past only
            assert level[row[CARRIER]] < level[node]
        if row[AXES] >= 0:  # axes are those of the last frame: a turn may be its own
            assert row[AXES] == node or level[row[AXES]] < level[node]
            assert nodes.table[row[AXES], KIND] in (TURN, HINGE)


@given(cases())
def test_every_joint_has_one_turn_or_follower_and_those_that_slide_a_place(case: Case) -> None:
    nodes, joints = case.nodes, case.rig.skeleton.joints
    table = nodes.table
    turned = table[table[:, KIND] != PLACE]
    assert sorted(turned[:, JOINT].tolist()) == list(range(joints))
    assert set(turned[turned[:, KIND] == FOLLOWER][:, JOINT].tolist()) == case.still
    placed = table[table[:, KIND] == PLACE]
    assert tuple(sorted(placed[:, JOINT].tolist())) == case.sliding
    assert len(set(table[:, ROW].tolist())) == nodes.count
    assert turned[:, ROW].tolist() == turned[:, JOINT].tolist()
    assert (placed[:, ROW] == joints + placed[:, JOINT]).all()
    free = turned[(turned[:, KIND] == TURN) | (turned[:, KIND] == HINGE)]
    for row in free:  # a hinge needs something to hang on
        assert (row[KIND] == HINGE) == (row[JOINT] in case.family.hinged and row[GUIDE] >= 0)
    assert free[:, LEVER].tolist() == case.family.levers[free[:, JOINT]].tolist()
    held = turned[turned[:, KIND] == FOLLOWER]
    assert (held[:, LEVER] >= case.family.levers[held[:, JOINT]]).all()
    assert placed[:, LEVER].tolist() == case.family.shift_levers[placed[:, JOINT]].tolist()
    for (place, joint), node in nodes.of_joint.items():
        assert (table[node, KIND] == PLACE, table[node, JOINT]) == (place, joint)
    assert len(nodes.of_joint) == nodes.count


@given(cases())
def test_all_that_places_a_joint_comes_before_its_turn(case: Case) -> None:
    """What is above it has been decoded when the encoder aims a turn."""
    nodes, skeleton = case.nodes, case.rig.skeleton
    for node, row in enumerate(nodes.table.tolist()):
        if row[KIND] in (TURN, HINGE) and node != nodes.top:
            for joint in (row[JOINT], *above(skeleton, row[JOINT])):
                assert joint == row[JOINT] or nodes.of_joint[False, joint] < node
                assert nodes.of_joint.get((True, joint), -1) < node


@given(cases())
def test_guides_are_the_nearest_ancestors_that_move(case: Case) -> None:
    nodes, skeleton = case.nodes, case.rig.skeleton
    for node, row in enumerate(nodes.table.tolist()):
        joint, ancestors = row[JOINT], above(skeleton, row[JOINT])
        if row[KIND] == FOLLOWER:  # holds its angle to its parent, still or not
            wanted = ancestors[:1]
        elif row[KIND] in (TURN, HINGE):
            wanted = [other for other in ancestors if other not in case.still][:1]
        else:
            wanted = [int(nodes.table[nodes.top, JOINT])] if node == nodes.path else []
            wanted = wanted if nodes.top >= 0 else []
            assert row[AXES] == row[GUIDE]
        assert row[GUIDE] == (nodes.of_joint[False, wanted[0]] if wanted else -1), joint


@given(cases())
def test_the_root_is_the_first_turn_and_the_first_joint_that_slides(case: Case) -> None:
    nodes = case.nodes
    turning = [joint for joint in range(case.rig.skeleton.joints) if joint not in case.still]
    assert (nodes.top >= 0) == bool(turning)
    assert (nodes.path >= 0) == bool(case.sliding)
    if nodes.top >= 0:
        top = nodes.table[nodes.top]
        assert top[KIND] == TURN
        assert top[GUIDE] == -1
        assert (nodes.table[: nodes.top, KIND] == FOLLOWER).all()
        if case.sliding and case.sliding[0] == turning[0]:
            assert top[JOINT] == turning[0]
    if nodes.path >= 0:
        assert nodes.table[nodes.path, JOINT] == case.sliding[0]
        carried = nodes.table[nodes.table[:, KIND] == TURN, CARRIER]
        assert (carried == nodes.path).all()


@pytest.mark.parametrize("text", [CMU_ASF, BIPED, UNREAL, XSENS])
def test_a_real_tree_of_which_all_moves(text: str) -> None:
    tree = skeleton(text)
    nodes = tree_nodes(tree, frozenset(), (0,))
    assert nodes.top == 0
    assert nodes.table[nodes.path, KIND] == PLACE
    level = levels_of(nodes)
    for joint in range(1, tree.joints):
        assert level[nodes.of_joint[False, joint]] == 1 + len(above(tree, joint))


def tree_nodes(tree: Skeleton, still: frozenset[int], sliding: tuple[int, ...]) -> Nodes:
    clip: SkeletonClip = replace(
        skeleton_clip(Recipe(joints=tree.joints, frames=0)),
        skeleton=tree,
        translations=np.zeros((0, tree.joints, 3)),
    )
    rig = rig_of(clip, body_parts(tree))
    return skeleton_nodes(rig, family_of(clip, rig), still, sliding)


def test_a_bipeds_hips_carry_the_path_though_a_still_joint_is_above_them() -> None:
    tree = skeleton(BIPED)
    pelvis = tree.names.index("Bip01 Pelvis")
    nodes = tree_nodes(tree, frozenset({0}), (pelvis,))
    assert nodes.table[nodes.top, JOINT] == pelvis
    assert nodes.table[nodes.path, [JOINT, AXES]].tolist() == [pelvis, nodes.top]


@given(MARKS)
def test_markers_follow_markers_of_lower_levels(marks: Marks) -> None:
    clip = marker_clip(marks.seed, marks.markers, marks.frames, marks.gaps, marks.motion)
    rig = rig_of(clip, random_parts(marks.seed, marks.markers, first_at_root=False))
    nodes = marker_nodes(family_of(clip, rig))
    table, level = nodes.table, levels_of(nodes)
    assert (table[:, KIND] == PLACE).all()
    assert sorted(table[:, JOINT].tolist()) == list(range(marks.markers))
    assert (table[:, ROW] == marks.markers + table[:, JOINT]).all()
    assert (table[:, [CARRIER, AXES]] == -1).all()
    assert nodes.top == -1
    assert table[nodes.path, JOINT] == rig.parts[0].reference
    assert np.flatnonzero(table[:, GUIDE] < 0).tolist() == [nodes.path]
    references = {part.reference for part in rig.parts}
    for node in range(nodes.count):
        if node != nodes.path:
            assert level[table[node, GUIDE]] < level[node]
            assert table[table[node, GUIDE], JOINT] in references
