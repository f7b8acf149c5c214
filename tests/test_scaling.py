"""Signals in centimetres: what a turn displaces, there and back in whole numbers."""

from __future__ import annotations

import numpy as np
import pytest
from clips import Recipe, skeleton_clip
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from motifold.codec.arithmetic.scaling import (
    FROM_ANGLES,
    FROM_TURNS,
    bounded,
    scale_columns,
    signal_of,
    to_angles,
    to_lengths,
)
from motifold.codec.clip import FloatArray, IntArray
from motifold.codec.figure.rig import bends_of, found_family, rig_of
from motifold.codec.geometry.kinematics import MADE_UP, SHELL_INERTIA, hanging_joints, inertia

UPPER = np.triu_indices(3)


@st.composite
def tensors(draw: st.DrawFn) -> FloatArray:
    """Inertia of a shell and up to four limbs of 0.1 mm to 10 m, cm²."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    out = SHELL_INERTIA * np.eye(3)
    for _ in range(draw(st.integers(0, 4))):
        arm = rng.normal(size=3)
        arm *= 10.0 ** rng.uniform(-2, 3) / np.linalg.norm(arm)
        out += rng.integers(1, 20) * ((arm**2).sum() * np.eye(3) - np.outer(arm, arm))
    return np.asarray(bounded(out[None])[0])


def columns(tensor: FloatArray) -> IntArray:
    whole = np.rint(tensor * 256).astype(np.int64)
    return np.array(scale_columns(whole[UPPER].tolist()), np.int64)


@given(tensors(), st.integers(0, 2**32 - 1), st.floats(-5.0, 0.4))
def test_a_signal_is_as_long_as_what_the_turn_displaces(
    tensor: FloatArray, seed: int, magnitude: float
) -> None:
    turn = np.random.default_rng(seed).normal(size=3)
    turn *= 10.0**magnitude / np.linalg.norm(turn)
    scale = columns(tensor)
    wanted = float(np.sqrt(turn @ tensor @ turn))
    for bits, shift in ((30, FROM_TURNS), (28, FROM_ANGLES)):
        x, y, z = np.rint(turn * (1 << bits)).astype(np.int64).tolist()
        found = float(np.linalg.norm(to_lengths(scale, x, y, z, shift))) / 2**20
        assert found == pytest.approx(wanted, rel=0.01, abs=4e-6)


@given(tensors(), st.integers(0, 2**32 - 1), st.floats(-5.0, 0.4))
def test_signals_turn_back_into_angles(tensor: FloatArray, seed: int, magnitude: float) -> None:
    turn = np.random.default_rng(seed).normal(size=3)
    turn *= 10.0**magnitude / np.linalg.norm(turn)
    scale = columns(tensor)
    largest = np.sqrt(np.linalg.eigvalsh(tensor)[-1])
    # what the encoder aims at comes back but for rounding
    signal = [round(value) for value in signal_of(scale, *turn)]
    back = np.array(to_angles(scale, *signal)) / 2**28
    assert np.abs(back - turn).max() < 4 / 2**28 + 2**-20 * 2.0
    # what features say of the same turn is nearly the same signal
    x, y, z = np.rint(turn * 2**30).astype(np.int64).tolist()
    near = np.array(to_lengths(scale, x, y, z, FROM_TURNS), np.float64) - np.array(signal)
    assert np.abs(near).max() / 2**20 < 2e-3 * largest * np.linalg.norm(turn) + 1e-5


@pytest.mark.parametrize("seed", range(5))
def test_inertia_is_the_summed_squared_displacement(seed: int) -> None:
    """SciPy turns the limbs; what hangs on a child is carried along with the child's origin."""
    skeleton = skeleton_clip(Recipe(seed, joints=12, frames=1)).skeleton
    hanging = hanging_joints(skeleton)
    rng = np.random.default_rng(seed)
    for joint, tensor in enumerate(inertia(skeleton)):
        turn = rng.normal(size=3) * 1e-6
        spin = Rotation.from_rotvec(turn).as_matrix() - np.eye(3)
        wanted = SHELL_INERTIA * (turn**2).sum()
        for child in skeleton.children()[joint]:
            wanted += hanging[child] ** MADE_UP * ((spin @ skeleton.offsets[child]) ** 2).sum()
        for carrier, offset in zip(skeleton.end_parents, skeleton.end_offsets, strict=True):
            wanted += ((spin @ offset) ** 2).sum() if carrier == joint else 0.0
        assert turn @ tensor @ turn == pytest.approx(wanted, rel=1e-4)


def test_hinges_count_for_what_they_hang_on() -> None:
    skeleton = skeleton_clip(Recipe(3, joints=6, frames=1, tree="chain")).skeleton
    free, held = inertia(skeleton), inertia(skeleton, {3})
    assert np.allclose(held[2], free[2] + np.trace(free[3]) / 3 * np.eye(3))
    assert np.array_equal(np.delete(held, 2, axis=0), np.delete(free, 2, axis=0))


def test_long_limbs_weigh_no_more_than_ten_metres() -> None:
    huge = SHELL_INERTIA * np.eye(3) + 1e9 * np.diag([1.0, 1.0, 0.0])
    [found] = bounded(huge[None])
    assert np.trace(found) == pytest.approx(1e6 + 3 * SHELL_INERTIA)
    assert found[2, 2] == SHELL_INERTIA


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_hinges_are_found_by_what_turns(seed: int, decimals: float) -> None:
    """Joint 1 bends about an axis of its own, 2 about all, 3 never: 1 and 3 are hinged."""
    rng = np.random.default_rng(seed)
    clip = skeleton_clip(Recipe(seed, joints=4, frames=40))
    angles = rng.normal(size=(40, 4, 3)).cumsum(axis=0) * 0.03
    axis = rng.normal(size=3)
    angles[:, 1] = angles[:, 1, :1] * axis / np.linalg.norm(axis)
    angles[:, 3] = rng.normal(size=3)
    grain = 10.0 ** (-4 - 3 * decimals)  # a file writes so many decimals
    angles = np.rint(angles / grain) * grain
    rotations = Rotation.from_rotvec(angles.reshape(-1, 3)).as_matrix().reshape(40, 4, 3, 3)
    rig = rig_of(clip, ())
    usual = np.zeros((4, 3, 3))
    family = found_family(rig, usual, clip.skeleton.offsets, bends_of(rotations), 20.0)
    assert family.hinged == (1, 3)
    nothing = found_family(rig, usual, clip.skeleton.offsets, np.zeros((4, 3, 3)), 20.0)
    assert nothing.hinged == ()
    back = type(family).from_record(family.to_record())
    assert back.hinged == family.hinged
    assert np.array_equal(back.inertia, family.inertia)
