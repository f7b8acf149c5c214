from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.clip import Skeleton
from motifold.codec.errors import UsageError
from motifold.codec.formats.units import CENTIMETRES, estimate_unit, parse_units, stature


def person(scale: float = 1.0, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Skeleton:
    """A stick figure of about 170 cm whose bones all lie along x, as many rigs' do."""
    names = ("hips", "chest", "head", "hand_l", "hand_r", "foot_l", "foot_r")
    lengths = np.array([0.0, 45.0, 30.0, 75.0, 75.0, 90.0, 90.0]) * scale
    offsets = np.zeros((7, 3))
    offsets[:, 0] = lengths
    offsets[0] = np.array(at)
    ends = np.zeros((2, 3))
    ends[:, 0] = 22.0 * scale
    return Skeleton(names, np.array([-1, 0, 1, 1, 1, 0, 0]), offsets, np.array([5, 6]), ends)


@pytest.mark.parametrize(
    ("text", "centimetres"),
    [("m", 100), ("CM", 1), (" mm ", 0.1), ("inches", 2.54), ("Feet", 30.48), ("5.644cm", 5.644)],
)
def test_units_by_name(text: str, centimetres: float) -> None:
    assert parse_units(text)[1] == pytest.approx(centimetres)


@given(st.sampled_from(sorted(CENTIMETRES)), st.floats(0.001, 1000.0))
def test_a_multiple_is_named_so_that_it_reads_back(name: str, scale: float) -> None:
    given_name, centimetres = parse_units(f"{scale!r} {name}")
    assert parse_units(given_name)[1] == pytest.approx(centimetres, rel=1e-5)


@given(st.text(max_size=12))
def test_anything_else_is_a_usage_error(text: str) -> None:
    try:
        name, centimetres = parse_units(text)
    except UsageError as error:
        assert "Use one of m, cm" in str(error)  # noqa: PT017
    else:
        assert name.split()[-1] in CENTIMETRES
        assert centimetres > 0


@pytest.mark.parametrize("text", ["", "furlong", "0 cm", "-1 cm", "1.2.3 m", "nan m", "1e999 m"])
def test_no_unit(text: str) -> None:
    with pytest.raises(UsageError):
        parse_units(text)


@given(
    st.sampled_from([("cm", 1.0), ("m", 0.01), ("in", 1 / 2.54), ("mm", 10.0)]),
    st.floats(0.8, 1.25),
    st.tuples(*[st.floats(-1e6, 1e6)] * 3),
)
def test_a_person_is_recognised_in_any_unit_and_anywhere(
    unit: tuple[str, float], build: float, at: tuple[float, float, float]
) -> None:
    name, scale = unit
    found, centimetres, repair = estimate_unit(person(scale * build, at))
    assert found == name
    assert centimetres == CENTIMETRES[name]
    assert "estimated" in repair.what
    assert "--units" in repair.what


def test_the_cmu_librarys_unit_comes_last() -> None:
    found, centimetres, _ = estimate_unit(person(0.45 / 2.54))
    assert centimetres == pytest.approx(2.54 / 0.45)
    assert parse_units(found)[1] == pytest.approx(centimetres, rel=1e-5)


@pytest.mark.parametrize("scale", [0.0, 1e-6, 1e6])
def test_what_is_no_person_is_taken_as_centimetres_and_said(scale: float) -> None:
    name, centimetres, repair = estimate_unit(person(scale))
    assert (name, centimetres) == ("cm", 1.0)
    assert "assumed" in repair.what


@given(st.floats(0.001, 1000.0))
def test_stature_grows_with_the_skeleton(scale: float) -> None:
    assert stature(person(scale)) == pytest.approx(scale * stature(person()))


def test_stature_of_a_person_is_near_the_truth() -> None:
    assert 150 < stature(person()) < 190


def test_stature_of_a_chain_is_its_length() -> None:
    chain = Skeleton(("a", "b"), np.array([-1, 0]), np.array([[9.0, 9, 9], [3, 4, 0]]))
    assert stature(chain) == pytest.approx(5.0)
