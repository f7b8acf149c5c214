"""Archives with streams per body part: parts of clips, from damaged archives too."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from libraries import copied, short_specs, tree, write_clips

from motifold.codec.clip import Clip, SkeletonClip
from motifold.codec.errors import DamagedError, UsageError
from motifold.codec.figure.partial import only_parts
from motifold.codec.version2.motionfile import MotionFile
from motifold.codec.version2.motionhead import read_references
from motifold.codec.version2.pieces import Pieces
from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import SerialExecutor
from motifold.pipeline.indexreader import PAGE, PagedFile, read_index
from motifold.pipeline.ledger import Row
from motifold.pipeline.plan import Settings
from motifold.pipeline.run import archive_library
from motifold.pipeline.verify import verify_archive

ARM = "left_arm"


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("parts") / "library"
    write_clips(folder, short_specs(8))
    return folder


@pytest.fixture(scope="module")
def mixed(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three jobs: without streams per part, with them, and without once more."""
    folder = tmp_path_factory.mktemp("parts") / "archive"
    grown = tmp_path_factory.mktemp("parts") / "grown"
    names = sorted(tree(library))
    for some, streams in ((names[:2], "runs"), (names[:6], "parts"), (names, "runs")):
        grown.mkdir(exist_ok=True)
        for name in some:
            (grown / name).write_bytes((library / name).read_bytes())
        wanted = replace(Settings(model="fixed"), streams=streams)  # type: ignore[arg-type]
        report = archive_library(grown, folder, wanted, workers=0)
        assert not report.failures
    return folder


@pytest.fixture(scope="module")
def parted(library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight clips with streams per part."""
    folder = tmp_path_factory.mktemp("parts") / "archive"
    archive_library(library, folder, Settings(streams="parts", model="fixed"), workers=0)
    return folder


def assert_same(found: Clip, wanted: Clip) -> None:
    assert isinstance(found, SkeletonClip)
    assert isinstance(wanted, SkeletonClip)
    np.testing.assert_array_equal(found.rotations, wanted.rotations)
    np.testing.assert_array_equal(found.translations, wanted.translations)


def index_of(archive: Archive, row: Row) -> tuple[Path, MotionFile]:
    path = archive.path / "clips" / row.index[:2] / f"{row.index}.mfi"
    file = read_index(path, piecewise=True)
    assert isinstance(file, MotionFile)
    return path, file


def destroy(archive: Archive, names: set[str]) -> None:
    """Overwrite the streams of all parts but some, in all index files."""
    for row in archive.numbered:
        path, file = index_of(archive, row)
        assert isinstance(file.rests, Pieces)
        data = bytearray(path.read_bytes())
        parts = archive.rig(row.rig).parts
        for number, piece in enumerate(file.rests.where):
            if parts[number % len(parts)].name not in names:
                data[piece.start : piece.stop] = bytes(
                    255 - byte for byte in data[piece.start : piece.stop]
                )
        path.write_bytes(data)


def test_the_ledger_says_it_only_where_it_is_so(mixed: Path) -> None:
    with Archive(mixed) as archive:
        words = [ledger.settings.get("streams") for ledger in archive.ledgers.values()]
        assert words == [None, "parts", None]
        streams = [index_of(archive, row)[1].streams for row in archive.numbered]
        assert streams == [1] * 2 + [len(archive.rig(0).parts)] * 4 + [1] * 2
        assert len(archive) == len(archive.numbered)  # no clip was archived anew


@pytest.mark.parametrize("tier", ["tolerance", "preview"])
def test_parts_are_the_same_whatever_the_streams(mixed: Path, parted: Path, tier: str) -> None:
    for folder in (mixed, parted):
        with Archive(folder) as archive, Archive(folder) as fresh:
            for name in archive:
                whole = archive[name].decode(tier)  # type: ignore[arg-type]
                for part in (ARM, "right_leg", "root"):
                    some = fresh[name].decode(tier, parts=[part])  # type: ignore[arg-type]
                    assert_same(some, only_parts(whole, archive[name].rig, [part]))
                cut = fresh[name].decode(tier, parts=[ARM], start=7, stop=31)  # type: ignore[arg-type]
                assert_same(cut, only_parts(whole, archive[name].rig, [ARM]).slice(7, 31))
                joint = archive[name].rig.parts[0].reference
                wanted = archive[name].positions[:, joint]
                np.testing.assert_array_equal(fresh[name].root_path, wanted)


def test_an_arm_is_read_where_all_else_is_lost(parted: Path, tmp_path: Path) -> None:
    folder = copied(parted, tmp_path / "archive")
    with Archive(parted) as whole, Archive(folder) as archive:
        parts = next(iter(archive.values())).rig.parts
        names, above = [part.name for part in parts], set()
        for arm in (ARM, "right_arm"):  # the mirror image of a reference has the other one
            number = names.index(arm)
            while number >= 0:
                above.add(names[number])
                number = parts[number].parent
        destroy(archive, above)
        predicted = 0
        for name, clip in archive.items():
            predicted += bool(read_references(index_of(archive, clip.row)[1]))
            assert_same(clip.decode(parts=[ARM]), only_parts(whole[name].clip, clip.rig, [ARM]))
            np.testing.assert_array_equal(clip.root_path, whole[name].root_path)
            assert clip.certificate == whole[name].certificate
            for parts_of in (None, ["right_leg"]):
                with pytest.raises(DamagedError, match="checksum"):
                    clip.decode(parts=parts_of)
        assert predicted > 4
        found = verify_archive(archive, engine=SerialExecutor())
        assert len(found.problems) == len(archive)


def test_a_damaged_stream_of_a_reference_is_told_with_its_file(
    parted: Path, tmp_path: Path
) -> None:
    folder = copied(parted, tmp_path / "archive")
    with Archive(folder) as archive:
        for clip in archive.values():
            numbers = read_references(index_of(archive, clip.row)[1])
            if numbers:
                break
        path, file = index_of(archive, archive.numbered[numbers[0].number])
        assert isinstance(file.rests, Pieces)
        arm = [part.name for part in clip.rig.parts].index(ARM)
        data = bytearray(path.read_bytes())
        data[file.rests.where[arm].stop - 1] ^= 4
        path.write_bytes(data)
        clip.decode(parts=["right_leg"])
        with pytest.raises(DamagedError, match=f"{path.name}.*checksum of a stream"):
            clip.decode(parts=[ARM])


@given(
    size=st.integers(0, 5 * PAGE),
    spans=st.lists(st.tuples(st.integers(0, 6 * PAGE), st.integers(0, 6 * PAGE))),
)
@settings(max_examples=50)
def test_a_paged_file_is_its_bytes(
    size: int, spans: list[tuple[int, int]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("pages") / "file"
    data = np.random.default_rng(size).bytes(size)
    path.write_bytes(data)
    paged = PagedFile(path)
    assert len(paged) == size
    pages = set()
    for start, stop in spans:
        assert paged[start:stop] == data[start:stop]
        pages |= {at // PAGE for at in range(start, min(stop, size))}
        if start < size:
            assert paged[start] == data[start]
            pages.add(start // PAGE)
    least = sum(len(data[page * PAGE : (page + 1) * PAGE]) for page in pages)
    assert least <= paged.read <= size


def test_an_arm_of_a_long_clip_is_some_pages_of_its_file(tmp_path: Path) -> None:
    (spec,) = short_specs(1)
    write_clips(tmp_path / "library", [replace(spec, seconds=60.0, rate=60.0)])
    archive_library(
        tmp_path / "library",
        tmp_path / "archive",
        Settings(tolerance=0.005, streams="parts", model="fixed"),
        workers=0,
    )
    with Archive(tmp_path / "archive") as archive:
        (clip,) = archive.values()
        paged = PagedFile(clip.path)
        whole = len(paged)
        assert whole > 20 * PAGE
        _ = archive.shelf, clip.rig
        read: list[PagedFile] = []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                "motifold.pipeline.indexreader.PagedFile",
                lambda path: read.append(PagedFile(path)) or read[-1],  # type: ignore[func-returns-value]
            )
            clip.decode(parts=[ARM], start=1100, stop=1200)
        assert sum(file.read for file in read) < 0.4 * whole


def test_streams_are_checked_words() -> None:
    with pytest.raises(UsageError, match="limbs"):
        Settings(streams="limbs")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="version 1"):
        Settings(codec="patterns", streams="parts")
    assert "streams" not in Settings().to_record()
    assert Settings(streams="parts").to_record()["streams"] == "parts"
    assert Settings(streams="parts").covers(Settings().to_record())
    assert Settings().covers(Settings(streams="parts").to_record())
