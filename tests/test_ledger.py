"""Ledgers: round trips, plain tools can read them, and damage is found."""

from __future__ import annotations

import json
import lzma
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.clip import Repair
from motifold.codec.errors import DamagedError
from motifold.pipeline.commit import Commit, Job
from motifold.pipeline.durable import digest
from motifold.pipeline.layout import current_rows, index_path, read_ledgers
from motifold.pipeline.ledger import Failure, Ledger, Row, ledger_path, read_ledger, write_ledger

texts = st.text(max_size=12) | st.just("caf\udce9.bvh")
counts = st.integers(0, 2**50)
rows = st.builds(
    Row,
    name=texts,
    index=texts,
    source=texts,
    source_bytes=counts,
    frames=counts,
    rig=counts,
    numbers=counts,
    repairs=st.lists(st.builds(Repair, texts, texts), max_size=3).map(tuple),
)
ledgers = st.builds(
    Ledger,
    settings=st.dictionaries(texts, st.none() | st.floats(0, 9) | texts, max_size=3),
    rows=st.lists(rows, max_size=5, unique_by=lambda row: row.name).map(tuple),
    failures=st.lists(st.builds(Failure, texts, texts), max_size=3).map(tuple),
    store=st.dictionaries(texts, texts, max_size=3),
)


def row(name: str, index: str = "0" * 16) -> Row:
    return Row(name, index, "1" * 16, 9, 8, 7, 6, (Repair("mended", "line 3"),))


@given(ledgers)
@settings(max_examples=15)
def test_what_is_written_is_read(tmp_path_factory: pytest.TempPathFactory, ledger: Ledger) -> None:
    path = tmp_path_factory.mktemp("ledger") / "1.json.xz"
    name = write_ledger(path, ledger)
    assert name == digest(path.read_bytes())
    assert read_ledger(path, name) == ledger
    assert write_ledger(path, ledger) == name


def test_plain_tools_can_read_it(tmp_path: Path) -> None:
    path = ledger_path(tmp_path, 12)
    assert path.name == "000012.json.xz"
    write_ledger(path, Ledger({"tolerance": 0.1}, (row("a"),), (Failure("b", "torn"),)))
    record = json.loads(lzma.decompress(path.read_bytes()))
    assert record["clips"]["name"] == ["a"]
    assert record["repairs"] == [[[["line 3", "mended"]], [0]]]
    assert record["failures"] == [["b", "torn"]]


def test_repairs_by_clip_name_of_earlier_motifolds_are_read(tmp_path: Path) -> None:
    path = tmp_path / "ledger"
    written = Ledger({}, (row("a"), replace(row("b"), repairs=()), row("c")))
    write_ledger(path, written)
    record = json.loads(lzma.decompress(path.read_bytes()))
    record["repairs"] = {name: [["line 3", "mended"]] for name in "ac"}
    data = lzma.compress(json.dumps(record).encode())
    path.write_bytes(data)
    assert read_ledger(path, digest(data)) == written


def test_a_flipped_byte_anywhere_is_found(tmp_path: Path) -> None:
    path = tmp_path / "ledger"
    name = write_ledger(path, Ledger({}, tuple(row(f"{n}") for n in range(3))))
    whole = path.read_bytes()
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x40]) + whole[place + 1 :])
        with pytest.raises(DamagedError, match=r"ledger: is not the ledger"):
            read_ledger(path, name)
    for data in (b"", whole[:-1], whole + b"\0"):
        path.write_bytes(data)
        with pytest.raises(DamagedError):
            read_ledger(path, name)
    path.unlink()
    with pytest.raises(DamagedError, match="No such file"):
        read_ledger(path, name)


@pytest.mark.parametrize(
    "content",
    [
        b"no xz",
        lzma.compress(b"no json"),
        lzma.compress(b"[]"),
        lzma.compress(b'{"clips": {"name": ["a"]}}'),
        lzma.compress(b"\xff"),
    ],
)
def test_what_is_no_ledger_is_refused_even_with_the_right_digest(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "ledger"
    path.write_bytes(content)
    with pytest.raises(DamagedError, match="is not a ledger"):
        read_ledger(path, digest(content))


def test_all_jobs_are_read_and_must_have_the_clips_that_they_claim(tmp_path: Path) -> None:
    jobs = []
    for generation, names in ((1, ["a", "b"]), (2, ["b"])):
        ledger = Ledger({}, tuple(row(name, f"{generation}" * 16) for name in names))
        name = write_ledger(ledger_path(tmp_path, generation), ledger)
        jobs.append(Job(generation, name, len(names), 1, {}))
    found = read_ledgers(tmp_path, Commit(tuple(jobs)))
    assert list(found) == [1, 2]
    current = current_rows(found)
    assert {name: made for name, (_, made) in current.items()} == {"a": 1, "b": 2}
    assert current["b"][0].index == "2" * 16

    false = Job(2, jobs[1].ledger, 2, 1, {})
    with pytest.raises(DamagedError, match=r"000002.*2 clips"):
        read_ledgers(tmp_path, Commit((jobs[0], false)))


def test_index_files_are_spread_over_folders(tmp_path: Path) -> None:
    assert index_path(tmp_path, "abcdef") == tmp_path / "clips" / "ab" / "abcdef.mfi"
