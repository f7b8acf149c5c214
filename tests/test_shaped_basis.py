"""The learned basis: coefficients apart, and rounding that errs least where prediction starts."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.blocks.blockcoder import choose
from motifold.codec.blocks.motionmodel import MotionModel, cosine_basis, fixed_model
from motifold.codec.clip import FloatArray
from motifold.codec.learned.predictorfit import LAST_FRAME, _basis
from motifold.codec.streams.sizeclasses import class_costs

SPANS = st.sampled_from([4, 8])
SEEDS = st.integers(0, 2**32 - 1)


def learned(span: int, seed: int) -> tuple[MotionModel, FloatArray]:
    """Return a model whose one row fits random signals, and their covariance."""
    rng = np.random.default_rng(seed)
    signals = rng.normal(size=(400, 3 * span)) @ rng.normal(size=(3 * span, 3 * span))
    covariance = signals.T @ signals / len(signals)
    cosine = cosine_basis(span)
    basis = _basis(cosine @ covariance @ cosine.T, span)
    return replace(fixed_model(1, span), folded_basis=basis[None]), covariance


@given(SPANS, SEEDS)
def test_rounding_errs_less_in_the_last_frame(span: int, seed: int) -> None:
    basis = learned(span, seed)[0].basis[0] / 2.0**14
    energy = (basis**2).sum(axis=0).reshape(span, 3)  # of equal errors in all coefficients
    assert np.allclose(energy[:-1] / energy[-1], LAST_FRAME**2, rtol=0.02)
    assert np.isclose(np.prod(energy), 1.0, rtol=0.05)


@given(SPANS, SEEDS)
def test_analysis_finds_the_coefficients(span: int, seed: int) -> None:
    model, covariance = learned(span, seed)
    wanted = np.random.default_rng(seed + 1).normal(size=(5, model.channels))
    signals = wanted @ model.basis[0] / 2.0**14
    assert np.allclose(signals @ model.analysis[0].T / 2.0**14, wanted, atol=1e-9)
    spread = model.analysis[0] @ covariance @ model.analysis[0].T / 2.0**28
    variances = np.diag(spread)
    alike = spread / np.sqrt(np.outer(variances, variances)) - np.eye(len(spread))
    assert np.abs(alike[: span // 2, : span // 2]).max() < 0.1  # the largest ones tell apart
    assert (variances[:-1] * 1.1 >= variances[1:]).all()


@given(SPANS, SEEDS, st.integers(1 << 10, 1 << 22))
def test_coefficients_are_the_nearest_without_thrift(span: int, seed: int, size: int) -> None:
    model, _ = learned(span, seed)
    rng = np.random.default_rng(seed + 2)
    left = rng.integers(-(1 << 20), 1 << 20, model.channels)
    quantised = np.zeros(model.channels, np.int64)
    ones, more = class_costs()[1:]
    kinds = np.zeros(model.channels, np.int64)
    rest = np.zeros(model.channels)
    choose(left, rest, model.basis[0], model.analysis[0], size, kinds, ones, more, 0.0, quantised)
    exact = left @ model.analysis[0].T / 2.0**14 / (size / 2.0**4)
    assert np.abs(quantised - exact).max() <= 0.5 + 1e-6 * np.abs(exact).max()
