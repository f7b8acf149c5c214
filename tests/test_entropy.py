"""The symbol stream: what goes in comes out, and the tables are the same on every machine."""

from __future__ import annotations

import contextlib
import hashlib
import struct
from collections.abc import Callable
from fractions import Fraction
from math import isqrt

import numpy as np
import pytest
from exact_doubles import geometric_counts, root, to_double
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.clip import IntArray
from motifold.codec.errors import DamagedError, GuaranteeError
from motifold.codec.streams.entropy import (
    CLASS_FLOORS,
    CLASS_SHIFTS,
    CLASSES,
    ESCAPE_LIMIT,
    SymbolReader,
    SymbolWriter,
    class_probabilities,
    least_bits,
)
from motifold.codec.streams.sizeclasses import CLASSES as SIZES
from motifold.codec.streams.sizeclasses import (
    ESCAPE,
    class_counts,
    class_floors,
    class_models,
    class_shift,
)

# blake2b of all 48 tables as little-endian doubles, from `exact_probabilities` below
TABLES = "7692c24735adee4c2aa39527fdb795e8"
WIDE = st.integers(-(2**46), 2**46)


def exact_probabilities(index: int) -> list[Fraction]:
    """The format's tables, every step in exact arithmetic and then rounded to a double."""
    floor = 0 if index == 0 else isqrt(36 << index)
    if index == 0:
        mean = to_double(Fraction(16, 1000))
    else:
        mean = root(to_double(floor * floor * root(Fraction(2)))) / 256
    scaled = mean / (1 << max(0, int(mean / 4).bit_length() - 1))
    counts = geometric_counts(scaled)
    return [to_double(Fraction(count, sum(counts))) for count in counts]


@pytest.mark.parametrize("index", range(CLASSES))
def test_probabilities_are_those_of_exact_arithmetic(index: int) -> None:
    ours = class_probabilities(index)
    assert [Fraction(value) for value in ours] == exact_probabilities(index)
    assert len(ours) == 2 * ESCAPE_LIMIT + 2
    assert all(value > 0 for value in ours)
    total = sum((Fraction(value) for value in ours), Fraction(0))
    assert abs(total - 1) < Fraction(1, 2**48)
    assert list(ours[:-1]) == list(ours[-2::-1])  # + and - alike
    assert list(ours[60:121]) == sorted(ours[60:121], reverse=True)


def test_the_tables_are_pinned() -> None:
    bits = b"".join(struct.pack("<122d", *class_probabilities(index)) for index in range(CLASSES))
    assert hashlib.blake2b(bits, digest_size=16).hexdigest() == TABLES


def test_classes_are_a_ladder_of_half_octaves() -> None:
    assert CLASS_FLOORS[0] == 0
    ratios = CLASS_FLOORS[2:] / CLASS_FLOORS[1:-1]
    assert np.abs(ratios / np.sqrt(2) - 1).max() < 0.1
    assert (np.diff(CLASS_SHIFTS) >= 0).all()


@pytest.mark.parametrize("index", range(CLASSES))
def test_a_class_costs_what_its_table_says(index: int) -> None:
    rng = np.random.default_rng(index)
    probabilities = np.array(class_probabilities(index))
    high = rng.choice(121, 4000, p=probabilities[:-1] / probabilities[:-1].sum())
    shift = int(CLASS_SHIFTS[index])
    values = ((high - 60) << shift) + rng.integers(0, 1 << shift, 4000)
    writer = SymbolWriter()
    writer.differences(values, index)
    bits = -np.log2(probabilities[high]).sum() + 4000 * shift
    assert abs(8 * len(writer.to_bytes()) - bits) < 0.001 * bits + 10
    assert least_bits(index) == -np.log2(probabilities.max())


@given(
    st.lists(st.tuples(st.integers(0, CLASSES - 1), st.lists(WIDE, max_size=20)), max_size=6),
)
@settings(max_examples=80, deadline=None)
def test_differences_come_back(blocks: list[tuple[int, list[int]]]) -> None:
    writer = SymbolWriter()
    for index, values in blocks:
        writer.differences(np.array(values, np.int64), index)
    reader = SymbolReader(writer.to_bytes())
    for index, values in blocks:
        assert reader.differences(len(values), index).tolist() == values


@given(st.lists(st.tuples(st.integers(1, 2**48), st.floats(0, 1)), max_size=20))
@settings(max_examples=80, deadline=None)
def test_uniform_numbers_come_back(draws: list[tuple[int, float]]) -> None:
    pairs = [(size, min(int(share * size), size - 1)) for size, share in draws]
    writer = SymbolWriter()
    for size, value in pairs:
        writer.uniform([value], size)
    reader = SymbolReader(writer.to_bytes())
    assert [int(reader.uniform(1, size)[0]) for size, _ in pairs] == [value for _, value in pairs]


@given(st.lists(st.integers(0, 2**48 - 2), max_size=30))
def test_whole_numbers_come_back(numbers: list[int]) -> None:
    writer = SymbolWriter()
    for number in numbers:
        writer.number(number)
    reader = SymbolReader(writer.to_bytes())
    assert [reader.number() for _ in numbers] == numbers


def test_the_order_of_kinds_does_not_matter() -> None:
    """A stream of everything at once, long enough to cross many words."""
    rng = np.random.default_rng(1)
    plan: list[tuple[str, int, IntArray]] = []
    writer = SymbolWriter()
    for _ in range(300):
        kind = str(rng.choice(["uniform", "number", "differences"]))
        argument = (
            int(rng.integers(1, 48)) if kind == "differences" else int(rng.integers(1, 10**6))
        )
        size = 1 if kind == "number" else int(rng.integers(0, 30))
        values = rng.integers(0, argument, size)
        plan.append((kind, argument, values))
        if kind == "uniform":
            writer.uniform(values, argument)
        elif kind == "number":
            writer.number(int(values[0]))
        else:
            writer.differences(values, argument)
    reader = SymbolReader(writer.to_bytes())
    for kind, argument, values in plan:
        if kind == "uniform":
            assert reader.uniform(len(values), argument).tolist() == values.tolist()
        elif kind == "number":
            assert reader.number() == values[0]
        else:
            assert reader.differences(len(values), argument).tolist() == values.tolist()


@given(st.lists(st.sampled_from([0, 1, 2**16 - 2, 2**16 - 1, 2**15]), max_size=400))
@settings(max_examples=200, deadline=None)
def test_a_stream_takes_a_byte_more_than_its_symbols_at_most(values: list[int]) -> None:
    """Extreme symbols, whose carries run through many words."""
    writer = SymbolWriter()
    writer.uniform(values, 2**16)
    data = writer.to_bytes()
    assert len(data) <= 2 * len(values) + 1
    assert SymbolReader(data).uniform(len(values), 2**16).tolist() == values
    assert SymbolReader(writer.to_words(), "<u4").uniform(len(values), 2**16).tolist() == values


def test_first_symbols_at_the_end_cost_no_bytes_and_come_back() -> None:
    """The reader's credit covers what a writer gets for nothing."""
    writer = SymbolWriter()
    writer.number(5)
    writer.uniform(np.zeros(1000, np.int64), 16)
    data = writer.to_bytes()
    assert len(data) <= 8
    reader = SymbolReader(data)
    assert reader.number() == 5
    assert (reader.uniform(1000, 16) == 0).all()


def test_an_empty_stream_is_no_bytes() -> None:
    assert SymbolWriter().to_bytes() == b""
    assert SymbolReader(b"").uniform(0, 10).tolist() == []


@pytest.mark.parametrize("value", [2**48 - 1, 2**60])
def test_numbers_that_do_not_fit_are_refused(value: int) -> None:
    with pytest.raises(GuaranteeError, match="larger tolerance"):
        SymbolWriter().number(value)


READS: dict[str, Callable[[SymbolReader], object]] = {
    "numbers": lambda reader: [reader.number() for _ in range(10**6)],
    "uniform": lambda reader: [reader.uniform(1, 24) for _ in range(10**6)],
    "many uniform": lambda reader: reader.uniform(10**12, 24),
    "differences": lambda reader: [reader.differences(100, 0) for _ in range(10**6)],
    "many differences": lambda reader: reader.differences(10**12, 5),
    "sized": lambda reader: [reader.sized(np.zeros(500, np.int64)) for _ in range(10**6)],
    "sized apart": lambda reader: [reader.sized(np.array([40])) for _ in range(10**6)],
}


@pytest.mark.parametrize("data", [b"", b"\0" * 40, b"\xff" * 40, b"motifold" * 5])
@pytest.mark.parametrize("read", READS)
def test_streams_end(data: bytes, read: str) -> None:
    """Whatever the bytes, they cannot be read for ever."""
    with pytest.raises(DamagedError, match=r"ends before|does not fit"):
        READS[read](SymbolReader(data))


def test_numbers_out_of_range_are_damage() -> None:
    writer = SymbolWriter()
    writer.uniform([99_999], 131_072)
    with pytest.raises(DamagedError, match="number 99999 of 70000"):
        SymbolReader(writer.to_bytes()).uniform(1, 70_000)


@given(st.binary(max_size=60), st.lists(st.integers(0, 2), min_size=1, max_size=30))
@settings(max_examples=150, deadline=None)
def test_any_bytes_are_numbers_or_damage(data: bytes, kinds: list[int]) -> None:
    reader = SymbolReader(data)
    with contextlib.suppress(DamagedError):
        for kind in kinds:
            if kind == 0:
                assert 0 <= reader.number() <= 2**48 - 2
            elif kind == 1:
                assert (reader.uniform(3, 1000) < 1000).all()
            else:
                assert len(reader.differences(8, kind * 15)) == 8


@st.composite
def sized_numbers(draw: st.DrawFn) -> tuple[int, int]:
    """A class and a number: near its size, anywhere, or as large as can be written."""
    index = draw(st.integers(0, SIZES - 1))
    most = min(2**46 << class_shift(index), 2**62)
    near = 200 << class_shift(index)
    return index, draw(
        st.one_of(
            st.integers(-near, near), st.integers(-most, most), st.sampled_from([0, most, -most])
        )
    )


@given(st.lists(sized_numbers(), max_size=40), st.integers(0, 40))
@settings(max_examples=150)
def test_sized_numbers_come_back(drawn: list[tuple[int, int]], cut: int) -> None:
    """In one call or two, with other kinds between them."""
    classes = np.array([index for index, _ in drawn], np.int64)
    values = np.array([value for _, value in drawn], np.int64)
    writer = SymbolWriter()
    writer.sized(values[:cut], classes[:cut])
    writer.number(cut)
    writer.sized(values[cut:], classes[cut:])
    reader = SymbolReader(writer.to_bytes())
    assert reader.sized(classes[:cut]).tolist() == values[:cut].tolist()
    assert reader.number() == cut
    assert reader.sized(classes[cut:]).tolist() == values[cut:].tolist()


def test_a_class_for_every_number_or_none_is_written() -> None:
    with pytest.raises(ValueError, match="zip"):
        SymbolWriter().sized(np.array([1, 2]), np.array([3]))


@pytest.mark.parametrize("index", range(SIZES))
def test_sized_numbers_cost_what_their_tables_say(index: int) -> None:
    rng = np.random.default_rng(index)
    counts = np.array(class_counts(index), np.float64)
    high = rng.choice(121, 1000, p=counts[:-1] / counts[:-1].sum())
    shift = class_shift(index)
    values = ((high - 60) << shift) + rng.integers(0, 1 << shift, 1000)
    writer = SymbolWriter()
    writer.sized(values, np.full(1000, index))
    bits = -np.log2(counts[high] / counts.sum()).sum() + 1000 * shift
    assert abs(8 * len(writer.to_bytes()) - bits) < 0.001 * bits + 10


@pytest.mark.parametrize("index", [0, 3, 20, 60, SIZES - 1])
def test_the_likeliest_numbers_are_not_overdrawn(index: int) -> None:
    """A reader charges nothing that a writer did not pay: zeros for ever, at the floor."""
    classes = np.full(50_000, index)
    writer = SymbolWriter()
    writer.sized(np.zeros_like(classes), classes)
    data = writer.to_bytes()
    assert 8 * len(data) >= 0.99 * 50_000 * class_floors()[index] - 64
    assert not SymbolReader(data).sized(classes).any()


@pytest.mark.parametrize("value", [2**47 + 100, -(2**47) - 100])
def test_sized_numbers_that_do_not_fit_are_refused(value: int) -> None:
    with pytest.raises(GuaranteeError, match="larger tolerance"):
        SymbolWriter().sized(np.array([value]), np.array([20]))


@pytest.mark.parametrize("number", [2**48 - 2, 2**48 - 3, 2**45])
def test_escapes_beyond_64_bits_are_damage(number: int) -> None:
    """A class with low bits shifts an escaped number further than an array can hold."""
    writer = SymbolWriter()
    writer._encoder.encode(ESCAPE, class_models()[SIZES - 1])
    writer.number(number)
    writer.uniform([0], 1 << class_shift(SIZES - 1))
    with pytest.raises(DamagedError):
        SymbolReader(writer.to_bytes()).sized(np.array([SIZES - 1]))


@given(
    st.binary(max_size=60),
    st.lists(st.integers(0, SIZES - 1), min_size=1, max_size=60),
)
@settings(max_examples=150)
def test_any_bytes_are_sized_numbers_or_damage(data: bytes, classes: list[int]) -> None:
    reader = SymbolReader(data)
    with contextlib.suppress(DamagedError):
        for _ in range(3):
            assert len(reader.sized(np.array(classes))) == len(classes)


@given(
    st.lists(sized_numbers(), min_size=30, max_size=60),
    st.floats(0.0, 0.9),
)
def test_truncated_streams_are_other_numbers_or_damage(
    drawn: list[tuple[int, int]], share: float
) -> None:
    """What was whole before the cut comes back; nothing but `DamagedError` is raised."""
    classes = np.array([index for index, _ in drawn], np.int64)
    values = np.array([value for _, value in drawn], np.int64)
    writer = SymbolWriter()
    writer.sized(values, classes)
    data = writer.to_bytes()
    with contextlib.suppress(DamagedError):
        read = SymbolReader(data[: int(share * len(data))]).sized(classes)
        assert len(read) == len(values)
