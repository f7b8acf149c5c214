"""Streams per body part: a part decodes to the same bits, and from nothing but its own bytes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from clips import (
    MARKS,
    Bench,
    Marks,
    Recipe,
    bench,
    bench_of,
    leads_among,
    random_parts,
    recipes,
    skeleton_clip,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st

from motifold.codec.blocks.motionmodel import MotionModel, fixed_model, usual_span
from motifold.codec.blocks.offered import Reference, reference_of
from motifold.codec.clip import Clip, MarkerClip, SkeletonClip
from motifold.codec.errors import ArchiveError, DamagedError
from motifold.codec.figure.bodyparts import BodyPart
from motifold.codec.figure.partial import only_parts, with_ancestors
from motifold.codec.geometry.limits import uniform_limits
from motifold.codec.version2.motiondecode import (
    Decoded,
    decode_motion,
    decode_states,
    parts_read,
)
from motifold.codec.version2.motionencode import MotionEncoder
from motifold.codec.version2.motionfile import MotionFile, pack_motion, unpack_motion
from motifold.codec.version2.motionhead import Named
from motifold.codec.version2.pieces import Pieces

Parts = frozenset[int] | None


@dataclass(frozen=True, eq=False)
class Shelved:
    """Encoded clips of one rig, of which each refers to all before it."""

    subject: Bench
    model: MotionModel
    files: tuple[bytes, ...]

    def unpacked(self, number: int) -> MotionFile:
        return unpack_motion(self.files[number])

    def references(self, number: int, parts: Parts) -> list[Reference]:
        """What a clip refers to, decoded for some parts only where that can be."""
        found = []
        for other in range(number):
            decoded = self.states(self.unpacked(other), other, parts)
            found.append(reference_of(decoded.states, decoded.nodes, self.model))
        return found

    def read(self, file: MotionFile, parts: Parts, core_only: bool = False) -> Parts:
        rig, family = self.subject.rig, self.subject.codebook.family
        return parts_read(file, rig, family, self.model, parts, core_only)

    def states(self, file: MotionFile, number: int, parts: Parts) -> Decoded:
        read = self.read(file, parts)
        rig, family = self.subject.rig, self.subject.codebook.family
        references = self.references(number, read)
        return decode_states(file, rig, family, self.model, references, parts=read)

    def clip(
        self, file: MotionFile, number: int, names: Sequence[str] | None, core_only: bool = False
    ) -> Clip:
        """The clip with ``names`` only, decoded from as little as can be."""
        rig, family = self.subject.rig, self.subject.codebook.family
        wanted = None if names is None else with_ancestors(rig.parts, rig.skeleton, names)
        read = self.read(file, None if wanted is None else frozenset(wanted), core_only)
        references = self.references(number, read)
        made = decode_motion(
            file, rig, family, self.model, references, core_only=core_only, parts=read
        )
        return only_parts(made, rig, names)


def variant(clip: Clip, seed: int) -> Clip:
    """Return the clip with other motion, some joints still, and the root too now and then.

    So the clips of a rig differ in what slides, what is still, and where their paths are.
    """
    rng = np.random.default_rng([seed, 7])
    if isinstance(clip, MarkerClip):
        return replace(clip, positions=clip.positions[::-1] + rng.normal(size=3))
    frozen = rng.random(clip.skeleton.joints) < rng.choice([0.0, 0.3, 0.8])
    rotations, translations = clip.rotations[::-1].copy(), clip.translations.copy()
    rotations[:, frozen] = rotations[:1, frozen]
    unmoved = rng.random(clip.skeleton.joints) < rng.choice([0.0, 0.5])
    translations[:, unmoved] = clip.skeleton.offsets[unmoved]
    return replace(clip, rotations=rotations, translations=translations)


def rooted(clip: Clip, seed: int) -> Clip:
    """Return a skeleton clip whose first joint stands, so that another one carries the path."""
    del seed
    assert isinstance(clip, SkeletonClip)
    translations = clip.translations.copy()
    translations[:, 0] = clip.skeleton.offsets[0]
    return replace(clip, translations=translations)


def shelved(
    recipe: Recipe | Marks,
    by_part: Sequence[bool],
    tolerance: float = 0.1,
    vary: Callable[[Clip, int], Clip] = variant,
    led: bool = False,
) -> Shelved:
    """Return clips of one rig.

    ``by_part``: which of them have streams per body part; ``led``: whether all but the first
    have leads.
    """
    subject = bench_of(recipe, False)
    rig, family = subject.rig, subject.codebook.family
    rows, span = 2 * rig.skeleton.joints, usual_span(rig.frame_time)
    model = fixed_model(rows, span, hinged=family.hinged)
    files: list[bytes] = []
    offered: list[tuple[Named, Reference]] = []
    for number, parted in enumerate(by_part):
        clip = vary(subject.clip, recipe.seed + number) if number else subject.clip
        encoder = MotionEncoder(family, model, 0, parted)
        leads = leads_among(recipe.seed, number, clip.frames) if led and number else ()
        limits = uniform_limits(clip, tolerance)
        made = encoder.encode_led(clip, rig, 12, limits, offered, leads)
        files.append(made.data)
        offered.append((Named(number), reference_of(made.states, made.nodes, model)))
    return Shelved(subject, model, tuple(files))


def assert_same(found: Clip, wanted: Clip) -> None:
    if isinstance(found, SkeletonClip):
        assert isinstance(wanted, SkeletonClip)
        np.testing.assert_array_equal(found.rotations, wanted.rotations)
        np.testing.assert_array_equal(found.translations, wanted.translations)
    else:
        assert isinstance(wanted, MarkerClip)
        np.testing.assert_array_equal(found.positions, wanted.positions)


def some_names(subject: Bench, data: st.DataObject) -> list[str]:
    names = [part.name for part in subject.rig.parts]
    return data.draw(st.lists(st.sampled_from(names), max_size=2, unique=True))


FLAGS = st.lists(st.booleans(), min_size=3, max_size=3)


@given(st.one_of(recipes(12, 40), MARKS), FLAGS, st.booleans(), st.booleans(), st.data())
@settings(max_examples=80)
@example(Recipe(3, joints=9, frames=0), [True] * 3, False, False, None)
@example(Recipe(3, joints=9, frames=30, hinges=0.6, stretchy=0.6), [True] * 3, False, False, None)
@example(
    Recipe(4, joints=12, frames=30, hinges=0.3, stretchy=1.0),
    [False, True, True],
    False,
    True,
    None,
)
def test_some_parts_decode_to_the_same_bits(
    recipe: Recipe | Marks,
    by_part: list[bool],
    preview: bool,
    led: bool,
    data: st.DataObject | None,
) -> None:
    made = shelved(recipe, by_part, led=led)
    file = made.unpacked(2)
    choices = (
        [some_names(made.subject, data)] if data else [[p.name] for p in made.subject.rig.parts]
    )
    whole = made.clip(file, 2, None, preview)
    for names in choices:
        assert_same(made.clip(file, 2, names, preview), only_parts(whole, made.subject.rig, names))


def test_what_the_core_recalls_is_decoded_of_references_too() -> None:
    """Of a clip's references, another joint may carry the path: the clip's own is in a part."""
    made = shelved(Recipe(20, joints=9, tree="star", stretchy=1.0), [True] * 2, 0.1, rooted)
    rig, file = made.subject.rig, made.unpacked(1)
    heads = [made.states(made.unpacked(number), number, None).head for number in (0, 1)]
    assert [head.sliding[0] for head in heads] == [0, 1]
    whole = made.clip(file, 1, None)
    for part in rig.parts:
        assert_same(made.clip(file, 1, [part.name]), only_parts(whole, rig, [part.name]))


@given(st.one_of(recipes(12, 40), MARKS), FLAGS)
@settings(max_examples=20)
def test_streams_change_no_decoded_bit(recipe: Recipe | Marks, by_part: list[bool]) -> None:
    """The encoder sees the same whatever streams it writes."""
    one, several = shelved(recipe, [False] * 3), shelved(recipe, by_part)
    for number, (plain, parted) in enumerate(zip(one.files, several.files, strict=True)):
        found = [
            made.clip(unpack_motion(data), number, None)
            for made, data in ((one, plain), (several, parted))
        ]
        assert_same(*found)
        assert unpack_motion(plain).certificate == unpack_motion(parted).certificate
        if not by_part[number] or len(one.subject.rig.parts) == 1:
            assert plain == parted


@pytest.mark.parametrize(
    "recipe",
    [Recipe(20, joints=9, frames=30, tree="star"), Marks(5, 9, 30, 0.1, "smooth")],
    ids=str,
)
def test_a_part_needs_no_byte_of_the_others(recipe: Recipe | Marks) -> None:
    """A changed byte is told where its stream is needed, and changes nothing elsewhere."""
    made = shelved(recipe, [True] * 3, 0.5)
    rig, data = made.subject.rig, made.files[2]
    whole = made.clip(made.unpacked(2), 2, None)
    rests = unpack_motion(data, piecewise=True).rests
    assert isinstance(rests, Pieces)
    spans = [range(piece.start, piece.stop) for piece in rests.where]
    owner = {byte: part for part, span in enumerate(spans) for byte in span}
    hurt = unhurt = 0
    for place in range(len(data)):
        wrong = bytearray(data)
        wrong[place] ^= 1 << place % 8
        with pytest.raises(ArchiveError):
            unpack_motion(bytes(wrong))
        if place in (5, 6):  # the checksum of all streams, for those who read them all
            continue
        if place not in owner:
            with pytest.raises(ArchiveError):
                unpack_motion(bytes(wrong), piecewise=True)
            continue
        file = unpack_motion(bytes(wrong), piecewise=True)
        part = place % len(rig.parts)
        names, read = [rig.parts[part].name], made.read(file, frozenset([part]))
        assert read is not None
        if owner[place] in read:
            hurt += 1
            with pytest.raises(DamagedError, match="checksum of a stream"):
                made.clip(file, 2, names)
        else:
            unhurt += 1
            assert_same(made.clip(file, 2, names), only_parts(whole, rig, names))
    assert hurt > 20
    assert unhurt > 20


def destroyed(file: MotionFile, run: int, parts: set[int]) -> MotionFile:
    """Return a file of which one run's core, the head and some parts' streams are left.

    Of a file without streams per part, the run's rest is.
    """
    assert file.rests is not None
    rng = np.random.default_rng(run)
    kept = {run * file.streams + part for part in parts} if file.streams > 1 else {run}
    return replace(
        file,
        cores=[core if n in (0, run) else rng.bytes(50) for n, core in enumerate(file.cores)],
        rests=[rest if n in kept else rng.bytes(50) for n, rest in enumerate(file.rests)],
    )


@pytest.mark.parametrize("by_part", [False, True])
def test_a_time_range_needs_the_runs_that_it_touches(by_part: bool) -> None:
    clip = skeleton_clip(Recipe(5, joints=5, frames=2300, rate=120.0))
    subject = bench(clip, random_parts(5, 5))
    rig, family = subject.rig, subject.codebook.family
    assert len(rig.parts) > 1
    model = fixed_model(10, usual_span(rig.frame_time), hinged=family.hinged)
    made = MotionEncoder(family, model, 0, by_part).encode(clip, rig, 0, uniform_limits(clip, 1.0))
    file = unpack_motion(made.data)
    known = (rig, family, model, ())
    whole = decode_motion(file, *known)
    name = rig.parts[-1].name
    above = with_ancestors(rig.parts, rig.skeleton, [name])
    read = parts_read(file, rig, family, model, above)
    assert (read is not None) == by_part
    for run, (start, stop) in enumerate([(3, 900), (1024, 2048), (2100, 2300)]):
        left = destroyed(file, run, set(range(len(rig.parts))))
        cut = decode_motion(left, *known, start=start, stop=stop)
        assert_same(cut.slice(start, stop), whole.slice(start, stop))
        left = destroyed(file, run, set(read or ()))
        cut = decode_motion(left, *known, start=start, stop=stop, parts=read)
        assert_same(
            only_parts(cut.slice(start, stop), rig, [name]),
            only_parts(whole.slice(start, stop), rig, [name]),
        )
    with pytest.raises(DamagedError):
        decode_motion(destroyed(file, 0, set()), *known)


def test_other_numbers_of_streams_than_of_parts_are_damage() -> None:
    made = shelved(Recipe(20, joints=9, frames=30, tree="star"), [True])
    file = made.unpacked(0)
    parts = len(made.subject.rig.parts)
    for streams in (2, parts - 1, parts + 1):
        rests = tuple(file.rests or ())[:1] * streams
        wrong = unpack_motion(pack_motion(replace(file, streams=streams, rests=rests)))
        with pytest.raises(DamagedError, match=f"{streams} streams a run for {parts} body parts"):
            made.clip(wrong, 0, None)


def test_a_rig_of_one_part_is_written_as_ever() -> None:
    clip = skeleton_clip(Recipe(1, joints=4, frames=20))
    subject = bench(clip, (BodyPart("root", (0, 1, 2, 3), -1, 0),))
    family = subject.codebook.family
    model = fixed_model(8, 4, hinged=family.hinged)
    limits = uniform_limits(clip, 0.1)
    plain, parted = (
        MotionEncoder(family, model, 0, by_part).encode(clip, subject.rig, 0, limits)
        for by_part in (False, True)
    )
    assert plain.data == parted.data
