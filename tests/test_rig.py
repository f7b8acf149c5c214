"""Rigs and families: records, keys, and what a family is founded on."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
from clips import Recipe, family_of, marker_bench, recipes, skeleton_bench
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from motifold.codec.figure.rig import Family, Rig, bone_means, found_family, rig_of
from motifold.codec.geometry.kinematics import levers


@given(recipes(most_frames=3), st.booleans())
@settings(max_examples=40, deadline=None)
def test_records_come_back_through_json(recipe: Recipe, markers: bool) -> None:
    bench = marker_bench(recipe.seed, recipe.joints, 3) if markers else skeleton_bench(recipe)
    rig, family = bench.rig, bench.codebook.family
    again = Rig.from_record(json.loads(json.dumps(rig.to_record())))
    assert again.key == rig.key
    assert again.family_key == rig.family_key == family.key
    assert again.layout == rig.layout
    assert again.parts == rig.parts
    assert np.array_equal(again.skeleton.offsets, rig.skeleton.offsets)
    assert np.array_equal(again.skeleton.end_offsets, rig.skeleton.end_offsets)
    kin = Family.from_record(json.loads(json.dumps(family.to_record())))
    assert np.array_equal(kin.centre_rotations, family.centre_rotations)
    assert np.array_equal(kin.turn_scale, family.turn_scale)
    assert np.array_equal(kin.shift_scale, family.shift_scale)
    assert (kin.key, kin.kind, kin.parts) == (family.key, family.kind, family.parts)
    assert kin.head_diagonal == family.head_diagonal


def test_keys_tell_rigs_apart_and_families_share_bone_lengths() -> None:
    rig = skeleton_bench(Recipe(4, joints=9)).rig
    skeleton = rig.skeleton
    longer = replace(rig, skeleton=replace(skeleton, offsets=skeleton.offsets * 1.01))
    renamed = replace(rig, skeleton=replace(skeleton, names=("other", *skeleton.names[1:])))
    slower = replace(rig, frame_time=rig.frame_time * 2)
    mended = replace(rig, layout=replace(rig.layout, details=(("header", "x"),)))
    split = replace(rig, parts=(replace(rig.parts[0], name="pelvis"), *rig.parts[1:]))
    others = (longer, renamed, slower, mended, split)
    assert len({other.key for other in (rig, *others)}) == 6
    shares = [other.family_key == rig.family_key for other in others]
    assert shares == [True, False, True, True, False]


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.5))
@settings(deadline=None)
def test_centres_are_the_chordal_means(seed: int, spread: float) -> None:
    """SciPy's mean of rotations, which maximises the same trace by another way."""
    rig = skeleton_bench(Recipe(seed, joints=3)).rig
    rng = np.random.default_rng(seed)
    centre = Rotation.random(3, random_state=seed)
    usual = np.zeros((3, 3, 3))
    expected = []
    for joint in range(3):
        turns = centre[joint] * Rotation.from_rotvec(rng.normal(size=(30, 3)) * spread)
        usual[joint] = turns.as_matrix().sum(axis=0)
        expected.append(turns.mean())
    family = found_family(rig, usual, rig.skeleton.offsets, np.zeros((3, 3, 3)), 20.0)
    for joint in range(3):
        singular = np.linalg.svd(usual[joint], compute_uv=False)
        if singular[1] < 1 and singular[2] < 1:  # no mean to speak of
            continue
        off = Rotation.from_matrix(family.centre_rotations[joint]).inv() * expected[joint]
        assert off.magnitude() < 2e-4 + 1e-6 * 30 / max(singular[1], 1e-9)


@given(st.lists(st.floats(-1, 1), min_size=3, max_size=3), st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_half_a_turn_is_stored_as_one_of_its_two_signs(axis: list[float], seed: int) -> None:
    """Whatever the last bits are: both signs say the same."""
    assume(np.linalg.norm(axis) > 0.1)
    rig = skeleton_bench(Recipe(1, joints=4)).rig
    turn = Rotation.from_rotvec(np.pi * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    rng = np.random.default_rng(seed)
    usual = np.array([turn + rng.uniform(-1e-15, 1e-15, (3, 3)) for _ in range(4)])
    family = found_family(rig, usual, rig.skeleton.offsets, np.zeros((4, 3, 3)), 20.0)
    for centre in family.centres:
        assert centre[np.flatnonzero(centre)[0]] > 0
    assert np.abs(np.diff(family.centres, axis=0)).max() <= 1  # rounded to whole numbers


def test_a_family_without_frames_stands_straight() -> None:
    rig = skeleton_bench(Recipe(1, joints=4)).rig
    family = found_family(rig, np.zeros((4, 3, 3)), rig.skeleton.offsets, np.zeros((4, 3, 3)), 20.0)
    assert np.array_equal(family.centre_rotations, np.tile(np.eye(3), (4, 1, 1)))


@given(recipes(most_frames=5))
@settings(max_examples=30, deadline=None)
def test_levers_are_those_of_the_mean_bones(recipe: Recipe) -> None:
    bench = skeleton_bench(replace(recipe, frames=5))
    clip, family = bench.clip, bench.codebook.family
    means = bone_means(clip)  # type: ignore[arg-type]
    assert (means[0] == 0).all()
    expected = np.clip(levers(replace(bench.rig.skeleton, offsets=means)), 3, 1000)
    assert np.abs(family.turn_scale - expected).max() <= 1 / 32 + 1e-9
    assert (family.turn_scale >= 3).all()
    assert (family.shift_scale >= 1).all()


def test_marker_families_measure_centimetres() -> None:
    bench = marker_bench(2, 7, 4)
    family = family_of(bench.clip, bench.rig)
    assert (family.turn_scale == 1).all()
    assert (family.shift_scale == 1).all()
    assert np.array_equal(family.centre_rotations, np.tile(np.eye(3), (7, 1, 1)))


def test_the_rig_of_markers_is_flat() -> None:
    bench = marker_bench(2, 7, 4)
    rig = rig_of(bench.clip, bench.rig.parts)
    assert rig.kind == "markers"
    assert (rig.skeleton.parents == -1).all()
