"""Patterns: stored coefficients, laid along a clip the same way on every machine."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from clips import Recipe, marker_bench, skeleton_bench
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.patterns.patterns import (
    COSINES,
    PATTERN_FRAMES,
    PATTERN_STEP,
    Codebook,
    distance_scale,
    pattern_channels,
    to_centimetres,
    to_coefficients,
    unfold,
)

SEEDS = st.integers(0, 2**32 - 1)
LENGTHS = st.lists(st.integers(1, 60), max_size=8)


def test_the_cosine_basis_is_orthonormal_and_rounded_safely() -> None:
    basis = COSINES / 4096
    assert np.abs(basis @ basis.T - np.eye(16)).max() < 1e-3
    frame = (np.arange(16) + 0.5) * np.pi / 16
    exact = np.array([np.cos(course * frame) for course in range(16)]) * np.sqrt(1 / 8) * 4096
    exact[0] = 1024
    # no value is so near a half that another machine's cosine could round it elsewhere
    assert np.abs(np.abs(exact - np.floor(exact) - 0.5)).min() > 1e-6
    assert np.array_equal(COSINES, np.rint(exact))


@given(SEEDS, st.integers(0, 5), st.integers(1, 4))
@settings(deadline=None)
def test_points_survive_storing_within_half_a_step_a_coefficient(
    seed: int, count: int, joints: int
) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 16, 3 * joints)) * 50
    stored = to_coefficients(points)
    assert stored.dtype == np.int16
    back = to_centimetres(stored)
    # RMS: half a step per coefficient, and what the rounded basis costs
    rms = np.sqrt(np.square(back - points).sum(axis=(1, 2))) / distance_scale(3 * joints)
    sizes = np.sqrt(np.square(points).sum(axis=(1, 2))) / distance_scale(3 * joints)
    assert (rms <= PATTERN_STEP / 2 * np.sqrt(3) + 1e-3 * sizes).all()
    assert all(Fraction(value) * 2048 % 1 == 0 for value in back.ravel().tolist()[:50])


def test_coefficients_are_clipped_to_what_is_stored() -> None:
    stored = to_coefficients(np.full((1, 16, 3), 1e9))
    assert stored.max() == 32767


@pytest.mark.parametrize("joints", [1, 2, 7])
def test_distances_read_as_centimetres_of_a_joint(joints: int) -> None:
    """All joints 5 cm off all the time is a distance of 5 cm."""
    away = np.zeros((16, joints, 3))
    away[..., 0], away[..., 1] = 3.0, 4.0
    assert np.linalg.norm(away) / distance_scale(3 * joints) == pytest.approx(5.0)


def naive(pattern: list[float], frame: int, length: int) -> Fraction:
    """Catmull-Rom by its textbook matrix, in exact arithmetic."""
    time = Fraction(frame * 15, max(length - 1, 1))
    knot = min(int(time), 14)
    t = time - knot
    p0, p1, p2, p3 = (
        Fraction(pattern[min(max(index, 0), 15)]) for index in range(knot - 1, knot + 3)
    )
    return (
        2 * p1
        + (p2 - p0) * t
        + (2 * p0 - 5 * p1 + 4 * p2 - p3) * t**2
        + (3 * p1 - p0 - 3 * p2 + p3) * t**3
    ) / 2


@given(SEEDS, LENGTHS)
@settings(max_examples=30, deadline=None)
def test_unfolding_is_catmull_rom(seed: int, lengths: list[int]) -> None:
    patterns = np.random.default_rng(seed).normal(size=(len(lengths), 16, 2)) * 10
    borders = np.cumsum([0, *lengths])
    out = unfold(patterns, borders)
    assert out.shape == (sum(lengths), 2)
    for segment, length in enumerate(lengths):
        for frame in range(length):
            for channel in range(2):
                exact = naive(patterns[segment, :, channel].tolist(), frame, length)
                ours = float(out[borders[segment] + frame, channel])
                assert ours == pytest.approx(float(exact), abs=1e-12)


@given(SEEDS, st.lists(st.integers(2, 60), min_size=1, max_size=8))
@settings(deadline=None)
def test_unfolding_passes_through_first_and_last_frames(seed: int, lengths: list[int]) -> None:
    patterns = np.random.default_rng(seed).normal(size=(len(lengths), 16, 3)) * 10
    borders = np.cumsum([0, *lengths])
    out = unfold(patterns, borders)
    assert np.array_equal(out[borders[:-1]], patterns[:, 0])
    assert np.allclose(out[borders[1:] - 1], patterns[:, -1], rtol=0, atol=1e-13)


@given(SEEDS)
@settings(deadline=None)
def test_segments_unfold_the_same_alone_and_together(seed: int) -> None:
    """Elementwise: neither the batch nor memory layout changes a bit."""
    rng = np.random.default_rng(seed)
    lengths = rng.integers(1, 50, 6)
    borders = np.array([0, *np.cumsum(lengths)])
    patterns = rng.normal(size=(6, 16, 9))
    together = unfold(patterns, borders)
    transposed = np.ascontiguousarray(patterns.T).T
    assert np.array_equal(unfold(transposed, borders), together)
    alone = [
        unfold(patterns[[segment], :, channel : channel + 1], np.array([0, lengths[segment]]))
        for segment in range(6)
        for channel in range(9)
    ]
    for segment in range(6):
        columns = np.concatenate(alone[9 * segment : 9 * segment + 9], axis=1)
        assert np.array_equal(columns, together[borders[segment] : borders[segment + 1]])


@given(SEEDS, st.integers(0, 60))
@settings(deadline=None)
def test_an_unstretched_pattern_stays_what_it_is(seed: int, pad: int) -> None:
    pattern = np.random.default_rng(seed).normal(size=(1, PATTERN_FRAMES, 3))
    out = unfold(np.repeat(pattern, 2, axis=0), np.array([0, 16, 17 + pad]))
    assert np.allclose(out[:16], pattern[0], rtol=0, atol=1e-14)


def test_an_empty_codebook_has_tables_of_the_right_widths() -> None:
    for bench in (skeleton_bench(Recipe(3, joints=12)), marker_bench(3, 12, 4)):
        codebook = Codebook.empty(bench.codebook.family)
        for part, table in zip(codebook.family.parts, codebook.patterns, strict=True):
            channels = 0 if part.parent < 0 else 3 * len(part.joints)
            assert table.shape == (0, 16, channels)
            assert pattern_channels(part) == channels


def test_a_codebook_knows_its_patterns_in_centimetres() -> None:
    bench = skeleton_bench(Recipe(3, joints=12, frames=60), patterns=True)
    codebook = replace(bench.codebook)
    assert any(len(table) for table in codebook.patterns)
    for table, points in zip(codebook.patterns, codebook.centimetres, strict=True):
        assert np.array_equal(points, to_centimetres(table))
