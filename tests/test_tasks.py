"""What workers do: one bad clip costs nobody else, and results are the plan's business alone."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from libraries import BAD, short_specs, write_clips

from motifold.codec.figure.rig import found_family
from motifold.codec.formats.files import read_clip
from motifold.codec.patterns.patterns import Codebook
from motifold.codec.patterns.segments import SegmentRules, clip_segments
from motifold.codec.version1.encode import Encoder
from motifold.codec.version1.index_file import unpack
from motifold.pipeline import tasks
from motifold.pipeline.discover import Source, discover
from motifold.pipeline.durable import digest
from motifold.pipeline.tasks import Prepared, encode_batch, segment_batch, survey_batch


def batch_of(library: Path) -> tuple[Source, ...]:
    return tuple(discover(library))


@pytest.fixture(scope="module")
def trio(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("trio")
    write_clips(folder, short_specs(3))
    return folder


def prepared(library: Path) -> tuple[tuple[Prepared, ...], Codebook]:
    """All clips of a library of one rig family, and the family's empty codebook."""
    batch = batch_of(library)
    found = survey_batch(batch, None, None, {})
    (sketch,) = found.families.values()
    family = found_family(
        sketch.rig, sketch.usual, sketch.bones, sketch.bends, sketch.head_diagonal
    )
    items = tuple(
        Prepared(source, 0, found.rigs[clip.rig_key], clip.source)
        for source, clip in zip(batch, found.clips, strict=True)
    )
    return items, Codebook.empty(family)


def test_a_survey_tells_what_the_files_hold(trio: Path) -> None:
    batch = batch_of(trio)
    found = survey_batch(batch, None, None, {})
    assert [clip.name for clip in found.clips] == [source.name for source in batch]
    for clip, source in zip(found.clips, batch, strict=True):
        data = Path(source.path).read_bytes()
        assert (clip.source, clip.source_bytes) == (digest(data), len(data))
        read = read_clip(source.path)
        assert clip.frames == read.frames
        assert clip.repairs == read.repairs
        columns = np.loadtxt(data.decode().splitlines()[-read.frames :])
        moving = int((np.ptp(columns, axis=0) > 1e-3).sum())
        assert clip.numbers == moving * read.frames
        assert found.rigs[clip.rig_key].key == clip.rig_key


def test_a_survey_skips_what_is_known_and_unchanged(trio: Path) -> None:
    batch = batch_of(trio)
    digests = {source.name: digest(Path(source.path).read_bytes()) for source in batch}
    known = {batch[0].name: digests[batch[0].name], batch[1].name: "another", "gone": "x"}
    found = survey_batch(batch, None, None, known)
    assert found.unchanged == 1
    assert [clip.name for clip in found.clips] == [source.name for source in batch[1:]]


def test_bad_files_are_listed_with_their_reason_and_stop_nothing(odd_library: Path) -> None:
    batch = batch_of(odd_library)
    found = survey_batch(batch, None, None, {})
    reasons = {failure.name: failure.reason for failure in found.failures}
    assert set(reasons) == set(BAD)
    for name, word in BAD.items():
        assert word in reasons[name], reasons[name]
        assert Path(name).name in reasons[name]
    assert {clip.name for clip in found.clips} == {source.name for source in batch} - set(BAD)


def test_reasons_do_not_tell_where_the_library_was(odd_library: Path, tmp_path: Path) -> None:
    for failure in survey_batch(batch_of(odd_library), None, None, {}).failures:
        assert str(odd_library) not in failure.reason


@pytest.mark.parametrize("stage", ["survey", "segment", "encode"])
def test_a_bug_of_ours_costs_one_clip(
    trio: Path, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    items, codebook = prepared(trio)
    broken = items[1].source
    real = read_clip

    def read(path: str, units: str | None) -> Any:
        if path == broken.path:
            raise IndexError("off by one")
        return real(path, units)

    monkeypatch.setattr(tasks, "read_clip", read)
    family = codebook.family
    if stage == "survey":
        surveyed = survey_batch(tuple(item.source for item in items), None, None, {})
        failures, done = surveyed.failures, [clip.name for clip in surveyed.clips]
    elif stage == "segment":
        cut = segment_batch(items, {family.key: family}, {family.key: 9.0}, SegmentRules(), None)
        failures, done = cut.failures, list(cut.clips)
    else:
        encoder = Encoder(codebook, 1, 0.1, 9.0, SegmentRules())
        encoded = encode_batch(items, {family.key: encoder}, None)
        failures, done = encoded.failures, [clip.name for clip in encoded.clips]
    assert [(failure.name, failure.reason) for failure in failures] == [
        (broken.name, "internal error, IndexError: off by one")
    ]
    assert done == [items[0].source.name, items[2].source.name]


def test_segments_are_counted_in_full(trio: Path) -> None:
    items, codebook = prepared(trio)
    family = codebook.family
    radius = 12.0
    cut = segment_batch(items, {family.key: family}, {family.key: radius}, SegmentRules(), None)
    for item in items:
        segments = clip_segments(read_clip(item.source.path), family, SegmentRules())
        for part, made in zip(segments, cut.clips[item.source.name], strict=True):
            assert (part is None) == (made is None)
            if part is not None and made is not None:
                assert made.counts.sum() == len(part.points)
                assert made.points.shape[1:] == part.points.shape[1:]


def test_encoded_clips_are_whole_index_files(trio: Path) -> None:
    items, codebook = prepared(trio)
    encoder = Encoder(codebook, 1, 0.1, 9.0, SegmentRules())
    encoded = encode_batch(items, {codebook.family.key: encoder}, None)
    for clip, item in zip(encoded.clips, items, strict=True):
        index = unpack(clip.data)
        assert clip.name == item.source.name
        assert index.certificate == clip.certificate
        assert 0 < clip.certificate.maximum <= 0.1
        assert clip.matched == 0 < clip.segments, "the codebook is empty"


def test_a_file_that_changes_meanwhile_is_not_archived(trio: Path, tmp_path: Path) -> None:
    folder = tmp_path / "library"
    write_clips(folder, short_specs(2))
    items, codebook = prepared(folder)
    Path(items[0].source.path).write_bytes(Path(items[1].source.path).read_bytes())
    encoder = Encoder(codebook, 1, 0.1, 9.0, SegmentRules())
    encoded = encode_batch(items, {codebook.family.key: encoder}, None)
    (failure,) = encoded.failures
    assert (failure.name, "changed while" in failure.reason) == (items[0].source.name, True)
    assert [clip.name for clip in encoded.clips] == [items[1].source.name]


def test_tasks_and_results_travel(odd_library: Path) -> None:
    batch = batch_of(odd_library)
    assert pickle.loads(pickle.dumps(batch)) == batch
    found = survey_batch(batch, None, None, {})
    again = pickle.loads(pickle.dumps(found))
    assert again.clips == found.clips
    assert again.failures == found.failures
    assert list(again.rigs) == list(found.rigs)
