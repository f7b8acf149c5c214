"""Gap masks survive as runs, and gaps are bridged as said."""

from __future__ import annotations

import numpy as np
from clips import marker_clip
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from motifold.codec.clip import BoolArray
from motifold.codec.geometry.gaps import filled, from_runs, to_runs

MASKS = st.tuples(st.integers(0, 12), st.integers(0, 4)).flatmap(
    lambda shape: arrays(np.bool_, shape)
)


@given(MASKS)
def test_masks_survive_as_runs(seen: BoolArray) -> None:
    runs = to_runs(seen)
    assert np.array_equal(from_runs(runs, len(seen)), seen)
    assert all((np.diff(turns) > 0).all() for turns in runs)
    for marker, turns in enumerate(runs):
        state, expected = True, []
        for frame in range(len(seen)):
            if seen[frame, marker] != state:
                state = not state
                expected.append(frame)
        assert turns.tolist() == expected


@given(st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_gaps_are_bridged_in_straight_lines(seed: int, frames: int) -> None:
    clip = marker_clip(seed, 6, frames, gaps=0.5)
    full = filled(clip.positions)
    assert not np.isnan(full).any()
    assert np.array_equal(full[clip.seen], clip.positions[clip.seen])
    for marker in range(6):
        known = np.flatnonzero(clip.seen[:, marker])
        for frame in np.flatnonzero(~clip.seen[:, marker]):
            before, after = known[known < frame], known[known > frame]
            if not len(known):
                expected = np.zeros(3)
            elif not len(before):
                expected = full[after[0], marker]
            elif not len(after):
                expected = full[before[-1], marker]
            else:
                a, b = before[-1], after[0]
                share = (frame - a) / (b - a)
                expected = full[a, marker] * (1 - share) + full[b, marker] * share
            assert np.allclose(full[frame, marker], expected, atol=1e-9)


def test_the_clip_itself_is_left_alone() -> None:
    clip = marker_clip(1, 4, 20, gaps=0.6)
    before = clip.positions.copy()
    filled(clip.positions)
    assert np.array_equal(clip.positions, before, equal_nan=True)
