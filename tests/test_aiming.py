"""What the encoder aims at: the turn that makes up for the errors above it, and no other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from clips import Recipe, family_of, skeleton_clip
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize, minimize_scalar
from scipy.spatial.transform import Rotation

from motifold.codec.blocks.aiming import MENDED, aim
from motifold.codec.blocks.nodes import HINGE, JOINT, KIND, PLACE, TURN
from motifold.codec.clip import FloatArray, IntArray, SkeletonClip
from motifold.codec.figure.rig import rig_of
from motifold.codec.geometry.kinematics import SHELL_INERTIA
from motifold.codec.geometry.limits import uniform_limits
from motifold.codec.version2.motiongoal import Goal, goal_of

SPAN = 4


def goal_from(recipe: Recipe, hinged: tuple[int, ...] = ()) -> Goal:
    clip = skeleton_clip(recipe)
    return goal_with(clip, hinged)


def goal_with(clip: SkeletonClip, hinged: tuple[int, ...]) -> Goal:
    rig = rig_of(clip, ())
    family = replace(family_of(clip, rig), hinged=hinged)
    return goal_of(clip, rig, family, uniform_limits(clip, 1e-6))


def aimed(goal: Goal, state: IntArray, node: int) -> IntArray:
    out = np.zeros((SPAN, 4), np.int64)
    measure = goal.yardstick
    aim(
        state,
        goal.path,
        goal.nodes.table,
        node,
        1,
        measure.points,
        measure.shape,
        measure.offsets,
        measure.mends,
        out,
    )
    return out


def disturbed(goal: Goal, size: float, seed: int) -> IntArray:
    """Return the clip's state with every turn off by some ``size`` radians, places by as much."""
    rng = np.random.default_rng(seed)
    state = goal.path.copy()
    for node, row in enumerate(goal.nodes.table):
        if row[KIND] == PLACE:
            state[:, node, :3] += np.rint(rng.normal(size=3) * 10 * size * 2**20).astype(np.int64)
            continue
        off = rotation(state[:, node]) * Rotation.from_rotvec(rng.normal(size=3) * size)
        state[:, node] = np.rint(off.as_quat(scalar_first=True) * 2**30).astype(np.int64)
    return state


def rotation(turns: IntArray) -> Rotation:
    return Rotation.from_quat(turns / 2**30, scalar_first=True)


def cost_of(goal: Goal, state: IntArray, node: int, frame: int) -> Callable[[Rotation], float]:
    """Return what is wrong, cm², if a node turns so: of its shell, and of what hangs on it."""
    measure, joint = goal.yardstick, int(goal.nodes.table[node, JOINT])
    shape = measure.shape

    def placed(point: int) -> FloatArray:
        parent, _, place, absolute = shape[point].tolist()
        here = state[frame, place, :3] / 2**20 if place >= 0 else measure.offsets[point]
        if absolute or parent < 0:
            return np.asarray(here)
        above = rotation(state[frame, shape[parent, 1]])
        return np.asarray(placed(parent) + above.apply(here))

    spot = placed(joint)
    hanging = [
        point for point in range(1, len(shape)) if shape[point, 0] == joint and not shape[point, 3]
    ]
    true = Rotation.from_matrix(measure.world[frame, joint])

    def cost(turn: Rotation) -> float:
        total = SHELL_INERTIA * float((true.inv() * turn).magnitude() ** 2)
        for point in hanging:
            off = spot + turn.apply(measure.offsets[point]) - measure.points[frame, point]
            total += float(off @ off)
        return total

    return cost


@given(st.integers(0, 2**32 - 1), st.integers(2, 12), st.sampled_from(["tree", "chain", "star"]))
def test_without_errors_the_aim_is_the_goal(seed: int, joints: int, tree: str) -> None:
    goal = goal_from(Recipe(seed, joints=joints, frames=5, tree=tree))
    for node, row in enumerate(goal.nodes.table):
        found = aimed(goal, goal.path, node)
        # positions are read off turns of 2^-30 at up to a kilometre, over many bones
        tolerance = 8 if row[KIND] == PLACE else 2**30 * 1e-6
        assert np.abs(found - goal.path[1:5, node]).max() <= tolerance


@given(st.integers(0, 2**32 - 1), st.sampled_from(["tree", "chain", "star"]))
def test_a_turn_makes_up_for_most_of_the_errors_above_it(seed: int, tree: str) -> None:
    """SciPy finds the best turn; the aim goes nine tenths of the way there from the true one."""
    goal = goal_from(Recipe(seed, joints=6, frames=5, tree=tree))
    state = disturbed(goal, 0.003, seed)
    for node, row in enumerate(goal.nodes.table):
        if row[KIND] != TURN or node == goal.nodes.top:
            continue
        [turn, *_] = rotation(aimed(goal, state, node))
        true = rotation(goal.path[1, node])
        cost = cost_of(goal, state, node, 1)

        def turned(d: FloatArray, true: Rotation = true, cost: object = cost) -> float:
            return cost(true * Rotation.from_rotvec(d))  # type: ignore[operator, no-any-return]

        best = minimize(turned, np.zeros(3), method="BFGS", options={"gtol": 1e-9}).fun
        left = (1 - MENDED) ** 2 * (cost(true) - best)
        # to first order in an angle of about 0.003
        assert cost(turn) <= best + left + 0.02 * (cost(true) - best) + 1e-9


@given(st.integers(0, 2**32 - 1))
def test_a_hinge_makes_up_about_its_own_axis_only(seed: int) -> None:
    rng = np.random.default_rng(seed)
    recipe = Recipe(seed, joints=5, frames=5, tree="chain")
    clip = skeleton_clip(recipe)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    rest = Rotation.from_rotvec(rng.normal(size=3))
    bends = Rotation.from_rotvec(np.linspace(0.0, 0.5, 5)[:, None] * axis)
    clip.rotations[:, 3] = (rest * bends).as_matrix()
    goal = goal_with(clip, (3,))
    state = disturbed(goal, 0.003, seed)
    node = goal.nodes.of_joint[False, 3]
    guide = goal.nodes.of_joint[False, 2]
    assert goal.nodes.table[node, KIND] == HINGE
    found = aimed(goal, state, node)
    held = rotation(state[1:5, guide]).inv() * rotation(found)
    bent = ((rest * bends[0]).inv() * held).as_rotvec()
    assert np.abs(bent - (bent @ axis)[:, None] * axis).max() < 1e-5
    nominal = rotation(state[1:5, guide]) * rest * bends[1:]
    for i in range(SPAN):
        cost = cost_of(goal, state, node, 1 + i)

        def bend(angle: float, cost: object = cost, i: int = i) -> float:
            turn = nominal[i] * Rotation.from_rotvec(angle * axis)
            return cost(turn)  # type: ignore[operator, no-any-return]

        best = minimize_scalar(bend, bounds=(-0.2, 0.2), options={"xatol": 1e-7}).fun
        left = (1 - MENDED) ** 2 * (bend(0.0) - best)
        assert cost(rotation(found)[i]) <= best + left + 0.02 * bend(0.0)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_a_hinge_that_is_none_makes_up_about_every_axis(seed: int) -> None:
    clip = skeleton_clip(Recipe(seed, joints=5, frames=5, tree="chain"))
    bends = Rotation.from_rotvec(
        0.3 * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)[:1]])
    )
    clip.rotations[:, 3] = bends.as_matrix()
    goal = goal_with(clip, (3,))
    state = disturbed(goal, 0.003, seed)
    node, guide = goal.nodes.of_joint[False, 3], goal.nodes.of_joint[False, 2]
    assert goal.nodes.table[node, KIND] == HINGE
    nominal = rotation(state[1:5, guide]) * bends[1:]
    found = rotation(aimed(goal, state, node))
    for i in range(SPAN):
        cost = cost_of(goal, state, node, 1 + i)

        def turned(d: FloatArray, cost: object = cost, i: int = i) -> float:
            return cost(nominal[i] * Rotation.from_rotvec(d))  # type: ignore[operator, no-any-return]

        best = minimize(turned, np.zeros(3), method="BFGS", options={"gtol": 1e-9}).fun
        left = (1 - MENDED) ** 2 * (cost(nominal[i]) - best)
        assert cost(found[i]) <= best + left + 0.02 * (cost(nominal[i]) - best) + 1e-9


def test_a_hinge_that_does_not_bend_keeps_its_angle() -> None:
    clip = skeleton_clip(Recipe(3, joints=5, frames=5, tree="chain"))
    clip.rotations[:, 3] = clip.rotations[:1, 3]
    clip.rotations[2, 3] = clip.rotations[2, 3] @ Rotation.from_rotvec([1e-6, 0, 0]).as_matrix()
    goal = goal_with(clip, (3,))
    state = disturbed(goal, 0.003, 3)
    node, guide = goal.nodes.of_joint[False, 3], goal.nodes.of_joint[False, 2]
    assert goal.nodes.table[node, KIND] == HINGE
    nominal = rotation(state[1:5, guide]) * Rotation.from_matrix(clip.rotations[1:, 3])
    assert (nominal.inv() * rotation(aimed(goal, state, node))).magnitude().max() < 1e-7


@pytest.mark.parametrize("kind", ["turn", "hinge"])
def test_a_joint_that_is_far_off_is_not_thrown_about(kind: str) -> None:
    hinged = (3,) if kind == "hinge" else ()
    goal = goal_from(Recipe(5, joints=6, frames=5, tree="chain"), hinged)
    state = disturbed(goal, 0.5, 1)
    node = goal.nodes.of_joint[False, 3]
    guide = goal.nodes.of_joint[False, 2]
    nominal = rotation(goal.path[1:5, node])
    if kind == "hinge":
        held = rotation(goal.path[1:5, guide]).inv() * nominal
        nominal = rotation(state[1:5, guide]) * held
    turned = (nominal.inv() * rotation(aimed(goal, state, node))).magnitude()
    assert turned.max() <= 0.3 * MENDED + 1e-6
    assert turned.min() > 0.01
