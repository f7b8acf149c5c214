"""Landmarks: a copy of a clip has those of the clip, wherever it was cut."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from clips import Marks, bench_of, every_second, family_of, noisy
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.clip import SkeletonClip
from motifold.codec.figure.bodyparts import body_parts
from motifold.codec.figure.rig import rig_of
from motifold.codec.geometry.limits import uniform_limits
from motifold.codec.learned.landmarks import NUMBERS, Landmarks, landmarks_of
from motifold.codec.version2.motiongoal import goal_of
from motifold.pipeline.copies import HIGHEST_LEVEL, Copy, after_originals, find_copies
from motifold.workflows.synthetic import ACTIONS, synthetic_clip


@cache
def take(action: str = "walk", number: int = 1) -> SkeletonClip:
    return synthetic_clip(7, action, 1, "normal", number, seconds=6.0)


def seen(clip: SkeletonClip) -> Landmarks:
    rig = rig_of(clip, body_parts(clip.skeleton))
    goal = goal_of(clip, rig, family_of(clip, rig), uniform_limits(clip, 0.1))
    return landmarks_of(goal.path, goal.nodes, rig)


@pytest.mark.parametrize("action", ACTIONS)
@given(first=st.integers(0, 90), frames=st.integers(60, 120))
@settings(max_examples=8, deadline=None)
def test_an_excerpt_has_the_landmarks_of_its_frames(action: str, first: int, frames: int) -> None:
    whole, cut = seen(take(action)), seen(take(action).slice(first, first + frames))
    inside = np.isin(whole.frames - first, cut.frames)
    assert set(cut.frames + first) <= set(whole.frames)
    np.testing.assert_allclose(whole.poses[inside], cut.poses, atol=1e-3)
    assert cut.length == min(frames, take(action).frames - first)


def test_a_clip_of_any_length_has_landmarks_or_none() -> None:
    for frames in (0, 1, 2, 5, 11):
        found = seen(take().slice(0, frames))
        assert found.poses.shape == (len(found.frames), NUMBERS)
    still = take().slice(0, 1)
    frozen = replace(
        still,
        rotations=np.repeat(still.rotations, 50, axis=0),
        translations=np.repeat(still.translations, 50, axis=0),
    )
    assert len(seen(frozen).frames) == 0  # nothing happens


def test_markers_have_landmarks() -> None:
    subject = bench_of(Marks(3, 9, 200, 0.1, "smooth"), False)
    clip = subject.clip
    goal = goal_of(clip, subject.rig, subject.codebook.family, uniform_limits(clip, 0.1))
    assert len(landmarks_of(goal.path, goal.nodes, subject.rig).frames) > 3


def others() -> list[SkeletonClip]:
    return [take(action, number) for action in ACTIONS for number in (1, 2, 3)]


KINDS = {
    "excerpt": (take().slice(41, 147), 41, 1),
    "half the rate": (every_second(take()), 0, 2),
    "noise": (noisy(take(), 0.2), 0, 1),
}


@pytest.mark.parametrize("kind", KINDS)
def test_copies_are_found_among_others(kind: str) -> None:
    """And nothing else is taken for one."""
    copy, shift, stride = KINDS[kind]
    clips = [*map(seen, others()), seen(copy)]
    original = 3 * [*ACTIONS].index("walk")
    found = find_copies(clips)
    assert found[-1][0].original == original
    assert abs(found[-1][0].shift - shift) <= stride
    assert found[-1][0].stride == stride
    assert not any(found[:-1])
    archived = find_copies([clips[-1], *clips[:-1]], 1)  # the copy came first
    if stride == 1:
        assert [each.original for each in archived[1 + original]] == [0]
    assert not any(each for at, each in enumerate(archived) if at != 1 + original)


def test_the_longer_one_is_the_original() -> None:
    long, short = seen(take()), seen(take().slice(20, 150))
    assert find_copies([short, long]) == [[Copy(1, 20, 1)], []]
    assert find_copies([long, short]) == [[], [Copy(0, 20, 1)]]
    assert find_copies([]) == []
    assert find_copies([long]) == [[]]


NAMES = st.sampled_from([f"clip {number}" for number in range(12)])


@given(
    st.dictionaries(NAMES, st.integers(0, 3), min_size=1),
    st.lists(st.tuples(NAMES, NAMES), max_size=20),
)
def test_originals_come_first(levels: dict[str, int], pairs: list[tuple[str, str]]) -> None:
    """As far as levels go; longer chains of copies end somewhere."""
    originals: dict[str, list[str | int]] = {name: [] for name in levels}
    for one, other in pairs:
        first, second = sorted((one, other))  # no circles
        if first in levels and second in levels and first != second:
            originals[second].append(first)
    found = after_originals(levels, originals)
    assert set(found) == set(levels)
    for name, level in found.items():
        assert levels[name] <= level <= HIGHEST_LEVEL
        wished = 1 + max((found[each] for each in originals[name]), default=-1)  # type: ignore[index]
        assert level >= wished or wished > HIGHEST_LEVEL
        assert level in (levels[name], wished) or wished > HIGHEST_LEVEL


def test_an_image_with_two_landmarks_is_found_by_them() -> None:
    """A clip may have more landmarks than its image, which is what is laid beside others."""
    rng = np.random.default_rng(8)

    def some(frames: list[int]) -> Landmarks:
        poses = 90.0 * rng.normal(size=(len(frames), NUMBERS))
        return Landmarks(np.array(frames), poses.astype(np.float32), 100, 1 / 30)

    original, copy = some([20, 60]), some([10, 30, 50, 70, 90])
    assert find_copies([original, copy], 1, [original]) == [[], [Copy(0, 0, 1, True)]]
    assert find_copies([original, copy], 1) == [[], []]
