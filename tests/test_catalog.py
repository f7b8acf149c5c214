"""The catalog of an archive: made, kept up to date, searched, damaged and mended."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import shutil
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from libraries import CLIPS, copied, short_specs, tree, write_clips
from test_cli import ran, refused, said

from motifold.catalog.batchfile import ARRAYS, PACKED
from motifold.catalog.batchfile import CLIPS as CLIPS_FILE
from motifold.catalog.bodysignals import PARTS
from motifold.catalog.catalogcheck import check_catalog
from motifold.catalog.catalogfolder import Catalog, read_batch, read_vocabulary
from motifold.catalog.catalogrecord import FOLDER, NAME, read_record
from motifold.catalog.duplicates import find_duplicates
from motifold.catalog.evaluate import label_task, measure, ranking_figures, read_labels
from motifold.catalog.growth import ledger_growth, replay
from motifold.catalog.indexing import Indexed, update_catalog
from motifold.catalog.queries import ask
from motifold.catalog.search import Query, search
from motifold.codec.errors import DamagedError, UnknownClipError, UsageError, VersionError
from motifold.codec.formats.bvh import format_bvh
from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import SerialExecutor
from motifold.pipeline.layout import CATALOG, archive_bytes
from motifold.pipeline.ledger import Row
from motifold.pipeline.plan import Settings
from motifold.pipeline.run import archive_library


def indexed(folder: Path, **options: Any) -> Indexed:
    return update_catalog(folder, engine=SerialExecutor(), **options)


@pytest.fixture(scope="module")
def archive(small_archive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of `small_archive` with a catalog; not to be written to."""
    folder = copied(small_archive, tmp_path_factory.mktemp("catalog") / "archive")
    assert indexed(folder).clips == CLIPS
    return folder


def test_the_pipeline_and_the_catalog_agree_on_the_folder() -> None:
    assert FOLDER == CATALOG


def test_the_catalog_is_not_counted_as_archive(archive: Path, small_archive: Path) -> None:
    assert archive_bytes(archive) == archive_bytes(small_archive)


@pytest.mark.parametrize("mode", ["whole", "windows"])
@pytest.mark.parametrize("rerank", ["dtw", "none"])
def test_a_clip_is_most_like_itself(archive: Path, mode: Any, rerank: Any) -> None:
    catalog = Catalog(archive)
    for name, number in catalog.numbers.items():
        query = Query(np.array(catalog.words(number)))  # not told whose words they are
        best = search(catalog, query, top=1, mode=mode, rerank=rerank)[0]
        assert best.clip == name
        assert min(best.parts.values()) == 1.0


def test_hits_are_ordered_and_leave_the_query_out(archive: Path) -> None:
    catalog = Catalog(archive)
    name = catalog.names[3]
    hits = search(catalog, ask(catalog, name).query, top=50)
    assert len(hits) == CLIPS - 1
    assert name not in {hit.clip for hit in hits}
    assert [hit.score for hit in hits] == sorted((hit.score for hit in hits), reverse=True)
    assert all(0.0 <= hit.start < hit.stop for hit in hits)


def test_a_file_finds_what_its_clip_finds(archive: Path, small_library: Path) -> None:
    catalog = Catalog(archive)
    for name in catalog.names[:4]:
        best = search(catalog, ask(catalog, str(small_library / name)).query, top=1)[0]
        assert best.clip == name


def test_parts_that_do_not_count_change_nothing(archive: Path) -> None:
    catalog = Catalog(archive)
    words = np.array(catalog.words(0))
    other = words.copy()
    arms = [number for number in range(words.shape[1]) if number % 7 in (3, 4)]
    other[:, arms] = np.array(catalog.words(5))[: len(words)][:, arms]
    weights = {"root": 1.0, "left_leg": 2.0}
    found = [search(catalog, Query(each, weights)) for each in (words, other)]
    assert found[0] == found[1]
    assert set(found[0][0].parts) == set(weights)


def test_only_new_clips_get_words_and_nothing_published_changes(
    small_library: Path, tmp_path: Path
) -> None:
    names = sorted(path.name for path in small_library.iterdir())
    library, folder = tmp_path / "library", tmp_path / "archive"
    library.mkdir()
    for name in names[:4]:
        shutil.copy(small_library / name, library / name)
    archive_library(library, folder, workers=0)
    assert indexed(folder).new == 4
    before = tree(folder / FOLDER)
    assert indexed(folder).new == 0
    assert tree(folder / FOLDER) == before
    shutil.copy(small_library / names[5], library / names[5])
    shutil.copy(small_library / names[6], library / names[0])  # a new version
    archive_library(library, folder, workers=0)
    assert Catalog(folder).stale
    done = indexed(folder)
    assert (done.clips, done.new) == (5, 2)
    after = tree(folder / FOLDER)
    for path, content in before.items():
        if path.startswith("000001/"):
            assert after[path] == content
    catalog = Catalog(folder)
    assert not catalog.stale
    assert sorted(catalog.numbers) == sorted({*names[:4], names[5]})
    hits = search(catalog, Query(np.array(catalog.words(2))), top=50)
    assert len(hits) == len({hit.clip for hit in hits}) == 5
    with Archive(folder) as opened:
        assert check_catalog(folder, opened, decode=True) == []
    rebuilt = indexed(folder, rebuild=True)
    assert (rebuilt.clips, rebuilt.new) == (5, 5)


def test_rebuilding_gives_the_same_bytes(archive: Path, tmp_path: Path) -> None:
    again = copied(archive, tmp_path / "archive")
    shutil.rmtree(again / FOLDER)
    indexed(again)
    assert tree(again / FOLDER) == tree(archive / FOLDER)


def test_another_seed_learns_other_words(archive: Path, tmp_path: Path) -> None:
    again = copied(archive, tmp_path / "archive")
    indexed(again, rebuild=True, seed=1)
    one, other = (Catalog(folder).vocabulary.centres for folder in (archive, again))
    assert one.keys() == other.keys()
    assert any(not np.array_equal(one[kind], other[kind]) for kind in one)


def test_many_batches_become_one(
    archive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("motifold.catalog.indexing.MOST_BATCHES", 1)
    library, folder = tmp_path / "library", copied(archive, tmp_path / "archive")
    write_clips(library, short_specs(1, start=CLIPS))
    archive_library(library, folder, workers=0)
    indexed(folder)
    record = read_record(folder)
    assert record is not None
    assert [batch.clips for batch in record.batches] == [CLIPS + 1]
    with Archive(folder) as opened:
        assert check_catalog(folder, opened, decode=True) == []


def test_every_damaged_byte_is_told(archive: Path, tmp_path: Path) -> None:
    folder = copied(archive, tmp_path / "archive")
    with Archive(folder) as opened:
        assert check_catalog(folder, opened) == []
        for path in sorted((folder / FOLDER).rglob("*")):
            if not path.is_file() or path.name == NAME:
                continue
            content = path.read_bytes()
            spoilt = bytearray(content)
            spoilt[-1] ^= 1
            path.write_bytes(spoilt)
            assert check_catalog(folder, opened), path
            path.write_bytes(content)
        assert check_catalog(folder, opened) == []


def test_search_goes_on_over_what_is_whole(tmp_path: Path, archive: Path) -> None:
    library, folder = tmp_path / "library", copied(archive, tmp_path / "archive")
    names = write_clips(library, short_specs(2, start=CLIPS))
    archive_library(library, folder, workers=0)
    indexed(folder)
    lost = folder / FOLDER / "000001" / PACKED
    lost.write_bytes(lost.read_bytes()[:-100])
    code, out = ran("search", folder, names[0], "--json")
    assert code == 3
    assert [hit["clip"] for hit in json.loads(out)["hits"]] == [names[1]]
    gone = Catalog(archive).names[0]
    with pytest.raises(UnknownClipError, match="motifold index --rebuild"):
        ask(Catalog(folder), gone)
    indexed(folder)  # mends it
    assert len(Catalog(folder)) == CLIPS + 2
    assert Catalog(folder).problems == []


def test_wrong_use_is_one_line_and_code_2(
    archive: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    name = Catalog(archive).names[0]

    def told(*words: object) -> str:
        return refused(capsys, monkeypatch, "search", archive, *words)

    assert "Did you mean" in told(name[:-6])
    assert "the clip lasts" in told(name, "--from", "9s")
    assert "there is nothing" in told(name, "--from", "1.5s", "--to", "0.5s")
    assert "left_arm" in told(name, "--parts", "tail")
    assert "no time" in told(name, "--from", "soon")
    assert "dtw or none" in told(name, "--rerank", "best")
    (archive / FOLDER / NAME).rename(archive / "kept")
    try:
        assert "motifold index" in told(name)
    finally:
        (archive / "kept").rename(archive / FOLDER / NAME)


def test_the_command_says_the_same_in_every_form(archive: Path, tmp_path: Path) -> None:
    name = Catalog(archive).names[0]
    span = ("--from", "0.2s", "--to", "1.8s", "--top", "3", "--parts", "left_arm,root=2")
    record = said("search", archive, name, *span)
    assert record["mode"] == "windows"
    rows = list(csv.DictReader(io.StringIO(ran("search", archive, name, *span, "--csv")[1])))
    assert [row["clip"] for row in rows] == [hit["clip"] for hit in record["hits"]]
    assert [float(row["score"]) for row in rows] == [hit["score"] for hit in record["hits"]]
    code, out = ran("search", archive, name, *span, "--html", tmp_path / "hits.html")
    assert code == 0
    assert all(hit["clip"] in out for hit in record["hits"])
    assert_stands_alone((tmp_path / "hits.html").read_text())


class _Tags(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "br", "path", "rect", "circle", "polyline"):
            self.open.append(tag)
        self.links += [f"{tag} {key}" for key, _ in attrs if key in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag: str) -> None:
        if tag not in ("meta", "br", "path", "rect", "circle", "polyline"):
            assert self.open.pop() == tag


def assert_stands_alone(text: str) -> None:
    """Check that a page is well nested and loads nothing from anywhere."""
    tags = _Tags()
    tags.feed(text)
    assert tags.open == []
    assert tags.links == []
    assert not re.search(r"https?:|url\(|@import|<script", text)


def test_reports_are_pages_and_json(archive: Path, small_library: Path, tmp_path: Path) -> None:
    record = said("report", "library", archive, "--html", tmp_path / "library.html")
    assert record["clips"] == CLIPS
    assert set(record["patterns"]) == set(PARTS)
    assert_stands_alone((tmp_path / "library.html").read_text())
    growth = said("report", "growth", archive, "--html", tmp_path / "growth.html")
    assert [point["clips"] for point in growth["jobs"]] == [CLIPS]
    assert_stands_alone((tmp_path / "growth.html").read_text())


def test_a_catalog_of_an_older_format_says_what_to_do(archive: Path, tmp_path: Path) -> None:
    folder = copied(archive, tmp_path / "archive")
    record = json.loads((folder / FOLDER / NAME).read_text())
    (folder / FOLDER / NAME).write_text(json.dumps({**record, "format": 1}))
    with pytest.raises(VersionError, match="motifold index --rebuild"):
        Catalog(folder)
    assert indexed(folder).new == CLIPS
    assert len(Catalog(folder)) == CLIPS


def test_a_large_batch_lies_open_and_finds_the_same(
    archive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = copied(archive, tmp_path / "archive")
    monkeypatch.setattr("motifold.catalog.batchfile.MOST_PACKED", 0)
    indexed(folder, rebuild=True)
    files = {path.name for path in (folder / FOLDER / "000001").iterdir()}
    assert files == {CLIPS_FILE, *(f"{name}.npy" for name in ARRAYS)}
    small, large = Catalog(archive), Catalog(folder)
    for name in small.names[:3]:
        found = [search(each, ask(each, name).query, top=50) for each in (small, large)]
        assert found[0] == found[1]
    with Archive(folder) as opened:
        assert check_catalog(folder, opened, decode=True) == []
    record = json.loads((folder / FOLDER / NAME).read_text())
    (folder / FOLDER / NAME).write_text(json.dumps({**record, "format": 2}))
    assert Catalog(folder).names == small.names  # the format before had no others


@given(st.randoms(use_true_random=False))
@settings(deadline=None, max_examples=100)
def test_damage_of_a_packed_file_is_told_or_changes_no_batch(archive: Path, random: Random) -> None:
    record = read_record(archive)
    assert record is not None
    batch = record.batches[0]
    path = archive / FOLDER / random.choice((record.vocabulary, f"{batch.folder}/{PACKED}"))
    whole = path.read_bytes()
    spoilt = bytearray(whole)
    for _ in range(random.randint(1, 3)):
        ends = random.choice((random.randrange(len(whole)), -1 - random.randrange(400)))
        spoilt[ends] = random.randrange(256)
    before = read_batch(archive / FOLDER, batch)
    path.write_bytes(spoilt)
    try:
        with suppress(DamagedError):
            read_vocabulary(archive, record)
            after = read_batch(archive / FOLDER, batch)
            assert after.keys == before.keys
            assert np.array_equal(after.words, before.words)
            assert np.array_equal(after.postings.weights, before.postings.weights)
    finally:
        path.write_bytes(whole)


def test_equal_sources_are_found_whatever_digits_their_rows_have() -> None:
    row = Row("a", "0" * 8, "01234567", 5, 1, 0, 1)
    for digits in ("0123456789ab", "0123456789abcdef"):
        assert row.content == replace(row, source=digits).content
    assert row.content != replace(row, source="01234568").content
    assert row.content != replace(row, source_bytes=6).content


def test_searching_wakes_no_compiler(archive: Path) -> None:
    heavy = "numba", "scipy", "sklearn", "zarr", "dask", "constriction"
    name = Catalog(archive).names[0]
    code = (
        "import sys; from motifold.workflows.cli import app\n"
        f"app(['search', {str(archive)!r}, {name!r}], standalone_mode=False)\n"
        f"print([each for each in {heavy!r} if each in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert name not in done.stdout
    assert done.stderr.strip().endswith("[]")


def test_growth_counts_every_byte_and_no_clip_twice(small_library: Path, tmp_path: Path) -> None:
    names = sorted(path.name for path in small_library.iterdir())
    library, folder = tmp_path / "library", tmp_path / "archive"
    library.mkdir()
    for name in names[:3]:
        shutil.copy(small_library / name, library / name)
    shutil.copy(small_library / names[0], library / "again.bvh")
    archive_library(library, folder, workers=0)
    shutil.copy(small_library / names[4], library / names[4])
    archive_library(library, folder, workers=0)
    with Archive(folder) as opened:
        points = ledger_growth(opened)
    assert [(point.clips, point.duplicates) for point in points] == [(3, 1), (4, 1)]
    commit = (folder / "COMMIT.json").stat().st_size
    assert points[-1].archive_bytes == archive_bytes(folder) - commit
    sizes = [(small_library / name).stat().st_size for name in (*names[:3], names[4])]
    assert points[-1].source_bytes == sum(sizes)
    assert math.isclose(
        points[-1].added_100, 100 * (points[1].archive_bytes - points[0].archive_bytes)
    )
    again = replay(library, [2, 4], Settings(tolerance=1.0), workers=0)
    assert [point.clips for point in again] == [2, 4]
    assert all(point.max_error <= 1.0 and point.duplicates == 0 for point in again)
    with pytest.raises(UsageError, match="4 distinct clips"):
        replay(library, [5], Settings(), workers=0)


def test_planted_duplicates_are_found_and_nothing_else(tmp_path: Path) -> None:
    library, folder = tmp_path / "library", tmp_path / "archive"
    specs = [replace(spec, seconds=4.0, rate=60.0) for spec in short_specs(8)]
    names = write_clips(library, specs)
    clip = specs[0].clip()
    shutil.copy(library / names[1], library / "renamed.bvh")
    (library / "crop.bvh").write_bytes(format_bvh(clip.slice(50, 200)))
    half = replace(
        clip,
        rotations=clip.rotations[::2],
        translations=clip.translations[::2],
        frame_time=2 * clip.frame_time,
    )
    (library / "half.bvh").write_bytes(format_bvh(half))
    archive_library(library, folder, Settings(tolerance=0.1), workers=0)
    indexed(folder)
    with Archive(folder) as opened:
        found = find_duplicates(opened, Catalog(folder), retakes=False)
    kinds = {(pair.kind, frozenset((pair.clip, pair.other))) for pair in found}
    assert kinds == {
        ("equal", frozenset((names[1], "renamed.bvh"))),
        ("crop", frozenset((names[0], "crop.bvh"))),
        ("same", frozenset((names[0], "half.bvh"))),
        ("crop", frozenset(("half.bvh", "crop.bvh"))),
    }
    crop = next(pair for pair in found if {pair.clip, pair.other} == {names[0], "crop.bvh"})
    assert abs(crop.offset - 50 * clip.frame_time) < 0.01


@given(st.lists(st.booleans(), min_size=1, max_size=30).filter(any))
def test_ranking_figures_are_those_of_their_definitions(right: list[bool]) -> None:
    first, ten, average, gain = ranking_figures(np.array(right))
    assert first == right[0]
    assert math.isclose(ten, sum(right[:10]) / len(right[:10]))
    precisions = [sum(right[:rank]) / rank for rank in range(1, len(right) + 1) if right[rank - 1]]
    assert math.isclose(average, sum(precisions) / len(precisions))
    gains = [1 / math.log2(rank + 2) for rank in range(len(right))]
    best = sum(gains[: sum(right)])
    got = sum(gain for gain, each in zip(gains, right, strict=True) if each)
    assert math.isclose(gain, got / best)


def test_labels_say_who_competes() -> None:
    names = ["walk_sad_1", "walk_sad_2", "walk_gay_1", "run_sad_1", "notes"]
    labels = read_labels(names, r"(?P<content>\w+?)_(?P<style>\w+?)_\d")
    marks = list(labels.values())
    task = label_task(marks, ["content"], ["style"])
    assert task.competes(0).tolist() == [False, False, True, False]
    assert task.relevant(0).tolist() == [True, True, True, False]
    figures = measure("best", lambda query: task.relevant(query).astype(float), task, range(4))
    assert (figures.queries, figures.precision_1) == (3, 1.0)
    for pattern in ("(", "walk", r"(?P<x>dance)"):
        with pytest.raises(UsageError):
            read_labels(names, pattern)
    with pytest.raises(UsageError, match="Labels"):
        label_task(marks, ["mood"])


def test_an_unknown_clip_says_what_to_do(archive: Path) -> None:
    with pytest.raises(UnknownClipError, match="See: motifold info"):
        ask(Catalog(archive), "zzzz")
    with pytest.raises(DamagedError, match="motifold index"):
        Catalog(copied_without_catalog(archive))


def copied_without_catalog(archive: Path) -> Path:
    folder = copied(archive, archive.parent / "bare")
    shutil.rmtree(folder / FOLDER)
    return folder
