"""The head of an index file: references, joints that are still or slide, and gaps come back."""

from __future__ import annotations

import contextlib
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from clips import Recipe, leads_among, marker_clip, random_parts, skeleton_clip
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.clip import BoolArray
from motifold.codec.errors import DamagedError
from motifold.codec.figure.rig import Rig, rig_of
from motifold.codec.geometry.metrics import Errors
from motifold.codec.streams.entropy import SymbolReader, SymbolWriter
from motifold.codec.version2.motionfile import MotionFile
from motifold.codec.version2.motionhead import (
    MOST_REFERENCES,
    Head,
    Named,
    read_head,
    read_leads,
    read_references,
    write_head,
)

JOINTS = 12
NUMBERS = st.one_of(st.integers(0, 30), st.integers(0, 2**40))


def named(mirrors: st.SearchStrategy[bool]) -> st.SearchStrategy[tuple[Named, ...]]:
    """References of a head, in order."""
    each = st.builds(Named, NUMBERS, mirrors)
    chosen = st.lists(each, max_size=MOST_REFERENCES, unique=True)
    return chosen.map(lambda found: tuple(sorted(found)))


REFERENCES = named(st.just(False))


def skeleton_rig(seed: int = 0) -> Rig:
    """A rig of which some joints have position channels."""
    clip = skeleton_clip(Recipe(seed=seed, joints=JOINTS, frames=0, stretchy=0.5))
    return rig_of(clip, random_parts(seed, JOINTS))


def marker_rig(markers: int) -> Rig:
    return rig_of(marker_clip(0, markers, 0), random_parts(0, markers, first_at_root=False))


def movable(rig: Rig) -> list[int]:
    """Joints with position channels."""
    return [joint for joint, names in enumerate(rig.layout.channels) if "Xposition" in names]


def parts_of(head: Head) -> tuple[object, ...]:
    """A skeleton clip's head, to compare."""
    assert head.seen is None
    return head.references, head.still, head.sliding


def written(head: Head, rig: Rig, still: tuple[int, ...], sliding: tuple[int, ...]) -> bytes:
    writer = SymbolWriter()
    write_head(writer, head, rig, still, sliding)
    return writer.to_bytes()


def read(
    data: bytes, rig: Rig, frames: int, still: tuple[int, ...], sliding: tuple[int, ...]
) -> Head:
    return read_head(SymbolReader(data), rig, frames, still, sliding)


def of_core(core: bytes, frames: int = 9, *, mirrored: bool = False) -> MotionFile:
    """An index file with that core."""
    return MotionFile(0, 0, frames, 0, Errors(0.0, 0.0, 0.0), (core,), (), mirrored=mirrored)


def subsets(joints: list[int]) -> st.SearchStrategy[tuple[int, ...]]:
    if not joints:
        return st.just(())
    return st.sets(st.sampled_from(joints)).map(lambda chosen: tuple(sorted(chosen)))


@given(st.integers(0, 20), REFERENCES, st.data())
def test_heads_of_skeletons_come_back(
    seed: int, references: tuple[Named, ...], data: st.DataObject
) -> None:
    """Whatever the model says of most clips, be it of joints that this rig cannot move."""
    rig = skeleton_rig(seed)
    every = subsets(list(range(JOINTS)))
    usual_still, usual_sliding = data.draw(every), data.draw(every)
    sliding = data.draw(subsets(movable(rig)))
    head = Head(references, data.draw(every), sliding, None)
    coded = written(head, rig, usual_still, usual_sliding)
    assert parts_of(read(coded, rig, 100, usual_still, usual_sliding)) == parts_of(head)
    assert read_references(of_core(coded)) == references


@given(
    st.integers(0, 2**32 - 1),
    st.integers(1, 12),
    st.integers(0, 60),
    st.sampled_from([0.0, 0.3, 0.9]),
    REFERENCES,
)
def test_heads_of_markers_come_back(
    seed: int, markers: int, frames: int, gaps: float, references: tuple[Named, ...]
) -> None:
    clip = marker_clip(seed, markers, frames, gaps)
    coded = written(Head(references, (), (), clip.seen), marker_rig(markers), (), ())
    head = read(coded, marker_rig(markers), frames, (), ())
    assert head.references == references == read_references(of_core(coded))
    assert head.seen is not None
    assert np.array_equal(head.seen, clip.seen)
    assert (head.still, head.sliding) == ((), ())


@given(st.integers(0, 2**32 - 1), REFERENCES.filter(len), st.integers(1, 5000), st.booleans())
def test_leads_come_back(
    seed: int, references: tuple[Named, ...], frames: int, skeleton: bool
) -> None:
    leads = leads_among(seed, len(references), frames)
    rig = skeleton_rig(3) if skeleton else marker_rig(5)
    seen = None if skeleton else marker_clip(seed, 5, frames, 0.1).seen
    coded = written(Head(references, (), (), seen, (), leads), rig, (), ())
    found = read_head(SymbolReader(coded), rig, frames, (), (), True)
    assert (found.references, found.leads) == (references, leads)
    assert read_references(of_core(coded)) == references
    with pytest.raises(DamagedError, match="lead"):  # not of this clip
        read_head(SymbolReader(coded), rig, leads[-1].stop - 1, (), (), True)


@given(
    st.integers(0, 2**32 - 1),
    named(st.booleans()).filter(lambda found: any(each.mirrored for each in found)),
    st.integers(1, 5000),
    st.booleans(),
)
def test_mirror_images_come_back_with_leads_or_without(
    seed: int, references: tuple[Named, ...], frames: int, led: bool
) -> None:
    leads = leads_among(seed, len(references), frames) if led else ()
    rig = skeleton_rig(3)
    head = Head(references, (1, 4), (), None, (), leads)
    assert head.mirrored
    coded = written(head, rig, (), ())
    found = read_head(SymbolReader(coded), rig, frames, (), (), False, True)
    assert (found.references, found.leads) == (references, leads)
    assert parts_of(found) == parts_of(head)
    file = of_core(coded, frames, mirrored=True)
    assert (read_references(file), read_leads(file)) == (references, leads)


@given(st.binary(max_size=80), st.integers(0, 10**4))
def test_leads_of_any_bytes_are_inside_the_clip_or_damage(data: bytes, frames: int) -> None:
    with contextlib.suppress(DamagedError):
        head = read_head(SymbolReader(data), skeleton_rig(1), frames, (), (), True)
        assert head.leads
        assert all(0 <= lead.first < lead.stop <= frames for lead in head.leads)
        assert all(one.stop <= two.first for one, two in pairwise(head.leads))
        assert all(lead.reference < len(head.references) for lead in head.leads)


def test_masks_of_noise_come_back() -> None:
    rng = np.random.default_rng(0)
    for share in (0.0, 0.01, 0.5, 0.99, 1.0):
        seen: BoolArray = rng.random((200, 7)) < share
        coded = written(Head((), (), (), seen), marker_rig(7), (), ())
        found = read(coded, marker_rig(7), 200, (), ()).seen
        assert found is not None
        assert np.array_equal(found, seen)


def test_what_is_as_usual_costs_next_to_nothing() -> None:
    rig = skeleton_rig(0)
    usual, sliding = tuple(range(2, JOINTS)), tuple(movable(rig))
    coded = written(Head((), usual, sliding, None), rig, usual, sliding)
    other = written(Head((), (), (), None), rig, usual, sliding)
    assert len(coded) <= 4 < len(other)


def test_gaps_may_not_outlast_the_clip() -> None:
    seen = np.ones((50, 2), bool)
    seen[40:45] = False
    coded = written(Head((), (), (), seen), marker_rig(2), (), ())
    for frames in (45, 30, 1, 0):
        with pytest.raises(DamagedError):
            read(coded, marker_rig(2), frames, (), ())


@pytest.mark.parametrize("count", [MOST_REFERENCES + 1, 10**9, 2**48 - 2])
def test_hosts_of_references_are_refused(count: int) -> None:
    writer = SymbolWriter()
    writer.number(count)
    began = time.perf_counter()
    with pytest.raises(DamagedError, match="references"):
        read_references(of_core(writer.to_bytes()))
    assert time.perf_counter() - began < 0.5


@given(st.binary(max_size=80), st.integers(0, 10**4))
def test_any_bytes_are_a_head_or_damage(data: bytes, frames: int) -> None:
    with contextlib.suppress(DamagedError):
        references = read_references(of_core(data))
        assert sorted(set(references)) == list(references)
        assert len(references) <= MOST_REFERENCES
    rig = skeleton_rig(1)
    with contextlib.suppress(DamagedError):
        head = read(data, rig, frames, (1, 2), (0,))
        assert set(head.still) <= set(range(JOINTS))
        assert set(head.sliding) <= set(movable(rig))
    with contextlib.suppress(DamagedError):
        seen = read(data, marker_rig(5), frames, (), ()).seen
        assert seen is not None
        assert seen.shape == (frames, 5)


def test_a_rig_without_channels_may_move_any_joint() -> None:
    rig = skeleton_rig(0)
    free = replace(rig, layout=replace(rig.layout, channels=()))
    head = Head((Named(4),), (1,), tuple(range(JOINTS)), None)
    found = read(written(head, free, (), ()), free, 9, (), ())
    assert parts_of(found) == parts_of(head)
