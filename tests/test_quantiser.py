"""Quantiser steps are exact binary fractions on a ladder, and the choice rounds down."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from motifold.codec.errors import DamagedError
from motifold.codec.streams.quantiser import CODES, code_below, step_of


def exact(code: int) -> Fraction:
    octave, rung = divmod(code, 128)
    return Fraction(128 + rung, 128) * Fraction(2) ** (octave - 40)


def test_every_step_is_exact() -> None:
    assert all(Fraction(step_of(code)) == exact(code) for code in range(CODES))


def test_steps_rise_by_less_than_one_percent() -> None:
    ratios = [exact(code + 1) / exact(code) for code in range(CODES - 1)]
    assert min(ratios) > 1
    assert max(ratios) <= Fraction(129, 128)


@given(st.floats(2.0**-40, 2.0**19))
@example(2.0**-40)
@example(1.0)
@example(math.nextafter(1.0, 0.0))
def test_the_code_is_the_largest_step_below(step: float) -> None:
    code = code_below(step)
    assert exact(code) <= Fraction(step) < exact(code + 1)


@given(st.integers(0, CODES - 1))
def test_a_step_is_its_own_code(code: int) -> None:
    assert code_below(step_of(code)) == code
    assert code_below(math.nextafter(step_of(code), 0.0)) == max(code - 1, 0)


@given(st.floats(0.0, 2.0**-40, exclude_max=True))
def test_smaller_steps_than_the_least_become_it(step: float) -> None:
    assert code_below(step) == 0


@given(st.floats(2.0**20, 1e300))
def test_larger_steps_than_the_largest_become_it(step: float) -> None:
    assert code_below(step) == CODES - 1


@pytest.mark.parametrize("code", [-1, CODES, 10**12])
def test_codes_off_the_ladder_are_damage(code: int) -> None:
    with pytest.raises(DamagedError, match="step code"):
        step_of(code)
