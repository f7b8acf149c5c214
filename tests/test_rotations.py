"""Rotations against SciPy's, and at the places where formulas break: 0, half a turn, gimbal."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from motifold.codec.clip import FloatArray
from motifold.codec.geometry.rotations import (
    about_axis,
    from_axis_angle,
    from_euler,
    from_quaternions,
    to_axis_angle,
    to_euler,
    to_quaternions,
)

ORDERS = [a + b + c for a, b, c in product("XYZ", repeat=3) if a != b != c]
PARTIAL = ["X", "Y", "Z", *(a + b for a, b in permutations("XYZ", 2))]
LENGTHS = [0.0, 1e-320, 1e-160, 1e-12, 1e-7, 9.99e-7, 1e-6, 1.01e-6, 1e-3, 9e-3, 1.0, 3.0]
LENGTHS += [np.pi - 1e-3, np.pi - 1e-7, np.pi - 1e-12, np.pi]


def directions(seed: int, count: int = 40) -> FloatArray:
    """Unit vectors: random ones, the axes, and nearly the axes."""
    rng = np.random.default_rng(seed)
    near = np.eye(3) + 1e-9 * rng.normal(size=(3, 3))
    out = np.concatenate([rng.normal(size=(count, 3)), np.eye(3), -np.eye(3), near])
    return np.asarray(out / np.linalg.norm(out, axis=1, keepdims=True))


def test_there_are_twelve_euler_orders() -> None:
    assert len(ORDERS) == 12


@pytest.mark.parametrize("length", [*LENGTHS, 4.0, 6.0, 20.0])
def test_exponential_is_scipys(length: float) -> None:
    vectors = directions(0) * length
    ours = from_axis_angle(vectors)
    assert np.abs(ours - Rotation.from_rotvec(vectors).as_matrix()).max() < 4e-15 * max(1, length)


@pytest.mark.parametrize("length", LENGTHS)
def test_logarithm_inverts_the_exponential(length: float) -> None:
    vectors = directions(1) * length
    back = to_axis_angle(from_axis_angle(vectors))
    assert (np.linalg.norm(back, axis=1) <= np.pi * (1 + 1e-15)).all()
    wrong = np.linalg.norm(back - vectors, axis=1)
    if length > np.pi - 1e-6:  # half a turn is its own opposite
        wrong = np.minimum(wrong, np.linalg.norm(back + vectors, axis=1) + np.pi - length)
    assert wrong.max() < 1e-14 + 1e-9 * (length == np.pi)


@given(st.integers(0, 2**32 - 1))
def test_quaternions_are_scipys(seed: int) -> None:
    turns = Rotation.random(20, random_state=seed)
    ours = to_quaternions(turns.as_matrix())
    theirs = np.roll(turns.as_quat(canonical=True), 1, axis=1)
    assert (ours[:, 0] >= 0).all()
    assert np.abs(np.linalg.norm(ours, axis=1) - 1).max() < 1e-15
    off = np.minimum(np.abs(ours - theirs).max(axis=1), np.abs(ours + theirs).max(axis=1))
    assert off.max() < 1e-14
    stretched = ours * np.random.default_rng(seed).uniform(0.01, 100, (20, 1))
    assert np.abs(from_quaternions(stretched) - turns.as_matrix()).max() < 1e-14


def test_half_turns_about_every_direction_have_quaternions() -> None:
    axes = directions(2, 200)
    quaternions = to_quaternions(2 * axes[:, :, None] * axes[:, None] - np.eye(3))
    assert np.abs(quaternions[:, 0]).max() < 1e-15
    assert np.abs(np.abs((quaternions[:, 1:] * axes).sum(axis=1)) - 1).max() < 1e-15


@pytest.mark.parametrize("axis", range(3))
def test_a_turn_about_an_axis_is_the_exponential_of_it(axis: int) -> None:
    angles = np.linspace(-7, 7, 50).reshape(5, 10)
    vectors = angles[..., None] * np.eye(3)[axis]
    assert np.abs(about_axis(axis, angles) - from_axis_angle(vectors)).max() < 1e-14


@pytest.mark.parametrize("order", ORDERS)
@given(seed=st.integers(0, 2**32 - 1))
def test_euler_angles_are_scipys(order: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-np.pi, np.pi, (4, 5, 3))
    theirs = Rotation.from_euler(order, angles.reshape(-1, 3)).as_matrix().reshape(4, 5, 3, 3)
    assert np.abs(from_euler(order, angles) - theirs).max() < 1e-14
    back = to_euler(order, theirs)
    assert np.abs(from_euler(order, back) - theirs).max() < 1e-10
    middle = back[..., 1]
    if order[0] == order[2]:
        assert ((middle >= 0) & (middle <= np.pi)).all()
    else:
        assert (np.abs(middle) <= np.pi / 2).all()


@pytest.mark.parametrize("order", ORDERS)
def test_euler_angles_at_gimbal_lock(order: str) -> None:
    locks = (0.0, np.pi) if order[0] == order[2] else (-np.pi / 2, np.pi / 2)
    free = np.linspace(-3, 3, 13)
    first, lock, last = np.meshgrid(free, locks, free, indexing="ij")
    matrices = from_euler(order, np.stack([first, lock, last], axis=-1))
    back = to_euler(order, matrices)
    assert (back[..., 2] == 0).all()
    assert np.abs(from_euler(order, back) - matrices).max() < 1e-14
    for away in (1e-12, 1e-9, 1e-8, 1e-7, 1e-5):
        near = matrices @ from_axis_angle(np.full(3, away))
        assert np.abs(from_euler(order, to_euler(order, near)) - near).max() < 2e-8


@pytest.mark.parametrize("order", PARTIAL)
def test_partial_orders_come_back_as_they_were(order: str) -> None:
    angles = np.random.default_rng(3).uniform(-3.1, 3.1, (100, len(order)))
    matrices = Rotation.from_euler(order, angles).as_matrix()
    assert np.abs(to_euler(order, matrices) - angles).max() < 1e-13


@pytest.mark.parametrize("order", PARTIAL)
def test_partial_orders_are_the_best_fit(order: str) -> None:
    grid = np.linspace(-np.pi, np.pi, 181)
    angles = np.stack(np.meshgrid(*[grid] * len(order), indexing="ij"), axis=-1)
    tries = from_euler(order, angles).reshape(-1, 9)
    matrices = Rotation.random(30, random_state=4).as_matrix()
    # the trace of AᵀB says how near two rotations are
    best = (matrices.reshape(-1, 9) @ tries.T).max(axis=1)
    ours = np.einsum("nij,nij->n", from_euler(order, to_euler(order, matrices)), matrices)
    assert (ours >= best - 1e-12).all()


def test_no_axes_are_no_turn() -> None:
    assert to_euler("", np.eye(3)[None]).shape == (1, 0)
    assert (from_euler("", np.zeros((4, 0))) == np.eye(3)).all()
