"""The quantised signals: rounding once per joint, whatever chain it hangs on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clips import MOTIONS, Bench, Recipe, marker_bench, recipes, skeleton_bench
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from motifold.codec.clip import FloatArray, IntArray, MarkerClip, SkeletonClip
from motifold.codec.figure.sliding import can_slide
from motifold.codec.geometry.gaps import filled
from motifold.codec.geometry.kinematics import world_rotations
from motifold.codec.patterns.signals import (
    CUBE,
    Frame,
    choose_bases,
    dequantise_markers,
    dequantise_skeleton,
    marker_anchor,
    marker_signals,
    part_channels,
    pose_part,
    quantise_markers,
    quantise_skeleton,
    relative_rotations,
    turn_signals,
)

STEPS = st.sampled_from([1e-4, 0.01, 0.3])


def angles(first: FloatArray, second: FloatArray) -> FloatArray:
    """The angles between two stacks of rotations, radians, exact near 0."""
    turned = np.swapaxes(first, -1, -2) @ second
    flat = Rotation.from_matrix(turned.reshape(-1, 3, 3)).magnitude()
    return np.asarray(flat.reshape(first.shape[:-2]))


def framed(bench: Bench) -> tuple[SkeletonClip, FloatArray, Frame]:
    clip = bench.clip
    assert isinstance(clip, SkeletonClip)
    world = world_rotations(clip.skeleton, clip.rotations)
    frame = Frame(choose_bases(bench.codebook.family, world), tuple(can_slide(bench.rig)))
    return clip, world, frame


@given(recipes(most_frames=30), STEPS)
@settings(max_examples=60, deadline=None)
def test_every_joint_is_off_by_its_own_rounding_only(recipe: Recipe, step: float) -> None:
    """World orientations: half a step per channel, over the lever, however long the chain."""
    bench = skeleton_bench(recipe)
    clip, world, frame = framed(bench)
    family, offsets = bench.codebook.family, clip.skeleton.offsets
    integers, there, moved = quantise_skeleton(
        family, frame, offsets, world, clip.translations, step
    )
    back, shifts = dequantise_skeleton(family, frame, clip.skeleton, [*integers], step)
    assert np.array_equal(back, there)
    assert np.array_equal(shifts, moved)
    if clip.frames:
        # the exponential shrinks angles, so the cube's half diagonal bounds the turn
        limit = np.sqrt(3) / 2 * step / family.turn_scale * (1 + 1e-6) + 1e-7
        assert (angles(world, back) <= limit).all()
    sliding = list(frame.sliding)
    away = np.abs(shifts - clip.translations)[:, sliding]
    size = np.abs(clip.translations).max(initial=1.0)
    assert (away <= step / 2 / family.shift_scale[sliding, None] + 1e-12 * size).all()


@pytest.mark.parametrize("motion", MOTIONS)
def test_errors_do_not_add_up_along_a_chain(motion: str) -> None:
    """The last of 30 joints is no worse than the first, in a part each or all in one."""
    recipe = Recipe(5, joints=30, frames=60, motion=motion, tree="chain")
    bench = skeleton_bench(recipe)
    clip, world, frame = framed(bench)
    family = replace(bench.codebook.family, levers=np.full(30, 10 * 16))
    _, back, _ = quantise_skeleton(
        family, frame, clip.skeleton.offsets, world, clip.translations, 1.0
    )
    assert (angles(world, back).max(axis=0) <= np.sqrt(3) / 2 * 0.1 * (1 + 1e-6)).all()


@given(recipes(most_joints=8, most_frames=60), STEPS)
@settings(max_examples=60, deadline=None)
def test_integers_are_the_rounded_signals(recipe: Recipe, step: float) -> None:
    """Every channel is within half a step of the rotation vector from its base."""
    bench = skeleton_bench(recipe)
    clip, world, frame = framed(bench)
    family = bench.codebook.family
    integers, back, _ = quantise_skeleton(
        family, frame, clip.skeleton.offsets, world, clip.translations, step
    )
    for part, values in zip(family.parts, integers, strict=True):
        assert values.shape == (clip.frames, part_channels(part, frame))
        assert values.dtype == np.int64
        for position, joint in enumerate(part.joints):
            if not clip.frames:
                continue
            base = family.centre_rotations[joint] @ CUBE[frame.bases[:, joint]]
            above = np.eye(3) if part.parent < 0 else back[:, family.parts[part.parent].reference]
            own = Rotation.from_matrix(np.swapaxes(above @ base, -1, -2) @ world[:, joint])
            exact = own.as_rotvec() * family.turn_scale[joint] / step
            coded = values[:, 3 * position : 3 * position + 3]
            near = np.abs(coded - exact).max(axis=1) <= 0.5 + 1e-6 / step * family.turn_scale[joint]
            assert (near | (own.magnitude() > np.pi - 1e-6)).all()


@given(recipes(most_joints=6, most_frames=200))
@settings(max_examples=60, deadline=None)
def test_bases_keep_rotation_vectors_far_from_half_a_turn(recipe: Recipe) -> None:
    bench = skeleton_bench(replace(recipe, motion="spin"))
    clip, world, frame = framed(bench)
    family = bench.codebook.family
    for part in family.parts:
        columns = list(part.joints)
        bases = family.centre_rotations[columns] @ CUBE[frame.bases[:, columns]]
        if clip.frames:
            away = angles(bases, relative_rotations(family.parts, part, world))
            assert away.max() <= 2.6 + 1e-9


def test_a_spinning_root_changes_its_base_now_and_then_and_no_more() -> None:
    turns = np.arange(400) * 0.1  # six turns and more
    world = Rotation.from_euler("Y", turns[:, None]).as_matrix()[:, None]
    bench = skeleton_bench(Recipe(1, joints=1, frames=1))
    family = replace(bench.codebook.family, centres=np.array([[32767, 0, 0, 0]]))
    bases = choose_bases(family, world)
    changes = int((np.diff(bases[:, 0]) != 0).sum())
    assert 400 * 0.1 / (2 * 2.6) - 1 <= changes <= 400 * 0.1 / (2.6 - np.pi / 4)


def test_the_cube_has_24_rotations_with_the_identity_first() -> None:
    assert np.array_equal(CUBE[0], np.eye(3))
    assert len({tuple(matrix.ravel()) for matrix in CUBE}) == 24
    group = {tuple(matrix.ravel()) for matrix in Rotation.create_group("O").as_matrix().round() + 0}
    assert {tuple(matrix.ravel() + 0) for matrix in CUBE} == group


@given(recipes(most_joints=10, most_frames=60))
@settings(max_examples=40, deadline=None)
def test_turn_signals_pose_their_part_again(recipe: Recipe) -> None:
    bench = skeleton_bench(recipe)
    _, world, _ = framed(bench)
    family = bench.codebook.family
    back = world.copy()
    for part in family.parts:
        signal = turn_signals(family, part, world)
        assert signal.shape == (recipe.frames, 3 * len(part.joints))
        back[:, part.joints] = np.eye(3)
        pose_part(family, part, signal, back)
    assert np.abs(back - world).max(initial=0.0) < 1e-9


def test_signals_go_on_beyond_half_a_turn() -> None:
    world = Rotation.from_euler("Y", np.arange(0, 5.5, 0.1)[:, None]).as_matrix()[:, None]
    bench = skeleton_bench(Recipe(1, joints=1, frames=1))
    family = replace(bench.codebook.family, centres=np.array([[32767, 0, 0, 0]]))
    signal = turn_signals(family, family.parts[0], world)
    assert np.allclose(signal[:, 1], np.arange(0, 5.5, 0.1) * family.turn_scale[0], atol=1e-9)


@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.integers(0, 30), STEPS)
@settings(max_examples=60, deadline=None)
def test_markers_are_rounded_to_the_grid_exactly(
    seed: int, markers: int, frames: int, step: float
) -> None:
    bench = marker_bench(seed, markers, frames)
    assert isinstance(bench.clip, MarkerClip)
    family, positions = bench.codebook.family, filled(bench.clip.positions)
    integers = quantise_markers(family, positions, step)
    back = dequantise_markers(family, [*integers], markers, step)
    assert back.shape == positions.shape
    assert np.array_equal(back, np.rint(positions / step) * step)
    assert (np.abs(back - positions) <= step / 2 * (1 + 1e-9)).all()
    # and what is coded is relative: moving all markers leaves all parts but the root's alone
    whole = np.array([7, -3, 11])
    moved = quantise_markers(family, back + whole * step, step)
    assert all(np.array_equal(a, b) for a, b in zip(integers[1:], moved[1:], strict=True))


def test_markers_of_skipped_parts_are_nan() -> None:
    bench = marker_bench(3, 12, 5)
    family = bench.codebook.family
    assert len(family.parts) > 1
    assert isinstance(bench.clip, MarkerClip)
    integers: list[IntArray | None] = [*quantise_markers(family, filled(bench.clip.positions), 0.1)]
    leaf = len(family.parts) - 1
    integers[leaf] = None
    back = dequantise_markers(family, integers, 12, 0.1)
    gone = np.isin(np.arange(12), family.parts[leaf].joints)
    assert np.isnan(back[:, gone]).all()
    assert not np.isnan(back[:, ~gone]).any()


def test_marker_signals_are_relative_to_the_anchor() -> None:
    bench = marker_bench(4, 10, 6, gaps=0.0)
    family = bench.codebook.family
    assert isinstance(bench.clip, MarkerClip)
    for part in family.parts:
        signal = marker_signals(family, part, bench.clip.positions).reshape(6, -1, 3)
        anchor = bench.clip.positions[:, [marker_anchor(family, part)]]
        assert np.allclose(signal + anchor, bench.clip.positions[:, part.joints])
