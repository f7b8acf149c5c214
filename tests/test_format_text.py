"""`docs/format.md` is enough to decode versions 2 to 5: a decoder made from it finds the same.

The oracle (`oracle_motion` and what it imports) was written from the text alone, in plain Python.
It decodes the frozen archive, replaced clips too, and clips made here with all that the frozen
archive lacks: joints that stand still, wide numbers, long blocks, learned bases. Nothing may
differ by a bit.
"""

from __future__ import annotations

import ast
import itertools
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clips import MARKS, Marks, Recipe, bench_of, leads_among, recipes
from hypothesis import example, given, settings
from hypothesis import strategies as st
from oracle_model import Model, fixed_model, read_model
from oracle_motion import Decoded, Header, OracleArchive, decode_file, read_header
from oracle_stream import SymbolReader, counted, signed

from motifold.codec.blocks import motionmodel
from motifold.codec.blocks.leads import Lead
from motifold.codec.blocks.mirrored import image_of
from motifold.codec.blocks.motionmodel import MotionModel, usual_span
from motifold.codec.blocks.offered import Reference, reference_of
from motifold.codec.geometry.limits import uniform_limits
from motifold.codec.learned.modelfile import write_model
from motifold.codec.streams.entropy import SymbolWriter
from motifold.codec.streams.sizeclasses import class_counts, class_shifts
from motifold.codec.version2 import motiondecode
from motifold.codec.version2.motiondecode import decode_states
from motifold.codec.version2.motionencode import MotionEncoder
from motifold.codec.version2.motionfile import MotionFile, unpack_motion
from motifold.codec.version2.motionhead import Named
from motifold.pipeline import Archive
from motifold.pipeline.indexreader import read_index
from motifold.pipeline.layout import index_path
from motifold.pipeline.shelf import Found

FIXTURES = Path(__file__).parent / "fixtures"
CLIPS = {2: 23, 3: 23, 4: 34, 5: 40}  # by version, of both jobs, replaced ones too
FAR = 70_000  # number of a clip that takes more than 16 bits


@pytest.fixture(scope="module", params=CLIPS)
def version(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture(scope="module")
def frozen(version: int) -> OracleArchive:
    return OracleArchive(FIXTURES / f"v{version}" / "archive")


@pytest.fixture(scope="module")
def archive(version: int) -> Iterator[Archive]:
    with Archive(FIXTURES / f"v{version}" / "archive") as opened:
        yield opened


def assert_header(header: Header, file: MotionFile) -> None:
    certificate = file.certificate
    assert header == Header(
        file.rig,
        file.generation,
        file.frames,
        file.step_code,
        (certificate.maximum, certificate.mean, certificate.percentile_99),
        list(file.cores),
        [list(file.rests_of(run) or ()) for run in range(-(-file.frames // 1024))],
        file.led,
        file.mirrored,
    )


def assert_same(found: Decoded, wanted: motiondecode.Decoded) -> None:
    head = wanted.head
    named = zip(found.head.references, found.head.images, strict=True)
    assert tuple(itertools.starmap(Named, named)) == head.references
    assert found.head.still == set(head.still)
    assert tuple(found.head.sliding) == head.sliding
    assert found.head.fineness == list(head.fines or [0] * wanted.nodes.count)
    if head.seen is not None:
        seen = np.ones(head.seen.shape, bool)
        for marker, turns in enumerate(found.head.gaps):
            for turn in turns:
                seen[turn:, marker] ^= True
        assert (seen == head.seen).all()
    assert len(found.runs) == len(wanted.states)
    for run, (ours, theirs) in enumerate(zip(found.runs, wanted.states, strict=True)):
        differ = np.argwhere((np.array(ours).reshape(theirs.shape) != theirs).any(axis=-1))
        assert len(differ) == 0, f"run {run}, first at frame, node {differ[0]}"


@pytest.mark.parametrize("share", range(8))
def test_the_frozen_clips_decode_from_the_text(
    share: int, frozen: OracleArchive, archive: Archive
) -> None:
    for number in range(share, len(archive.numbered), 8):
        found, row = frozen.clip(number), archive.numbered[number]
        path = index_path(frozen.folder, row.index)
        file = read_index(path)
        assert isinstance(file, MotionFile)
        assert_header(found.header, file)
        assert (frozen.names[number], found.header.frames) == (row.name, row.frames)
        assert_same(found, archive.shelf.states(Found(file, archive.rig(row.rig), path)))


def test_the_frozen_archive_has_all_kinds(
    frozen: OracleArchive, archive: Archive, version: int
) -> None:
    assert len(archive.numbered) == len(frozen.indexes) == CLIPS[version]
    clips = [frozen.clip(number) for number in range(CLIPS[version])]
    nodes = [node for clip in clips for node in clip.figure.nodes]
    several = [len(rest) > 1 for clip in clips for rest in clip.header.rests]
    assert {2: {False}, 3: {True}}.get(version, {False, True}) == set(several)
    leads = [lead for clip in clips for lead in clip.head.leads]
    assert bool(leads) == any(clip.header.led for clip in clips) == (version >= 4)
    images = [image for clip in clips for image in clip.head.images]
    assert any(images) == any(clip.header.mirrored for clip in clips) == (version == 5)
    if version >= 4:
        assert {bool(lead.move) for lead in leads} == {False, True}
        assert {lead.stride for lead in leads} == {1, 2}
    assert {clip.header.generation for clip in clips} == ({0, 2} if version == 4 else {0, 1})
    assert max(len(clip.runs) for clip in clips) > 1
    assert any(frozen.clip(n).head.references for clip in clips for n in clip.head.references)
    assert any(number >= 9 for clip in clips for number in clip.head.references)  # of job 2
    assert {node.kind for node in nodes} == {"turn", "hinge", "place"}
    assert any(any(clip.head.gaps) for clip in clips)
    assert any(any(clip.head.fineness) for clip in clips)


def model_of(rows: int, rate: float, seed: int, hinged: tuple[int, ...]) -> MotionModel:
    """Return a model such as might be learned: some rows are as in the fixed one, others not."""
    rng = np.random.default_rng(seed)
    model = motionmodel.fixed_model(rows, usual_span(1 / rate), hinged=hinged)
    drawn = (model.folded_weights, model.base, model.senses, model.starts)
    for values, size in zip(drawn, (400, 100, 20, 100), strict=True):
        some = rng.random((rows, *[1] * (values.ndim - 1))) < 0.5
        values += some * rng.integers(-size, size, values.shape)
    for row in np.flatnonzero(rng.random(rows) < 0.5):
        near = model.folded_basis[row] + rng.normal(size=model.folded_basis[row].shape) * 400
        model.folded_basis[row] = np.rint(np.linalg.qr(near).Q * 2**14)  # orthonormal, as it must
    joints = rng.permutation(rows // 2).tolist()
    still, sliding = joints[::4], joints[1::3]
    return replace(model, up=2, still=tuple(sorted(still)), sliding=tuple(sorted(sliding)))


def assert_decodes(
    recipe: Recipe | Marks,
    tolerance: float,
    learned: bool,
    by_part: bool = False,
    led: bool = False,
    mirrored: bool = False,
) -> set[str]:
    """Encode a clip, and again with itself as reference; return the kinds of its nodes.

    With ``by_part`` all clips but the first are in streams per body part; with ``led`` they
    have leads; ``mirrored``: clips refer to the images of others, too.
    """
    subject = bench_of(recipe, False)
    rig, family = subject.rig, subject.codebook.family
    rows = 2 * rig.skeleton.joints
    if mirrored and rig.kind == "skeleton":  # any axes will do: images need not look like one
        axes = np.random.default_rng(recipe.seed).integers(0, 4, rig.skeleton.joints).tolist()
        family = replace(family, mirror=tuple(enumerate(axes)))
    hinged = family.hinged
    model = motionmodel.fixed_model(rows, usual_span(rig.frame_time), hinged=hinged)
    same: Model = fixed_model(model.span, rows, hinged)
    if learned:
        model = model_of(rows, 1 / rig.frame_time, recipe.seed, hinged)
        same = read_model(write_model(model), hinged)
    rig_record, family_record = json.loads(json.dumps([rig.to_record(), family.to_record()]))
    limits = uniform_limits(subject.clip, tolerance)
    known: dict[int, Decoded] = {}
    offered: list[tuple[Named, Reference]] = []
    for number in (FAR, FAR + 9, 0):  # a later clip refers to all that come before
        encoder = MotionEncoder(family, model, int(learned), by_part and number != FAR)
        leads: tuple[Lead, ...] = ()
        if led and offered and subject.clip.frames > 1:
            leads = leads_among(recipe.seed, len(offered), subject.clip.frames)
        made = encoder.encode_led(subject.clip, rig, 12, limits, offered, leads)
        file, header = unpack_motion(made.data), read_header(made.data)
        assert_header(header, file)
        version = 4 if leads else 2 + (encoder.by_part and len(rig.parts) > 1)
        assert made.data[2] == (5 if any(named.mirrored for named, _ in offered) else version)
        known[number] = decode_file(header, rig_record, family_record, same, known.__getitem__)
        references = [reference for _, reference in offered]
        assert_same(known[number], decode_states(file, rig, family, model, references))
        offered.append((Named(number), reference_of(made.states, made.nodes, model)))
        image = image_of(made.states, made.nodes, rig, family)
        if image:
            offered.append((Named(number, True), reference_of(*image, model)))
    return {node.kind for node in known[0].figure.nodes}


WAYS = st.tuples(*[st.booleans()] * 4)  # learned, by part, led, mirrored


@given(recipes(8, 40), st.sampled_from([0.01, 0.1, 1.0]), WAYS)
@settings(max_examples=50, deadline=None)
@example(Recipe(joints=6, frames=0, stretchy=1.0), 0.1, (False, False, False, False))
@example(Recipe(joints=6, frames=0, stretchy=1.0), 0.1, (False, True, False, True))
@example(
    Recipe(joints=6, frames=1, motion="teleport", hinges=1.0), 0.01, (False, True, False, False)
)
@example(Recipe(joints=4, motion="spin", tree="chain", rate=240.0), 0.1, (True, False, False, True))
@example(Recipe(joints=8, frames=40, hinges=0.5, stretchy=0.3), 0.1, (True, True, True, True))
def test_skeletons_decode_from_the_text(
    recipe: Recipe, tolerance: float, ways: tuple[bool, bool, bool, bool]
) -> None:
    assert_decodes(recipe, tolerance, *ways)


@given(MARKS, st.sampled_from([0.01, 0.1]), WAYS)
@settings(max_examples=25, deadline=None)
def test_markers_decode_from_the_text(
    marks: Marks, tolerance: float, ways: tuple[bool, bool, bool, bool]
) -> None:
    assert_decodes(marks, tolerance, *ways)


def test_all_kinds_of_nodes_decode_from_the_text() -> None:
    recipe = Recipe(1, joints=9, frames=40, hinges=0.5, stretchy=0.3)
    kinds = {"turn", "hinge", "follower", "place"}
    assert assert_decodes(recipe, 0.05, False) == kinds
    assert assert_decodes(recipe, 0.05, True) == kinds
    assert assert_decodes(recipe, 0.05, False, True) == kinds
    assert assert_decodes(recipe, 0.05, True, True, True) == kinds
    assert assert_decodes(recipe, 0.05, True, False, False, True) == kinds


@given(st.integers(0, 2**48 - 2), st.integers(1, 2**47), st.data())
def test_numbers_and_arrays_read_from_the_text(
    number: int, below: int, data: st.DataObject
) -> None:
    array = data.draw(st.lists(st.integers(0, below - 1), min_size=1, max_size=5))
    writer = SymbolWriter()
    writer.number(number)
    writer.uniform(array, below)
    reader = SymbolReader(writer.to_bytes())
    assert reader.number() == number
    assert reader.uniforms(below, len(array)) == array


SIGNED = st.integers(-300, 300) | st.integers(-(2**46), 2**46)


@given(st.lists(SIGNED, min_size=4, max_size=4))
@settings(max_examples=20)
def test_signed_numbers_of_all_tables_read_from_the_text(values: list[int]) -> None:
    writer = SymbolWriter()
    for c in range(120):
        writer.sized(np.array(values), np.full(4, c))
    reader = SymbolReader(writer.to_bytes())
    assert [[reader.sized(c) for _ in range(4)] for c in range(120)] == [values] * 120


def test_the_tables_are_those_of_the_text() -> None:
    """The counts themselves: a table that is off in a rare symbol would pass what stands above."""
    for c in range(120):
        high, table = signed(c)
        assert (high, table) == (class_shifts()[c], counted(list(class_counts(c))))


def test_the_oracle_shares_no_code() -> None:
    for name in ("motion", "run", "blocks", "model", "nodes", "turns", "stream"):
        tree = ast.parse((Path(__file__).parent / f"oracle_{name}.py").read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.Import | ast.ImportFrom):
                assert "motifold" not in ast.unparse(node)
