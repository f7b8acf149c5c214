"""The graph of references: levels by lot, and near-duplicates found first."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.learned.sketch import SKETCH_NUMBERS, Sketch
from motifold.pipeline.references import (
    LEVEL_SHARES,
    MOST_MOMENTS,
    NEIGHBOURS,
    ReferenceFinder,
    levels_of,
)


def sketch(rng: np.random.Generator, moments: int, centre: float = 0.0) -> Sketch:
    """Moments like a random walk."""
    steps = rng.normal(size=(moments, SKETCH_NUMBERS))
    return (np.cumsum(steps, axis=0) + centre * rng.normal(size=SKETCH_NUMBERS)).astype(np.float32)


def numbers(finder: ReferenceFinder, wanted: Sketch) -> list[int]:
    """The candidates found for a clip of which no image is known."""
    found = finder.find(wanted)
    assert not any(each.mirrored for each in found)
    return [each.number for each in found]


@given(st.integers(0, 3000), st.integers(0, 2**32 - 1))
def test_levels_have_their_shares(count: int, seed: int) -> None:
    levels = levels_of(count, seed)
    assert levels.shape == (count,)
    assert set(levels.tolist()) <= set(range(len(LEVEL_SHARES) + 1))
    for level, share in enumerate(LEVEL_SHARES):
        assert abs((levels <= level).sum() - share * count) <= 1
    if count:
        assert (levels == 0).any()  # somebody goes first
    assert np.array_equal(levels, levels_of(count, seed))


def test_levels_are_drawn_by_lot() -> None:
    draws = np.array([levels_of(200, seed) for seed in range(200)])
    assert len(np.unique(draws, axis=0)) == 200
    # no clip's place in the list settles its level
    assert np.abs((draws == 0).mean(axis=0) - LEVEL_SHARES[0]).max() < 0.08
    assert np.abs((draws == len(LEVEL_SHARES)).mean(axis=0) - 0.5).max() < 0.18


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 25),
    st.integers(1, 30),
    st.floats(0.0, 0.05),
    st.integers(1, 6),
)
@settings(max_examples=60)
def test_the_planted_near_duplicate_comes_first(
    seed: int, candidates: int, moments: int, noise: float, most: int
) -> None:
    rng = np.random.default_rng(seed)
    sketches = [sketch(rng, int(rng.integers(1, 40)), 30.0) for _ in range(candidates)]
    wanted = sketch(rng, moments, 30.0)
    planted = int(rng.integers(0, candidates))
    sketches[planted] = (wanted + noise * rng.normal(size=wanted.shape)).astype(np.float32)
    finder = ReferenceFinder(most)
    cut = int(rng.integers(0, candidates + 1))
    finder.add(sketches[:cut])
    if cut:
        finder.find(wanted)  # asked in between, it still sees what comes later
    finder.add(sketches[cut:])
    found = numbers(finder, wanted)
    assert found[0] == planted
    assert len(found) == len(set(found)) <= most
    assert set(found) <= set(range(candidates))
    assert found[1:] == [] or sum(len(sketches[n]) for n in found) <= MOST_MOMENTS
    assert numbers(finder, wanted) == found


def test_a_candidate_needs_a_moment_among_the_nearest() -> None:
    rng = np.random.default_rng(1)
    near, far = sketch(rng, 2 * NEIGHBOURS), sketch(rng, 5) + 1000.0
    finder = ReferenceFinder(6)
    finder.add([far, near])
    assert numbers(finder, near[:4]) == [1]


def test_a_clip_of_two_kinds_of_motion_refers_to_both() -> None:
    rng = np.random.default_rng(2)
    walk, jump, other = (sketch(rng, 30, 300.0) for _ in range(3))
    finder = ReferenceFinder(2)
    finder.add([other, walk, jump])
    assert numbers(finder, np.concatenate([walk[:20], jump[:10]])) == [1, 2]


def test_the_moments_of_all_references_are_bounded() -> None:
    rng = np.random.default_rng(3)
    wanted = sketch(rng, 20)
    lengths = (MOST_MOMENTS + 50, MOST_MOMENTS - 10, 8, 5)
    candidates = [
        np.resize(wanted, (length, SKETCH_NUMBERS)) + 0.01 * n for n, length in enumerate(lengths)
    ]
    finder = ReferenceFinder(4)
    finder.add([candidate.astype(np.float32) for candidate in candidates[:1]])
    assert numbers(finder, wanted) == [0]  # one is always allowed, however long
    rest = ReferenceFinder(4)
    rest.add([candidate.astype(np.float32) for candidate in candidates[1:]])
    found = numbers(rest, wanted)
    assert found
    assert sum(lengths[1 + n] for n in found) <= MOST_MOMENTS


@pytest.mark.parametrize("empties", [0, 1, 3])
def test_nothing_to_refer_to(empties: int) -> None:
    rng = np.random.default_rng(4)
    nothing: Sketch = np.zeros((0, SKETCH_NUMBERS), np.float32)
    finder = ReferenceFinder(6)
    assert numbers(finder, sketch(rng, 5)) == []
    finder.add([nothing] * empties)
    assert numbers(finder, sketch(rng, 5)) == []
    finder.add([sketch(rng, 1)])
    assert numbers(finder, nothing) == []
    assert numbers(finder, sketch(rng, 5)) == [empties]
    assert numbers(finder, sketch(rng, 1)) == [empties]


def test_a_finder_of_no_references_finds_none() -> None:
    rng = np.random.default_rng(5)
    finder = ReferenceFinder(0)
    finder.add([sketch(rng, 5)])
    assert numbers(finder, sketch(rng, 5)) == []


def test_what_is_like_the_image_is_found_in_the_mirror() -> None:
    rng = np.random.default_rng(6)
    own, image = sketch(rng, 20, 30.0), sketch(rng, 20, 30.0)
    finder = ReferenceFinder(4)
    finder.add([sketch(rng, 20, 30.0), image, own])
    assert finder.find(own, image)[:2] == [(2, False), (1, True)]
    assert {number for number, mirrored in finder.find(image, own) if mirrored} == {2}
    assert finder.find(own, own + 1000.0)[0] == (2, False)
    assert not any(mirrored for _, mirrored in finder.find(own, own + 1000.0))


def test_a_candidate_without_an_image_is_not_found_in_the_mirror() -> None:
    rng = np.random.default_rng(7)
    own, image = sketch(rng, 20, 30.0), sketch(rng, 20, 30.0)
    finder = ReferenceFinder(2)
    finder.add([image, image + 0.5, image + 1.0], [False, True, True])
    found = [each for each in finder.find(own, image) if each.mirrored]
    assert [each.number for each in found] == [1, 2]  # and another one takes its place
