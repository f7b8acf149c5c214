"""The pattern store: what generations add comes back, and damage never does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from libraries import MARKERS, copied, marker_course, short_specs, tree

from motifold.codec.clip import Layout, MarkerClip
from motifold.codec.errors import ArchiveError, DamagedError
from motifold.codec.figure.bodyparts import body_parts
from motifold.codec.figure.markerparts import marker_parts
from motifold.codec.figure.rig import Family, Rig, bends_of, bone_means, found_family, rig_of
from motifold.codec.patterns.patterns import PATTERN_FRAMES, no_patterns
from motifold.pipeline.commit import Commit, Job
from motifold.pipeline.ledger import Ledger
from motifold.pipeline.store import Store, check_generation, read_store, write_generation


def skeleton_rig() -> tuple[Rig, Family]:
    clip = short_specs(1)[0].clip()
    rig = rig_of(clip, body_parts(clip.skeleton))
    usual = np.tile(np.eye(3), (clip.skeleton.joints, 1, 1))
    return rig, found_family(rig, usual, bone_means(clip), bends_of(clip.rotations), 20.0)


def marker_rig() -> tuple[Rig, Family]:
    positions = marker_course() / 10
    clip = MarkerClip(MARKERS, 0.01, positions, Layout("trc", "mm", "declared", 0.1))
    rig = rig_of(clip, marker_parts(MARKERS, positions))
    return rig, found_family(rig, np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)), 18.0)


RIG, FAMILY = skeleton_rig()
MARKER_RIG, MARKER_FAMILY = marker_rig()


def drawn(part: int, count: int, seed: int, family: Family = FAMILY) -> npt.NDArray[np.int16]:
    shape = (count, PATTERN_FRAMES, no_patterns(family.parts[part]).shape[2])
    rng = np.random.default_rng(seed)
    values = rng.integers(-32767, 32768, shape) * (rng.random(shape) < 0.3)
    return values.astype(np.int16)


class Written:
    """A store that is written generation by generation, as a job does it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.commit = Commit()
        self.ledgers: dict[int, Ledger] = {}

    def add(self, store: Store) -> None:
        generation = self.commit.generation + 1
        digests = write_generation(self.folder, generation, self.commit, store)
        self.ledgers[generation] = Ledger({}, (), (), digests)
        job = Job(generation, "", 0, len(store.rigs), store.counts())
        self.commit = Commit((*self.commit.jobs, job))

    def read(self) -> Store:
        return read_store(self.folder, self.commit, self.ledgers)


def assert_same(found: Store, expected: Store) -> None:
    assert [rig.to_record() for rig in found.rigs] == [rig.to_record() for rig in expected.rigs]
    assert {key: family.to_record() for key, family in found.families.items()} == {
        key: family.to_record() for key, family in expected.families.items()
    }
    assert found.counts() == expected.counts()
    for key, parts in expected.patterns.items():
        for mine, theirs in zip(found.patterns[key], parts, strict=True):
            assert mine.dtype == np.int16
            np.testing.assert_array_equal(mine, theirs)


@pytest.fixture(scope="module")
def two_jobs(tmp_path_factory: pytest.TempPathFactory) -> Written:
    written, store = Written(tmp_path_factory.mktemp("store")), Store()
    store.add_family(FAMILY)
    store.add_rig(RIG)
    store.add_patterns(FAMILY.key, 4, drawn(4, 3, seed=1))
    written.add(store)
    store.add_family(MARKER_FAMILY)
    store.add_rig(MARKER_RIG)
    store.add_patterns(FAMILY.key, 4, drawn(4, 2, seed=2))
    store.add_patterns(MARKER_FAMILY.key, 1, drawn(1, 2, seed=3, family=MARKER_FAMILY))
    written.add(store)
    return written


@settings(max_examples=8)
@given(st.lists(st.lists(st.tuples(st.integers(1, 12), st.integers(1, 9))), max_size=3))
def test_generations_come_back_in_order(
    tmp_path_factory: pytest.TempPathFactory, jobs: list[list[tuple[int, int]]]
) -> None:
    written, store = Written(tmp_path_factory.mktemp("store")), Store()
    store.add_family(FAMILY)
    store.add_rig(RIG)
    for number, job in enumerate(jobs):
        for part, count in job:
            store.add_patterns(FAMILY.key, part, drawn(part, count, seed=number))
        written.add(store)
        assert_same(written.read(), store)


def test_more_patterns_than_a_chunk_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("motifold.pipeline.store._CHUNK", 8)
    written, store = Written(tmp_path), Store()
    store.add_family(FAMILY)
    store.add_patterns(FAMILY.key, 3, drawn(3, 27, seed=0))
    store.add_patterns(FAMILY.key, 5, 0 * drawn(5, 20, seed=0))  # zeros: Zarr writes no chunks
    written.add(store)
    assert_same(written.read(), store)


def test_an_empty_store_is_read() -> None:
    assert Store().counts() == read_store(Path("nowhere"), Commit(), {}).counts() == {}


def test_rigs_are_known_by_their_record() -> None:
    store = Store()
    other = replace(RIG, frame_time=RIG.frame_time / 2)
    assert store.rig_number(RIG) is None
    assert [store.add_rig(RIG), store.add_rig(other)] == [0, 1]
    assert store.rig_number(Rig.from_record(other.to_record())) == 1


def test_a_codebook_is_the_store_as_it_was(two_jobs: Written) -> None:
    store = two_jobs.read()
    now, then = (
        store.codebook(FAMILY.key),
        store.codebook(FAMILY.key, two_jobs.commit.job(1).patterns[FAMILY.key]),
    )
    assert len(now.patterns[4]) == 5
    np.testing.assert_array_equal(then.patterns[4], now.patterns[4][:3])
    with pytest.raises(DamagedError, match="no rig family"):
        store.codebook("unknown")


def test_old_generations_are_never_touched(tmp_path: Path) -> None:
    written, store = Written(tmp_path), Store()
    store.add_family(FAMILY)
    store.add_patterns(FAMILY.key, 4, drawn(4, 3, seed=1))
    written.add(store)
    before = tree(tmp_path)
    store.add_patterns(FAMILY.key, 4, drawn(4, 3, seed=2))
    written.add(store)
    after = tree(tmp_path)
    assert {name: after[name] for name in before} == before


def test_equal_stores_have_equal_bytes(tmp_path: Path) -> None:
    for name in "ab":
        written, store = Written(tmp_path / name), Store()
        store.add_family(FAMILY)
        store.add_rig(RIG)
        store.add_patterns(FAMILY.key, 4, drawn(4, 50, seed=1))
        written.add(store)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


def test_damage_to_any_file_is_found_before_it_is_read(two_jobs: Written, tmp_path: Path) -> None:
    folder = copied(two_jobs.folder, tmp_path / "store")
    for name, whole in tree(folder).items():
        path = folder / name
        for damaged in (whole[:-1] + bytes([whole[-1] ^ 1]), whole[:-1], None):
            if damaged is None:
                path.unlink()
            else:
                path.write_bytes(damaged)
            with pytest.raises(DamagedError, match=f"{path} is (damaged|missing)"):
                read_store(folder, two_jobs.commit, two_jobs.ledgers)
        path.write_bytes(whole)
    stranger = folder / "store.zarr" / "000001" / "records" / "c" / "9"
    stranger.write_bytes(b"")
    with pytest.raises(DamagedError, match="does not belong here"):
        read_store(folder, two_jobs.commit, two_jobs.ledgers)
    assert check_generation(folder, 2, two_jobs.ledgers[2].store) == []
    stranger.unlink()
    read_store(folder, two_jobs.commit, two_jobs.ledgers)


def test_a_store_that_is_not_the_published_one_is_refused(two_jobs: Written) -> None:
    first, second = two_jobs.commit.jobs
    for false in (replace(second, rigs=9), replace(second, patterns=first.patterns)):
        with pytest.raises(DamagedError, match="not the one that was published"):
            read_store(two_jobs.folder, Commit((first, false)), two_jobs.ledgers)


def test_a_disk_that_does_not_take_it(tmp_path: Path) -> None:
    (tmp_path / "store.zarr").write_text("a file where the folder should be")
    with pytest.raises(ArchiveError, match="cannot be written"):
        write_generation(tmp_path, 1, Commit(), Store())
