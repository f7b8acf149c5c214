from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from motifold.codec.patterns.timewarp import (
    denormalise,
    denormalise_batch,
    normalise,
    normalise_batch,
    smooth_borders,
)

VALUES = st.floats(-100, 100, width=32)
LENGTHS = st.integers(1, 40)


def signals(n: int) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float64, (n, 2), elements=VALUES)


@st.composite
def cut_signals(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    counts = draw(st.lists(st.integers(1, 25), min_size=1, max_size=6))
    return draw(signals(sum(counts))), np.concatenate([[0], np.cumsum(counts)])


def line(n: int, length: int) -> tuple[np.ndarray, np.ndarray]:
    """The same straight line sampled n and ``length`` times."""
    slope, start = np.array([[7.0, -2.5]]), np.array([[1.0, 30.0]])
    return tuple(start + np.linspace(0, 1, count)[:, None] * slope for count in (n, length))


@given(LENGTHS, LENGTHS, VALUES)
def test_constants_survive(n: int, length: int, value: float) -> None:
    segment = np.full((n, 3), value)
    pattern = normalise(segment, length)
    np.testing.assert_allclose(pattern, np.full((length, 3), value), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(denormalise(pattern, n), segment, rtol=1e-12, atol=1e-12)


@given(st.integers(2, 60), st.integers(2, 60))
def test_lines_survive(n: int, length: int) -> None:
    segment, expected = line(n, length)
    pattern = normalise(segment, length)
    np.testing.assert_allclose(pattern, expected, atol=1e-12)
    np.testing.assert_allclose(denormalise(pattern, n), segment, atol=1e-12)


@given(st.integers(2, 30).flatmap(signals), st.integers(2, 60))
def test_ends_are_kept(segment: np.ndarray, length: int) -> None:
    for changed in (normalise(segment, length), denormalise(segment, length)):
        np.testing.assert_array_equal(changed[0], segment[0])
        np.testing.assert_array_equal(changed[-1], segment[-1])


@given(st.integers(1, 30).flatmap(signals), st.integers(0, 30))
def test_stretching_is_linear_interpolation(segment: np.ndarray, more: int) -> None:
    length = len(segment) + more
    times = np.linspace(0, len(segment) - 1, length)
    oracle = np.stack([np.interp(times, np.arange(len(segment)), c) for c in segment.T], axis=1)
    np.testing.assert_allclose(normalise(segment, length), oracle, atol=1e-10)
    np.testing.assert_allclose(denormalise(segment, length), oracle, atol=1e-10)


def interpolant_mean(values: list[Fraction], low: Fraction, high: Fraction) -> Fraction:
    """The exact mean of the linear interpolant of ``values`` from time low to high."""
    knots = [low, *(Fraction(k) for k in range(len(values)) if low < k < high), high]

    def at(time: Fraction) -> Fraction:
        k = min(int(time), len(values) - 2)
        return values[k] + (values[k + 1] - values[k]) * (time - k)

    area = sum((at(a) + at(b)) / 2 * (b - a) for a, b in pairwise(knots))
    return Fraction(area) / (high - low)


@given(st.integers(2, 30).flatmap(signals), st.data())
def test_shrinking_is_the_mean_over_each_samples_time(
    segment: np.ndarray, data: st.DataObject
) -> None:
    n = len(segment)
    length = data.draw(st.integers(1, n - 1))
    values = [Fraction(float(value)) for value in segment[:, 0]]
    if length == 1:
        oracle = [interpolant_mean(values, Fraction(0), Fraction(n - 1))]
    else:
        step = Fraction(n - 1, length - 1)
        oracle = [
            interpolant_mean(values, (i - Fraction(1, 2)) * step, (i + Fraction(1, 2)) * step)
            for i in range(1, length - 1)
        ]
        oracle = [values[0], *oracle, values[-1]]
    found = normalise(segment, length)[:, 0]
    np.testing.assert_allclose(found, [float(value) for value in oracle], rtol=0, atol=1e-10)


@given(cut_signals(), LENGTHS)
def test_batch_equals_single(cut: tuple[np.ndarray, np.ndarray], length: int) -> None:
    signal, borders = cut
    patterns = normalise_batch(signal, borders, length)
    assert patterns.shape == (len(borders) - 1, length, 2)
    back = denormalise_batch(patterns, borders)
    assert back.shape == signal.shape
    for pattern, start, stop in zip(patterns, borders[:-1], borders[1:], strict=True):
        np.testing.assert_array_equal(pattern, normalise(signal[start:stop], length))
        np.testing.assert_array_equal(back[start:stop], denormalise(pattern, stop - start))


def test_no_frames() -> None:
    nothing = np.zeros((0, 4))
    assert normalise_batch(nothing, np.array([0]), 8).shape == (0, 8, 4)
    assert denormalise_batch(np.zeros((0, 8, 4)), np.array([0])).shape == (0, 4)
    assert smooth_borders(nothing, np.array([0]), 3).shape == (0, 4)


def test_the_bits_do_not_depend_on_memory_layout() -> None:
    signal = np.random.default_rng(3).normal(size=(90, 7))
    borders = np.array([0, 1, 30, 37, 90])
    plain = normalise_batch(signal, borders, 16)
    other = normalise_batch(np.asfortranarray(signal), borders, 16)
    assert plain.tobytes() == other.tobytes()
    alone = normalise_batch(signal[:, 3:4], borders, 16)
    assert plain[:, :, 3:4].tobytes() == alone.tobytes()


@given(cut_signals(), st.integers(0, 12))
def test_smoothing_leaves_ends_and_far_frames(
    cut: tuple[np.ndarray, np.ndarray], width: int
) -> None:
    signal, borders = cut
    out = smooth_borders(signal, borders, width)
    frames = np.arange(len(signal))
    far = np.ones(len(signal), bool)
    for border in borders[1:-1]:
        far &= (frames < border - width) | (frames >= border + width)
    far[[0, -1]] = True
    np.testing.assert_array_equal(out[far], signal[far])


@given(st.lists(st.integers(1, 25), min_size=1, max_size=6), st.integers(0, 12))
def test_smoothing_leaves_lines(counts: list[int], width: int) -> None:
    borders = np.concatenate([[0], np.cumsum(counts)])
    rest = np.full((borders[-1], 2), 3.0)
    np.testing.assert_array_equal(smooth_borders(rest, borders, width), rest)
    if min(counts) > 1:  # a single frame has no step of its own to tell a slope from a jump
        signal = np.arange(borders[-1])[:, None] * np.array([[0.5, -2.0]])
        np.testing.assert_allclose(smooth_borders(signal, borders, width), signal, atol=1e-12)


@given(
    st.lists(st.integers(2, 25), min_size=2, max_size=6),
    st.integers(1, 12),
    st.lists(VALUES, min_size=6, max_size=6),
)
def test_smoothing_removes_jumps_of_constant_pieces(
    counts: list[int], width: int, levels: list[float]
) -> None:
    borders = np.concatenate([[0], np.cumsum(counts)])
    signal = np.repeat(levels[: len(counts)], counts)[:, None]
    out = smooth_borders(signal, borders, width)
    inner = borders[1:-1]
    np.testing.assert_allclose(out[inner], out[inner - 1], atol=1e-9)
    assert out.min() >= signal.min() - 1e-9
    assert out.max() <= signal.max() + 1e-9


@pytest.mark.parametrize("side", ["first", "last"])
def test_a_single_end_frame_leaves_the_jump_to_the_other_side(side: str) -> None:
    signal = np.array([0.0, 6, 6, 6, 6, 6])[:, None]
    borders = np.array([0, 1, 6])
    if side == "last":
        signal, borders = signal[::-1], np.array([0, 5, 6])
    out = smooth_borders(signal, borders, 3)[:: 1 if side == "first" else -1, 0]
    assert out[0] == 0.0
    assert out[1] == pytest.approx(0.0)
    assert (np.diff(out) >= 0).all()
    assert (out[4:] == 6.0).all()
