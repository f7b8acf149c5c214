"""Quantities as people write and read them."""

from __future__ import annotations

import math
import re
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.errors import UsageError
from motifold.workflows.quantities import (
    parse_bound,
    parse_length,
    parse_span_bound,
    parse_weight,
    show_bytes,
    show_duration,
    show_length,
    show_ratio,
)

CENTIMETRES = {"um": 0.0001, "mm": 0.1, "cm": 1.0, "m": 100.0, "in": 2.54}


@given(
    st.floats(1e-6, 1e6),
    st.sampled_from(list(CENTIMETRES)),
    st.sampled_from(["", " ", "  "]),
    st.booleans(),
)
def test_a_number_and_a_unit_are_a_length(
    number: float, unit: str, space: str, upper: bool
) -> None:
    text = f"{space}{number}{space}{unit.upper() if upper else unit}{space}"
    assert parse_length(text) == pytest.approx(number * CENTIMETRES[unit], rel=1e-12)


@pytest.mark.parametrize(("text", "value"), [("1mm", 0.1), (".5 cm", 0.5), ("2e-1in", 0.508)])
def test_examples(text: str, value: float) -> None:
    assert parse_length(text) == pytest.approx(value)


def test_the_borders_of_what_can_be_kept_are_inside() -> None:
    assert parse_length("0.001mm") == 1e-4
    assert parse_length("10m") == 1000.0


@pytest.mark.parametrize(
    "text", ["", "1", "mm", "1 furlong", "-1mm", "1,5mm", "1mm2", "nanmm", "infcm", "1 m m", "٣mm"]
)
def test_what_is_no_length_is_told_with_an_example(text: str) -> None:
    with pytest.raises(UsageError, match=re.escape(f"{text!r} is not a length") + ".*such as 1mm"):
        parse_length(text)


NAMES = st.text(st.characters(codec="utf-8"), min_size=1, max_size=20).filter(str.strip)


@given(NAMES, st.floats(1e-6, 1e6), st.sampled_from(["", " "]))
def test_a_name_and_a_length_are_a_bound(name: str, number: float, space: str) -> None:
    """Whatever is in the name, signs of equality too."""
    found = parse_bound(f"{space}{name}{space}={space}{number}mm")
    assert found[0] == name.strip()
    assert found[1] == pytest.approx(number * 0.1)


@pytest.mark.parametrize(
    ("text", "bound"),
    [
        ("LeftFoot=0.2mm", ("LeftFoot", 0.02)),
        ("*Hand* = 1 cm", ("*Hand*", 1.0)),
        ("a=b=2m", ("a=b", 200.0)),
    ],
)
def test_bounds(text: str, bound: tuple[str, float]) -> None:
    found = parse_bound(text)
    assert found[0] == bound[0]
    assert found[1] == pytest.approx(bound[1])


@pytest.mark.parametrize("text", ["", "LeftFoot", "=1mm", "  =1mm", "LeftFoot 1mm"])
def test_what_is_no_bound_is_told_with_an_example(text: str) -> None:
    with pytest.raises(UsageError, match=re.escape(f"{text!r} is no bound") + ".*LeftFoot=0.2mm"):
        parse_bound(text)


@pytest.mark.parametrize("text", ["LeftFoot=", "LeftFoot=1", "LeftFoot=-1mm", "LeftFoot=1mm=x"])
def test_bounds_need_a_length(text: str) -> None:
    with pytest.raises(UsageError, match="is not a length"):
        parse_bound(text)


@given(NAMES, st.floats(1e-6, 1e6), st.sampled_from(["", " "]))
def test_a_name_and_a_number_are_a_weight(name: str, number: float, space: str) -> None:
    assert parse_weight(f"{space}{name}{space}={space}{number!r}") == (name.strip(), number)


@pytest.mark.parametrize(
    "text", ["", "5", "LeftFoot", "=5", " =5", *(f"LeftFoot={n}" for n in ("0", "-1", "inf", "x"))]
)
def test_what_is_no_weight_is_told_with_an_example(text: str) -> None:
    with pytest.raises(UsageError, match=re.escape(f"{text!r} is no weight") + ".*LeftFoot=5"):
        parse_weight(text)


SECONDS = st.decimals(0, 10**4, allow_nan=False, places=3)


@given(SECONDS, SECONDS, st.floats(1e-6, 1e6), st.sampled_from(["", " "]))
def test_two_times_and_a_length_are_a_bound(
    one: Decimal, other: Decimal, number: float, space: str
) -> None:
    start, stop = sorted([one, other])
    text = f"{start}{space}s{space}-{space}{stop}s{space}={space}{number}mm"
    found = parse_span_bound(text)
    assert found[:2] == (float(start), float(stop))
    assert found[2] == pytest.approx(number * 0.1)
    if start < stop:
        with pytest.raises(UsageError, match="no time span"):
            parse_span_bound(f"{stop}s-{start}s=1mm")


def test_a_time_span() -> None:
    assert parse_span_bound("2s-3.5s=2mm") == (2.0, 3.5, 0.2)
    assert parse_span_bound(".5s-.5s=1mm") == (0.5, 0.5, 0.1)


@pytest.mark.parametrize(
    "span", ["2-3", "2s", "2s-", "-2s", "2s-3", "3s-2s", "-1s-2s", "1m-2m", "1s-2s-3s", "٣s-4s"]
)
def test_what_is_no_time_span_is_told_with_an_example(span: str) -> None:
    with pytest.raises(
        UsageError, match=re.escape(f"{span!r} is no time span") + ".*2s-3.5s=0.2mm"
    ):
        parse_span_bound(f"{span}=1mm")


@pytest.mark.parametrize("text", ["", "2s-3s", "=1mm"])
def test_time_spans_need_a_length(text: str) -> None:
    with pytest.raises(UsageError, match="is no bound"):
        parse_span_bound(text)


@given(st.floats(1e-5, 1e5))
def test_lengths_are_shown_to_a_part_in_a_thousand(centimetres: float) -> None:
    shown = show_length(centimetres)
    assert parse_length(shown) == pytest.approx(centimetres, rel=1e-3)
    assert shown.endswith(" mm") == (centimetres < 10)


@given(st.integers(0, 10**17))
def test_sizes_are_shown_to_three_digits(count: int) -> None:
    shown = show_bytes(count)
    number, unit = shown.split()
    size = (
        float(number.replace(",", "")) * {"B": 1, "kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}[unit]
    )
    assert size == pytest.approx(count, rel=6e-3)
    assert "e" not in number
    assert float(number.replace(",", "")) < 1000 or unit == "TB"


@pytest.mark.parametrize(
    ("count", "shown"),
    [
        (0, "0 B"),
        (999, "999 B"),
        (1000, "1 kB"),
        (999_499, "999 kB"),
        (999_500, "1 MB"),
        (1_234_567, "1.23 MB"),
        (10**12, "1 TB"),
        (5 * 10**15, "5,000 TB"),
    ],
)
def test_sizes(count: int, shown: str) -> None:
    assert show_bytes(count) == shown


@given(st.floats(0, 1e9))
def test_durations_are_shown_to_three_digits(seconds: float) -> None:
    number, unit = show_duration(seconds).split()
    shown = float(number.replace(",", "")) * {"s": 1, "min": 60, "h": 3600}[unit]
    assert shown == pytest.approx(seconds, rel=6e-3, abs=1e-300)
    assert "e+" not in number


def test_a_ratio_of_nothing_is_not_infinite() -> None:
    assert show_ratio(300, 100) == "3.00"
    assert show_ratio(1, 3) == "0.33"
    assert show_ratio(300, 0) == "-"
    assert not math.isinf(float(show_ratio(10**15, 1)))
