"""The two coded layers give back what they were given, or say that they are damaged."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from clips import Bench, Recipe, marker_bench, skeleton_bench
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.clip import MarkerClip
from motifold.codec.errors import DamagedError
from motifold.codec.figure.sliding import can_slide
from motifold.codec.patterns.patterns import no_patterns
from motifold.codec.patterns.signals import Frame, part_channels
from motifold.codec.streams.entropy import SymbolWriter
from motifold.codec.streams.envelope import check_room
from motifold.codec.version1.layers import (
    PartIndex,
    Preview,
    group_channels,
    part_starts,
    predicted,
    read_preview,
    read_rest,
    unpredicted,
    write_preview,
    write_rest,
)

LONGEST = 48
SEEDS = st.integers(0, 2**32 - 1)


def random_index(rng: np.random.Generator, frames: int, known: int) -> PartIndex:
    borders = [0]
    while borders[-1] < frames:
        borders.append(min(borders[-1] + int(rng.integers(1, LONGEST + 1)), frames))
    patterns = rng.integers(-1, known, len(borders) - 1)
    predicts = (rng.random(len(patterns)) < 0.5) & (patterns >= 0)
    return PartIndex(np.array(borders), patterns, predicts)


def random_preview(bench: Bench, seed: int, frames: int) -> Preview:
    rng = np.random.default_rng(seed)
    parts = bench.codebook.family.parts
    joints = bench.rig.skeleton.joints
    frame, seen = None, None
    if isinstance(bench.clip, MarkerClip):
        seen = rng.random((frames, joints)) < rng.choice([0.1, 0.9, 1.0])
    else:
        changes = rng.random((frames, joints)) < 0.1
        bases = np.cumsum(changes, axis=0) * 7 % 24 * (rng.random(joints) < 0.3)
        chosen = tuple(joint for joint in can_slide(bench.rig) if rng.random() < 0.5)
        frame = Frame(bases.astype(np.int64), chosen)
    indices = tuple(
        None if part.parent < 0 else random_index(rng, frames, len(patterns))
        for part, patterns in zip(parts, bench.codebook.patterns, strict=True)
    )
    return Preview(frame, seen, indices, tuple(rng.integers(1, 3, len(parts)).tolist()))


def assert_same(first: Preview, second: Preview) -> None:
    if first.frame is not None:
        assert second.frame is not None
        assert np.array_equal(first.frame.bases, second.frame.bases)
        assert first.frame.sliding == second.frame.sliding
    if first.seen is not None:
        assert second.seen is not None
        assert np.array_equal(first.seen, second.seen)
    assert first.orders == second.orders
    for one, other in zip(first.parts, second.parts, strict=True):
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            assert np.array_equal(one.borders, other.borders)
            assert np.array_equal(one.patterns, other.patterns)
            assert np.array_equal(one.predicts, other.predicts)


@given(SEEDS, st.booleans(), st.sampled_from([0, 1, 2, 9, 100]), st.sampled_from([0, 1, 5, 70_000]))
@settings(max_examples=60, deadline=None)
def test_previews_come_back(seed: int, markers: bool, frames: int, known: int) -> None:
    if markers:
        bench = marker_bench(seed, 8, 2)
    else:
        bench = skeleton_bench(Recipe(seed, joints=8, frames=2, stretchy=0.5))
    tables = tuple(  # as large as ``known``, without the memory
        np.broadcast_to(np.int16(0), (known if part.parent >= 0 else 0, *no.shape[1:]))
        for part in bench.codebook.family.parts
        for no in [no_patterns(part)]
    )
    bench = replace(bench, codebook=replace(bench.codebook, patterns=tables))
    preview = random_preview(bench, seed, frames)
    width = part_channels(bench.codebook.family.parts[0], preview.frame)
    root = np.random.default_rng(seed).integers(-100, 100, (frames, width))
    data = write_preview(bench.rig, bench.codebook, preview, LONGEST, root)
    back, left = read_preview(data, bench.rig, bench.codebook, frames, LONGEST)
    assert_same(preview, back)
    assert np.array_equal(left, root)


@given(SEEDS, st.integers(0, 40), st.lists(st.integers(0, 4), max_size=5))
@settings(max_examples=60, deadline=None)
def test_the_rest_comes_back(seed: int, frames: int, thirds: list[int]) -> None:
    rng = np.random.default_rng(seed)
    channels = [3 * third for third in thirds]
    left = [rng.integers(-500, 500, (frames, count)) for count in channels]
    back = read_rest(write_rest(left), frames, channels)
    assert len(back) == len(left)
    assert all(np.array_equal(a, b) for a, b in zip(back, left, strict=True))


@given(SEEDS, st.sampled_from([1, 2]), st.integers(0, 60))
@settings(max_examples=60, deadline=None)
def test_unpredicted_inverts_predicted(seed: int, order: int, frames: int) -> None:
    """With patterns that use some segments, bases that change, and sliding joints behind."""
    rng = np.random.default_rng(seed)
    bench = skeleton_bench(Recipe(seed, joints=8, frames=2, stretchy=1.0))
    preview = random_preview(bench, seed, frames)
    assert preview.frame is not None
    for part in bench.codebook.family.parts:
        width = part_channels(part, preview.frame)
        values = rng.integers(-(2**40), 2**40, (frames, width))
        course = rng.integers(-1000, 1000, (frames, 3 * len(part.joints)))
        starts = part_starts(preview, part.joints, width)
        index = random_index(rng, frames, 4)
        plain = predicted(values, None, None, starts, order)
        assert np.array_equal(unpredicted(plain, None, None, starts, order), values)
        left = predicted(values, course, index, starts, order)
        assert np.array_equal(unpredicted(left, course, index, starts, order), values)


def test_runs_start_where_bases_change() -> None:
    bench = skeleton_bench(Recipe(1, joints=3, frames=2, stretchy=1.0))
    bases = np.array([[0, 1, 0], [0, 1, 2], [0, 3, 2]])
    preview = Preview(Frame(bases, (0, 1, 2)), None, (), ())
    starts = part_starts(preview, (1, 2), 12)
    assert starts[0].all()
    assert starts[1].tolist() == [False] * 3 + [True] * 3 + [False] * 6
    assert starts[2].tolist() == [True] * 3 + [False] * 3 + [False] * 6
    assert bench.rig.kind == "skeleton"


def test_joints_that_can_slide_have_position_channels() -> None:
    rig = skeleton_bench(Recipe(1, joints=3)).rig
    channels = (("Xposition", "Zrotation"), ("Zrotation",), ("Yposition",))
    assert can_slide(replace(rig, layout=replace(rig.layout, channels=channels))) == [0, 2]
    assert can_slide(replace(rig, layout=replace(rig.layout, channels=()))) == [0, 1, 2]


def test_groups_are_the_parts_channels() -> None:
    bench = skeleton_bench(Recipe(5, joints=10, frames=2, stretchy=1.0))
    frame = Frame(np.zeros((2, 10), np.int64), tuple(range(10)))
    assert group_channels(bench.codebook, frame) == [6 * len(p.joints) for p in bench.rig.parts]
    assert group_channels(bench.codebook, None) == [3 * len(p.joints) for p in bench.rig.parts]


def test_claims_that_bytes_cannot_hold_are_refused() -> None:
    check_room(0, 10**9, 0)
    check_room(1000, 3, 100)
    with pytest.raises(DamagedError, match="claims 100000000 frames"):
        check_room(10**8, 3, 10_000)


def preview_damage(
    match: str, bench: Bench, frames: int, *calls: tuple[str, tuple[Any, ...]]
) -> None:
    """Read a preview made by these calls; it must be refused in these words."""
    writer = SymbolWriter()
    for name, arguments in calls:
        getattr(writer, name)(*arguments)
    with pytest.raises(DamagedError, match=match):
        read_preview(writer.to_words(), bench.rig, bench.codebook, frames, LONGEST)


def test_previews_that_contradict_themselves_are_damage() -> None:
    markers = marker_bench(11, 2, 4)
    gap = ("uniform", ([1], 2))
    preview_damage("more gaps than there are frames", markers, 4, gap, ("number", (5,)))
    late = gap, ("number", (1,)), ("number", (4,))
    preview_damage("gap after the last frame", markers, 4, *late)
    later = gap, ("number", (2,)), ("number", (2**47,)), ("number", (2**47,))
    preview_damage("gap after the last frame", markers, 4, *later)
    body = skeleton_bench(Recipe(1, joints=2, frames=4))
    slides = still(body)
    preview_damage("names 3 turned joints of 2", body, 4, slides, ("number", (3,)))
    often = slides, ("number", (1,)), ("uniform", ([0], 2)), ("number", (4,))
    preview_damage("changes its base more often", body, 4, *often)
    split = skeleton_bench(Recipe(2, joints=6, frames=4))
    assert len(split.rig.parts) > 1
    long = still(split), ("number", (0,)), ("uniform", ([4], LONGEST))
    preview_damage("goes on after the last frame", split, 4, *long)


def still(subject: Bench) -> tuple[str, tuple[Any, ...]]:
    """The call that writes that no joint slides."""
    return "differences", (np.zeros(len(can_slide(subject.rig)), np.int64), 1)


@given(SEEDS, st.booleans(), st.integers(0, 300))
@settings(max_examples=60, deadline=None)
def test_any_bytes_are_a_preview_or_damage(seed: int, markers: bool, size: int) -> None:
    bench = marker_bench(1, 8, 2) if markers else skeleton_bench(Recipe(1, joints=8, frames=2))
    data = np.random.default_rng(seed).integers(0, 256, size, np.uint8).tobytes()
    try:
        preview, _ = read_preview(data, bench.rig, bench.codebook, 30, LONGEST)
    except DamagedError:
        return
    for index in preview.parts:
        assert index is None or index.borders[-1] == 30
