"""Whole-number rotations: near the real ones, and never beyond what 64 bits hold."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from plain import Watched, plain_functions
from scipy.spatial.transform import Rotation

from motifold.codec.arithmetic import fixedpoint
from motifold.codec.arithmetic.fixedpoint import (
    ANGLE_BITS,
    LARGEST_ANGLE,
    LOG_BITS,
    ONE,
    TURN_BITS,
    Turn,
    between,
    log2_of,
    product,
    rotated,
    to_turns,
    turn_of,
    unit,
    vector_of,
)
from motifold.codec.arithmetic.quaternionlog import vector_to
from motifold.codec.clip import FloatArray

PLAIN = plain_functions(fixedpoint)
LIMIT = 1 << 45  # of the components that `rotated` takes
UNIT = st.floats(-1.0, 1.0)


def turn_from(w: float, x: float, y: float, z: float) -> Turn:
    """The whole-number turn of a quaternion of any length, as the encoder makes it."""
    quaternion = np.array([w, x, y, z])
    whole = to_turns(quaternion / np.linalg.norm(quaternion)).tolist()
    return whole[0], whole[1], whole[2], whole[3]


def long_enough(parts: tuple[float, ...]) -> bool:
    return math.hypot(*parts) > 1e-3


QUATERNIONS = st.tuples(UNIT, UNIT, UNIT, UNIT).filter(long_enough)
EDGES = st.sampled_from(
    [(1.0, 0.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0), (0.5, 0.5, -0.5, 0.5)]
)
TURNS = st.one_of(QUATERNIONS, EDGES).map(lambda parts: turn_from(*parts))
ANGLES = st.tuples(*[st.integers(-LARGEST_ANGLE, LARGEST_ANGLE)] * 3)
VECTORS = st.tuples(*[st.one_of(st.integers(-LIMIT, LIMIT), st.sampled_from([-LIMIT, LIMIT]))] * 3)


def rotation(turn: Turn) -> Rotation:
    return Rotation.from_quat([turn[1], turn[2], turn[3], turn[0]])


def off(turn: Turn, expected: Rotation) -> float:
    """The angle between a turn and a rotation, radians."""
    return float((rotation(turn).inv() * expected).magnitude())


def length(turn: Turn) -> float:
    return math.sqrt(sum(part * part for part in turn)) / ONE


@given(TURNS, TURNS)
def test_products_are_rotations_one_after_the_other(a: Turn, b: Turn) -> None:
    assert off(product(a, b), rotation(a) * rotation(b)) < 1e-8
    assert off(between(a, b), rotation(a).inv() * rotation(b)) < 1e-8


@given(TURNS, st.floats(-1e-3, 1e-3))
def test_unit_brings_a_turn_nearer_to_length_1(turn: Turn, stretch: float) -> None:
    stretched = tuple(round(part * (1.0 + stretch)) for part in turn)
    made = unit((stretched[0], stretched[1], stretched[2], stretched[3]))
    assert abs(length(made) - 1.0) < 1.6 * stretch**2 + 4e-9  # Newton's step squares the error
    assert off(made, rotation(turn)) < 1e-8


@given(ANGLES)
def test_turns_of_rotation_vectors_up_to_half_a_turn(vector: tuple[int, int, int]) -> None:
    angles = np.array(vector) / float(1 << ANGLE_BITS)
    assume(np.linalg.norm(angles) <= math.pi)
    turn = turn_of(*vector)
    expected = Rotation.from_rotvec(angles).as_quat(scalar_first=True)
    assert np.abs(np.array(turn) / ONE - expected * math.copysign(1.0, expected[0])).max() < 2**-26


@given(ANGLES)
def test_turns_of_larger_vectors_are_turns(vector: tuple[int, int, int]) -> None:
    assert abs(length(turn_of(*vector)) - 1.0) < 2**-24


@given(st.tuples(*[st.integers(-(2**62), 2**62)] * 3))
def test_rotation_vectors_are_clamped(vector: tuple[int, int, int]) -> None:
    clamped = [min(max(part, -LARGEST_ANGLE), LARGEST_ANGLE) for part in vector]
    assert turn_of(*vector) == turn_of(*clamped)


@given(QUATERNIONS, st.floats(0.0, 3.1), st.booleans())
def test_vectors_of_turns_are_rotation_vectors(
    parts: tuple[float, float, float, float], angle: float, negative: bool
) -> None:
    axis = np.array(parts[1:])
    assume(np.linalg.norm(axis) > 1e-3)
    wanted = axis / np.linalg.norm(axis) * angle
    quaternion = Rotation.from_rotvec(wanted).as_quat(scalar_first=True)
    turn = turn_from(*(-quaternion if negative else quaternion).tolist())
    exact = np.array(vector_to(turn))
    assert np.abs(exact - wanted).max() < 2e-8
    found = np.array(vector_of(turn)) / float(1 << TURN_BITS)
    if angle <= 0.5:
        assert np.abs(found - wanted).max() < 1e-8
    elif angle <= math.pi / 2:
        assert np.abs(found - wanted).max() < 2e-4
    else:  # short of the true angle, along the true axis
        assert np.linalg.norm(np.cross(found, wanted)) < 1e-7
        assert math.pi / 2 - 2e-4 < np.linalg.norm(found) < angle + 1e-7


@given(TURNS, VECTORS)
def test_vectors_are_rotated(turn: Turn, vector: tuple[int, int, int]) -> None:
    found: FloatArray = np.array(rotated(turn, *vector), np.float64)
    expected = rotation(turn).apply(np.array(vector, np.float64))
    size = float(np.linalg.norm(np.array(vector, np.float64)))
    assert np.linalg.norm(found - expected) <= 3e-4 * size + 2.0  # 15 bits of a matrix, cut off


@given(TURNS, VECTORS)
def test_a_quaternion_and_its_negative_are_one_turn(
    turn: Turn, vector: tuple[int, int, int]
) -> None:
    other = (-turn[0], -turn[1], -turn[2], -turn[3])
    assert rotated(other, *vector) == rotated(turn, *vector)


@given(st.one_of(st.integers(1, 2**62), st.integers(1, 600)))
def test_logarithms(value: int) -> None:
    found = log2_of(value)
    # eight bits of the mantissa are looked at: what is cut off is at most log2(257/256)
    assert -1.95 <= found - math.log2(value) * (1 << LOG_BITS) <= 0.51
    assert log2_of(value + 1) >= found


@pytest.mark.parametrize("octave", range(62))
def test_logarithms_of_powers_of_two_are_exact(octave: int) -> None:
    assert log2_of(1 << octave) == octave << LOG_BITS


def test_no_mathematical_library_rounds_the_log_table_another_way() -> None:
    exact = np.log2(1 + np.arange(256) / 256) * (1 << LOG_BITS)
    margin = np.abs(exact - np.floor(exact) - 0.5).min()
    assert margin > 1e-6  # a library whose last 20 bits are wrong would do


CALLS: dict[str, st.SearchStrategy[tuple[Any, ...]]] = {
    "product": st.tuples(TURNS, TURNS),
    "between": st.tuples(TURNS, TURNS),
    "unit": st.tuples(TURNS),
    "turn_of": ANGLES,
    "vector_of": st.tuples(TURNS),
    "rotated": st.tuples(TURNS, VECTORS).map(lambda both: (both[0], *both[1])),
    "log2_of": st.tuples(st.integers(1, 2**62)),
}


def watched(value: Any) -> Any:
    return tuple(map(watched, value)) if isinstance(value, tuple) else Watched(value)


def test_every_compiled_function_is_compared_with_plain_python() -> None:
    assert set(CALLS) == set(PLAIN)


@pytest.mark.parametrize("name", CALLS)
@given(data=st.data())
def test_plain_python_gives_the_same_and_nothing_passes_62_bits(
    name: str, data: st.DataObject
) -> None:
    arguments = data.draw(CALLS[name])
    function: Callable[..., Any] = getattr(fixedpoint, name)
    if name == "log2_of":  # looks a number up in an array, which knows no `Watched`
        assert function(*arguments) == PLAIN[name](*arguments)
    else:
        assert function(*arguments) == PLAIN[name](*watched(arguments))
