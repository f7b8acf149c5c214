"""Motion models as bytes: every integer comes back, and damage is never worse than damage."""

from __future__ import annotations

import contextlib
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.blocks.blockcontext import feature_count
from motifold.codec.blocks.motionmodel import (
    BASIS_BITS,
    GROUPS,
    SIGNS,
    WEIGHT_BITS,
    MotionModel,
    cosine_basis,
    fixed_model,
    fold_features,
    usual_lags,
)
from motifold.codec.clip import IntArray
from motifold.codec.errors import DamagedError
from motifold.codec.learned.modelfile import read_model, write_model
from motifold.codec.streams.entropy import SymbolWriter

SPANS = (4, 8, 16)
ARRAYS = ("lags", "folded_weights", "folded_basis", "base", "senses", "starts")


def random_model(seed: int, span: int, rows: int, size: float) -> MotionModel:
    """A model of integers up to ``size``, some lines coarse, some zero."""
    rng = np.random.default_rng(seed)
    channels, features = 3 * span, feature_count(span)

    def table(*shape: int) -> IntArray:
        lines = size ** rng.uniform(0.0, 1.0, (*shape[:-1], 1)) * (
            rng.random((*shape[:-1], 1)) < 0.8
        )
        grain = 1 << rng.integers(0, 18, (*shape[:-1], 1))
        values = np.rint(rng.laplace(size=shape) * lines).astype(np.int64)
        return np.asarray(values // grain * grain)

    joints = np.arange(rows // 2)
    return MotionModel(
        span,
        usual_lags(span),
        int(rng.integers(0, 3)),
        table(rows, features, channels),
        table(rows, channels, channels),
        table(rows, channels),
        table(rows, GROUPS, SIGNS),
        table(rows, 2, 3),
        tuple(joints[rng.random(len(joints)) < 0.3].tolist()),
        tuple(joints[rng.random(len(joints)) < 0.3].tolist()),
    )


def assert_same(found: MotionModel, wanted: MotionModel) -> None:
    for name in ARRAYS:
        assert np.array_equal(getattr(found, name), getattr(wanted, name)), name
        assert getattr(found, name).dtype == np.int64
    for name in ("span", "up", "rows", "channels", "still", "sliding"):
        assert getattr(found, name) == getattr(wanted, name), name


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([4, 8]),
    st.integers(0, 3),
    st.sampled_from([1.0, 100.0, 1e5, 1e9]),
)
@settings(max_examples=25)
def test_models_come_back(seed: int, span: int, rows: int, size: float) -> None:
    model = random_model(seed, span, rows, size)
    assert_same(read_model(write_model(model)), model)


@pytest.mark.parametrize("span", SPANS)
def test_fixed_models_come_back(span: int) -> None:
    model = fixed_model(4, span, up=2)
    data = write_model(model)
    assert_same(read_model(data), model)
    assert len(data) < model.folded_weights.nbytes / 8


@pytest.mark.parametrize("span", SPANS)
def test_fixed_models_are_the_same_on_every_machine(span: int) -> None:
    """Nothing that they are rounded from is near the border between two integers."""
    cosines = cosine_basis(span) * (1 << BASIS_BITS)
    assert np.abs(cosines - np.floor(cosines) - 0.5).min() > 1e-6
    features, channels = feature_count(span), 3 * span
    weights = np.zeros((features, channels))
    for frame in range(span):
        # the last frame's motion, fading, relative to the guide's, which is taken over whole
        ahead = sum(0.8**k for k in range(1, frame + 2))
        for axis in range(3):
            weights[axis, 3 * frame + axis] = -ahead
            weights[15 + 3 * frame + axis, 3 * frame + axis] = 1.0
            weights[15 + 3 * span + axis, 3 * frame + axis] = ahead
    fold = fold_features(span) / float(1 << BASIS_BITS)
    fine = fold @ weights @ cosine_basis(span).T * (1 << WEIGHT_BITS)
    assert np.abs(fine - np.floor(fine) - 0.5).min() > 1e-6
    model = fixed_model(2, span)
    assert np.array_equal(model.folded_weights[0], np.rint(fine).astype(np.int64))
    # unfolded again it is what it was made from, but for rounding
    assert np.abs(model.weights[0] / (1 << WEIGHT_BITS) - weights).max() < 2e-3
    basis = model.basis[0] / (1 << BASIS_BITS)
    assert np.abs(basis @ basis.T - np.eye(channels)).max() < 2e-3
    # what prediction leaves of a walk that begins at nothing: its covariance is min(t, u), whose
    # inverse has 2 on the diagonal, but 1 at the end, and -1 beside it
    walk = np.minimum.outer(np.arange(1, span + 1), np.arange(1, span + 1))
    left = basis @ np.kron(walk, np.eye(3)) @ basis.T
    assert np.abs(left - np.diag(np.diag(left))).max() < 5e-3 * left.max()
    assert (np.diff(np.diag(left)) < 5e-3 * left.max()).all()


@pytest.mark.parametrize("span", SPANS)
def test_hinges_of_a_fixed_model_do_not_follow_their_guides(span: int) -> None:
    plain, hinged = fixed_model(6, span), fixed_model(6, span, hinged=(1, 2))
    same = np.array([0, 3, 4, 5])
    assert np.array_equal(plain.weights[same], hinged.weights[same])
    own = np.r_[0:15, 21 + 3 * span : feature_count(span)]
    assert np.array_equal(plain.weights[1][own], hinged.weights[1][own])
    assert plain.weights[1][15 : 21 + 3 * span].any()
    assert not hinged.weights[1:3, 15 : 21 + 3 * span].any()
    assert np.array_equal(read_model(write_model(hinged), (1, 2)).weights, hinged.weights)
    with pytest.raises(DamagedError, match="rig family"):
        read_model(write_model(fixed_model(6, span)), (3,))


@pytest.mark.parametrize("span", SPANS)
def test_the_fold_is_a_rotation_but_for_rounding(span: int) -> None:
    fold = fold_features(span) / float(1 << BASIS_BITS)
    assert np.abs(fold @ fold.T - np.eye(feature_count(span))).max() < 1e-3


MODEL = random_model(1, 4, 2, 300.0)
DATA = write_model(MODEL)


def check_damaged(data: bytes) -> None:
    """Whatever the bytes: some model or `DamagedError`, soon."""
    began = time.perf_counter()
    with contextlib.suppress(DamagedError):
        model = read_model(data)
        shape = (model.rows, feature_count(model.span), model.channels)
        assert model.folded_weights.shape == shape
        assert model.weights.shape == shape
        assert model.basis.shape == (model.rows, model.channels, model.channels)
        assert max(len(model.still), len(model.sliding)) <= model.rows
    assert time.perf_counter() - began < 2.0


@given(st.binary(max_size=300))
@settings(max_examples=100)
def test_any_bytes_are_a_model_or_damage(data: bytes) -> None:
    check_damaged(data)


@given(st.lists(st.integers(0, 8 * len(DATA) - 1), min_size=1, max_size=4))
@settings(max_examples=60)
def test_flipped_bits_are_a_model_or_damage(places: list[int]) -> None:
    wrong = bytearray(DATA)
    for place in places:
        wrong[place // 8] ^= 1 << place % 8
    check_damaged(bytes(wrong))


@given(st.integers(0, len(DATA)))
@settings(max_examples=60)
def test_truncated_models_are_a_model_or_damage(length: int) -> None:
    check_damaged(DATA[:length])


@pytest.mark.parametrize(
    "numbers",
    [
        (5, 1, 4),  # spans that no clip has
        (0, 1, 4),
        (2**40, 1, 4),
        (8, 3, 4),  # a fourth axis
        (8, 1, 2**14 + 1),  # hosts of joints
        (8, 1, 2**47),
        (8, 1, 4, 5),
        (8, 1, 4, 2**47),
        (8, 1, 4, 0, 2**47),
        (32, 1, 2**14, 0, 0),  # more rows than the bytes hold
    ],
)
def test_hostile_claims_are_refused_quickly(numbers: tuple[int, ...]) -> None:
    writer = SymbolWriter()
    for number in numbers:
        writer.number(number)
    began = time.perf_counter()
    with pytest.raises(DamagedError):
        read_model(writer.to_bytes())
    assert time.perf_counter() - began < 1.0
