"""Models picked row by row: never dearer than any of the candidates, by their own reckoning."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from test_modelfile import assert_same, random_model

from motifold.codec.blocks.motionmodel import BASIS_BITS, MotionModel, fixed_model
from motifold.codec.clip import IntArray
from motifold.codec.learned.economy import Candidate, cheapest, coarsened
from motifold.codec.learned.modelfile import read_model, row_sizes, write_model


def mixed(model: MotionModel, as_fixed: IntArray) -> MotionModel:
    """The model with the rows and tables of ``as_fixed`` (rows, 3) taken from the fixed one."""
    plain = fixed_model(model.rows, model.span, model.up)
    for row, (weights, basis, sizes) in enumerate(as_fixed):
        if weights:
            model.folded_weights[row] = plain.folded_weights[row]
        if basis:
            model.folded_basis[row] = plain.folded_basis[row]
        if sizes:
            for name in ("base", "senses", "starts"):
                getattr(model, name)[row] = getattr(plain, name)[row]
    return model


@given(st.integers(0, 2**32 - 1), st.integers(1, 6))
@settings(max_examples=25)
def test_rows_that_are_as_in_the_fixed_model_cost_next_to_nothing(seed: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    as_fixed = rng.integers(0, 2, (rows, 3))
    as_fixed[0] = 1
    model = mixed(random_model(seed, 4, rows, 100.0), as_fixed)
    data = write_model(model)
    assert_same(read_model(data), model)
    sizes = row_sizes(model)
    assert sizes[0] <= 1
    assert abs(len(data) - sizes.sum()) <= 16 + 5 * rows  # each alone is rounded up to words
    all_fixed = np.ones((rows, 3), np.int64)
    assert len(write_model(mixed(model, all_fixed))) <= 16 + rows


@given(st.integers(0, 2**32 - 1), st.integers(1, 5), st.integers(1, 4))
@settings(max_examples=25)
def test_every_row_is_the_cheapest_candidates(seed: int, rows: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    candidates = [
        Candidate(random_model(seed + at, 4, rows, 50.0), rng.integers(0, 9, rows).astype(float))
        for at in range(count)
    ]
    best = cheapest(candidates)
    costs = np.stack([each.costs for each in candidates])
    assert np.array_equal(best.costs, costs.min(axis=0))
    for row in range(rows):
        taken = candidates[int(costs[:, row].argmin())].model
        for name in ("folded_weights", "folded_basis", "base", "senses", "starts"):
            assert np.array_equal(getattr(best.model, name)[row], getattr(taken, name)[row])


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_a_coarser_model_is_near_and_smaller(seed: int) -> None:
    model = random_model(seed, 4, 3, 1e4)
    coarse = coarsened(model)
    assert np.abs(coarse.folded_basis - model.folded_basis).max() <= 1 << (BASIS_BITS - 9)
    assert not (coarse.folded_basis % (1 << (BASIS_BITS - 8))).any()
    together = np.bitwise_or.reduce(model.folded_weights, axis=2)
    grain = np.maximum(together & -together, 1)[:, :, None] * 4
    assert not (coarse.folded_weights % grain).any()
    assert (2 * np.abs(coarse.folded_weights - model.folded_weights) <= grain).all()
    assert row_sizes(coarse).sum() <= row_sizes(model).sum()
