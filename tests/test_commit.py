"""COMMIT.json: what it says comes back, what it is not has a message of its own."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.errors import DamagedError, NotAnArchiveError, UsageError, VersionError
from motifold.pipeline.commit import FORMAT, NAME, Commit, Job, publish, read_commit, read_or_start

counts = st.integers(0, 2**40)
patterns = st.dictionaries(st.text("0123456789abcdef", min_size=16, max_size=16), st.lists(counts))
commits = st.lists(st.tuples(st.text("0123456789abcdef"), counts, counts, patterns)).map(
    lambda jobs: Commit(tuple(Job(number, *job) for number, job in enumerate(jobs, 1)))
)
COMMIT = Commit((Job(1, "ab", 3, 1, {"f": [0, 2]}), Job(2, "cd", 4, 2, {"f": [0, 5]})))


@settings(max_examples=30)
@given(commits)
def test_what_is_published_is_read(
    tmp_path_factory: pytest.TempPathFactory, commit: Commit
) -> None:
    archive = tmp_path_factory.mktemp("archive")
    publish(archive, commit)
    assert read_commit(archive) == commit
    assert [path.name for path in archive.iterdir()] == [NAME]
    assert commit.generation == len(commit.jobs)


def test_a_job_is_found_by_its_generation() -> None:
    assert COMMIT.job(2).ledger == "cd"
    for generation in (0, 3):
        with pytest.raises(DamagedError, match=f"generation {generation} of 2"):
            COMMIT.job(generation)


@pytest.mark.parametrize("place", ["nowhere", "empty", "file"])
def test_where_there_is_no_archive(tmp_path: Path, place: str) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("{}")
    with pytest.raises(NotAnArchiveError, match=f"{place}: no motifold archive. Make one with"):
        read_commit(tmp_path / place)


def test_a_newer_format_is_not_called_damaged(tmp_path: Path) -> None:
    record = {"format": FORMAT + 1, "whatever": "comes"}
    (tmp_path / NAME).write_text(json.dumps(record))
    with pytest.raises(VersionError, match=rf"format {FORMAT + 1}; .* reads format {FORMAT}. Use"):
        read_commit(tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "7",
        "{}",
        '{"format": 1}',
        '{"format": 1, "jobs": 7}',
        '{"format": 1, "jobs": [7]}',
        '{"format": 1, "jobs": [{"generation": 1}]}',
        '{"format": 1, "jobs": [{"generation": 1, "ledger": "", "clips": 1, "rigs": 1, "x": 1}]}',
        '{"format": 1, "jobs": "\xff"}',
        "\0" * 300,
    ],
)
def test_damage_is_told_with_the_file(tmp_path: Path, text: str) -> None:
    (tmp_path / NAME).write_bytes(text.encode("latin-1"))
    with pytest.raises(DamagedError, match=r"COMMIT\.json"):
        read_commit(tmp_path)


def test_a_commit_that_is_a_folder_is_damage(tmp_path: Path) -> None:
    (tmp_path / NAME).mkdir()
    with pytest.raises(DamagedError, match="Is a directory"):
        read_commit(tmp_path)


def test_readers_see_the_old_state_or_the_new_one(tmp_path: Path) -> None:
    states = [Commit(COMMIT.jobs[:count]) for count in (1, 2)]
    publish(tmp_path, states[0])
    done = threading.Event()

    def write() -> None:
        for turn in range(40):
            publish(tmp_path, states[turn % 2])
        done.set()

    writer = threading.Thread(target=write)
    writer.start()
    seen = []
    while not done.is_set():
        seen.append(read_commit(tmp_path))
    writer.join()
    assert all(commit in states for commit in seen)


def test_a_new_archive_begins_empty_and_an_old_one_goes_on(tmp_path: Path) -> None:
    (tmp_path / ".DS_Store").write_text("")
    assert read_or_start(tmp_path) == Commit() == read_commit(tmp_path)
    publish(tmp_path, COMMIT)
    assert read_or_start(tmp_path) == COMMIT


@pytest.mark.parametrize("name", ["walk.bvh", "clips/walks/01.bvh", "ledger/000001.json.xz"])
def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("precious")
    with pytest.raises(UsageError, match=r"no archive.*holds .*Name a new folder"):
        read_or_start(tmp_path)
    assert path.read_text() == "precious"
    assert not (tmp_path / NAME).exists()
