"""Retrieval, against a search in plain Python of what its docstring says."""

from __future__ import annotations

from fractions import Fraction
from math import isqrt
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import pytest
from clips import Recipe, family_of, random_parts, skeleton_clip
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.blocks.blockcontext import KEYS
from motifold.codec.blocks.motionmodel import fixed_model
from motifold.codec.blocks.nodes import FOLLOWER, KIND, PLACE, ROW
from motifold.codec.blocks.recall import (
    FAR,
    NEIGHBOURS,
    STRIDE,
    Memory,
    empty_memory,
    joined,
    own_memory,
    own_stride,
    recall,
    remember,
    remember_next,
)
from motifold.codec.clip import IntArray
from motifold.codec.figure.rig import rig_of
from motifold.codec.geometry.limits import uniform_limits
from motifold.codec.version2.motiongoal import goal_of

Keys: TypeAlias = npt.NDArray[np.int16]
CHANNELS = 12


def brute(
    key: IntArray, keys: Keys, follows: IntArray
) -> tuple[list[Fraction], Fraction, int, int]:
    """Exact weighted means, their mean absolute deviation, and the squares of two distances."""
    wide = keys.astype(object) - key.astype(object)
    squares = [sum(part * part for part in row) for row in wide]
    chosen = sorted(range(len(keys)), key=lambda moment: (squares[moment], moment))[:NEIGHBOURS]
    first = squares[chosen[0]] + 1  # so that exact matches weigh something
    weights = [1 / Fraction(squares[moment] + first) ** 2 for moment in chosen]
    means, spread = [], Fraction(0)
    for channel in range(follows.shape[1]):
        values = [int(follows[moment, channel]) for moment in chosen]
        mean = sum(w * v for w, v in zip(weights, values, strict=True)) / sum(weights)
        off = sum(w * abs(v - mean) for w, v in zip(weights, values, strict=True))
        means.append(Fraction(mean))
        spread += off / sum(weights) / follows.shape[1]
    return means, spread, squares[chosen[0]], squares[chosen[-1]]


def recalled(
    key: IntArray, keys: Keys, follows: IntArray, prediction: IntArray, own: int = 0
) -> tuple[int, int, int]:
    """Call `recall` with the last ``own`` moments as the clip's own, and room for more."""
    others = len(keys) - own
    own_keys = np.concatenate([keys[others:], np.zeros((3, KEYS), np.int16)])
    whole = follows.astype(np.int32)
    own_follows = np.concatenate([whole[others:], np.full((3, whole.shape[1]), 7, np.int32)])
    return recall(
        key.astype(np.int16), keys[:others], whole[:others], own_keys, own_follows, own, prediction
    )


def check(key: IntArray, keys: Keys, follows: IntArray, own: int = 0) -> None:
    """What `recall` adds is the exact mean, but for weights in whole numbers."""
    base = np.arange(follows.shape[1], dtype=np.int64) * 1000
    prediction = base.copy()
    spread, nearest, last = recalled(key, keys, follows, prediction, own)
    means, exact_spread, first_square, last_square = brute(key, keys, follows)
    room = np.abs(follows).max() / 60 + 2
    for added, mean in zip((prediction - base).tolist(), means, strict=True):
        assert abs(added - mean) <= room
    assert abs(spread - exact_spread) <= room
    assert (nearest, last) == (isqrt(first_square), isqrt(last_square))


def random_moments(
    seed: int, moments: int, size: int, distinct: int
) -> tuple[IntArray, Keys, IntArray]:
    """A key, and moments of which many have the same keys."""
    rng = np.random.default_rng(seed)
    some = rng.integers(-size, size + 1, (distinct, KEYS))
    keys = some[rng.integers(0, distinct, moments)].astype(np.int16)
    key = some[0] if rng.random() < 0.3 else rng.integers(-size, size + 1, KEYS)
    return key.astype(np.int64), keys, rng.integers(-(10**8), 10**8, (moments, CHANNELS))


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 40),
    st.sampled_from([1, 30, 2000, 32767]),
    st.sampled_from([1, 3, 40]),
    st.floats(0, 1),
)
@settings(max_examples=150)
def test_recall_is_a_search_for_the_nearest_moments(
    seed: int, moments: int, size: int, distinct: int, share: float
) -> None:
    check(*random_moments(seed, moments, size, distinct), own=round(share * moments))


@pytest.mark.parametrize("moments", range(1, NEIGHBOURS + 2))
def test_fewer_moments_than_neighbours(moments: int) -> None:
    check(*random_moments(moments, moments, 500, 40))


def test_the_earlier_of_equally_near_moments_is_taken() -> None:
    """The first half of every key differs or the second: both ways to be passed over."""
    rng = np.random.default_rng(3)
    for column in (0, 11, 12, KEYS - 1):
        for _ in range(20):
            keys = np.zeros((30, KEYS), np.int16)
            keys[:, column] = rng.choice([-7, 7], 30)  # all at the same distance
            nearer = rng.choice(30, 3, replace=False)
            keys[nearer, column] = 2
            tied = [moment for moment in range(30) if moment not in nearer]
            follows = np.full((30, CHANNELS), 10**6)
            follows[[*nearer, *tied[: NEIGHBOURS - 3]]] = 40
            prediction = np.zeros(CHANNELS, np.int64)
            found = recalled(np.zeros(KEYS, np.int64), keys, follows, prediction)
            assert found == (0, 2, 7)
            assert (prediction == 40).all()


def test_an_exact_match_stands_nearly_alone() -> None:
    keys = np.zeros((30, KEYS), np.int16)
    keys[:, 4] = 1000
    keys[17, 4] = 0
    follows = np.zeros((30, CHANNELS), np.int64)
    follows[17] = 10**6
    prediction = np.zeros(CHANNELS, np.int64)
    found = recalled(np.zeros(KEYS, np.int64), keys, follows, prediction, 15)
    assert (prediction == 10**6).all()
    assert found[0] == 0
    assert found[1:] == (0, 1000)


def test_eight_exact_matches_are_averaged() -> None:
    _, keys, follows = random_moments(6, 40, 300, 40)
    keys[5:40:4] = 999
    prediction = np.zeros(CHANNELS, np.int64)
    found = recalled(np.full(KEYS, 999), keys, follows, prediction, 20)
    assert found[1:] == (0, 0)
    assert (prediction == follows[5:37:4].sum(axis=0) // 8).all()


def test_a_row_that_no_reference_has_adds_nothing() -> None:
    prediction = np.arange(CHANNELS)
    keys = np.full((20, KEYS), FAR, np.int16)
    found = recalled(np.full(KEYS, -32767), keys, np.zeros((20, CHANNELS), np.int64), prediction)
    assert prediction.tolist() == list(range(CHANNELS))
    assert found == (0, isqrt(24 * 65534**2), isqrt(24 * 65534**2))


def test_the_largest_numbers_do_not_overflow() -> None:
    rng = np.random.default_rng(0)
    keys = rng.choice([-32767, FAR], (20, KEYS)).astype(np.int16)
    keys[3] = -32767
    follows = rng.choice([-(2**31) + 1, 2**31 - 1], (20, CHANNELS))
    check(np.full(KEYS, -32767), keys, follows)
    check(np.full(KEYS, 32767), keys, follows)


@given(st.integers(0, 100), st.integers(0, 60), st.sampled_from([4, 8]))
@settings(max_examples=25)
def test_what_is_remembered_are_the_moments_of_a_clip(seed: int, frames: int, span: int) -> None:
    recipe = Recipe(seed=seed, joints=5, frames=frames, motion="smooth", stretchy=0.3)
    clip = skeleton_clip(recipe)
    rig = rig_of(clip, random_parts(seed, 5))
    goal = goal_of(clip, rig, family_of(clip, rig), uniform_limits(clip, 0.1))
    model = fixed_model(10, span)
    nothing = np.zeros_like(model.weights)
    table = goal.nodes.table
    memory = remember(goal.path, frames, table, span, model.lags, model.up, nothing)
    starts = range(1, frames - span + 1, STRIDE)
    assert memory.moments == len(starts)
    assert memory.keys.shape == (10, len(starts), KEYS)
    assert memory.follows.shape == (10, len(starts), 3 * span)
    coded = set(table[table[:, KIND] != FOLLOWER][:, ROW].tolist())
    for row in range(10):
        if row not in coded:
            assert (memory.keys[row] == FAR).all()
            assert not memory.follows[row].any()
    # with nothing predicted, what followed is the way through the block: that of the path, say
    for node in np.flatnonzero(table[:, KIND] == PLACE).tolist():
        moved = memory.follows[table[node, ROW]].reshape(-1, span, 3) / 2**20
        lever = table[node, 5] / 16
        for at, start in enumerate(starts):
            ahead = goal.path[start : start + span, node, :3] - goal.path[start - 1, node, :3]
            wanted = np.linalg.norm(ahead / 2**20, axis=1) * lever
            found = np.linalg.norm(moved[at], axis=1)
            assert np.abs(found - wanted).max() < 1e-3 * (1.0 + wanted.max())


@given(st.integers(0, 100), st.integers(1, 40), st.sampled_from([4, 8]), st.data())
@settings(max_examples=25)
def test_a_clip_remembers_itself_as_far_as_it_is_decoded(
    seed: int, frames: int, span: int, data: st.DataObject
) -> None:
    """What lies ahead may be anything; moments are written once and stay."""
    clip = skeleton_clip(Recipe(seed=seed, joints=5, frames=frames, motion="smooth"))
    rig = rig_of(clip, random_parts(seed, 5))
    goal = goal_of(clip, rig, family_of(clip, rig), uniform_limits(clip, 0.1))
    model = fixed_model(10, span)
    rest = (goal.nodes.table, span, model.lags, model.up, model.weights)
    stride = own_stride(span)
    whole = own_memory(frames, 10, span)
    remember_next(goal.path, frames, *rest, stride, whole.keys, whole.follows, 0)
    own, known = own_memory(frames, 10, span), 0
    for decoded in sorted(data.draw(st.lists(st.integers(1, frames), max_size=5))):
        ahead = goal.path.copy()
        ahead[decoded:] = 12345
        known = remember_next(ahead, decoded, *rest, stride, own.keys, own.follows, known)
        assert known == len(range(1, decoded - span + 1, stride))
        assert np.array_equal(own.keys[:, :known], whole.keys[:, :known])
        assert np.array_equal(own.follows[:, :known], whole.follows[:, :known])
        assert (own.keys[:, known:] == FAR).all()


def test_memories_are_joined_in_order() -> None:
    rng = np.random.default_rng(0)
    parts = [
        Memory(
            rng.integers(-9, 9, (3, n, KEYS)).astype(np.int16),
            rng.integers(-9, 9, (3, n, CHANNELS)).astype(np.int32),
        )
        for n in (4, 0, 2)
    ]
    both = joined(parts, 3, CHANNELS)
    assert both.moments == 6
    assert np.array_equal(both.keys[:, 4:], parts[2].keys)
    assert np.array_equal(both.follows[:, :4], parts[0].follows)
    assert joined([], 3, CHANNELS).moments == empty_memory(3, CHANNELS).moments == 0
