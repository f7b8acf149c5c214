"""Archives of every format version must decode for ever, to the same integers."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest
from oracle_files import file_errors

from motifold.codec.clip import IntArray
from motifold.codec.version1.decode import decode_integers
from motifold.codec.version1.index_file import IndexFile
from motifold.pipeline import Archive, ArchivedClip
from motifold.pipeline.executors import SerialExecutor
from motifold.pipeline.restore import restore_clips
from motifold.pipeline.shelf import Found
from motifold.pipeline.verify import verify_archive

FIXTURES = Path(__file__).parent / "fixtures"
VERSIONS = sorted(path.name for path in FIXTURES.glob("v*"))

# Of every clip's integers, in the clips' order. Noted when the version was made.
INTEGERS = {
    "v1": "d21c6508b5c5fd86e9caadeb91704e09",
    "v2": "5e512b18d74636e75b6ec51b75c72144",
    "v3": "5e512b18d74636e75b6ec51b75c72144",  # the same motion in other streams
    "v4": "ffae3138646c447500d08125aa877b76",
    "v5": "ba4a81addbbc6d8213c56d90e21bafec",
}


def integers_of(archive: Archive, clip: ArchivedClip) -> list[IntArray]:
    """What a file says before any floating point: rounded signals, or states."""
    index = clip.index()
    if isinstance(index, IndexFile):
        codebook = archive.codebook(clip.rig.family_key, index.generation)
        return decode_integers(index, clip.rig, codebook)
    return list(archive.shelf.states(Found(index, clip.rig, clip.path)).states)


def test_every_version_is_here() -> None:
    assert sorted(INTEGERS) == VERSIONS


@pytest.mark.parametrize("version", VERSIONS)
def test_the_integers_are_the_ones_that_were_written(version: str) -> None:
    found = hashlib.blake2b(digest_size=16)
    with Archive(FIXTURES / version / "archive") as archive:
        for clip in archive.values():
            for part in integers_of(archive, clip):
                found.update(part.astype("<i8").tobytes())
    assert found.hexdigest() == INTEGERS[version]


@pytest.mark.parametrize("version", VERSIONS)
def test_the_sources_come_back_inside_their_certificates(version: str, tmp_path: Path) -> None:
    library = FIXTURES / version / "library"
    with Archive(FIXTURES / version / "archive") as archive:
        engine = SerialExecutor()
        assert verify_archive(archive, engine=engine, library=library).problems == []
        restored = restore_clips(archive, list(archive), tmp_path, engine=engine)
        assert not restored.failures
        for name, path in restored.files.items():
            error = file_errors(library / name, Path(path), 1.0).max()
            certificate = archive[name].certificate
            assert error <= certificate.maximum + 1e-5, name
            assert error <= archive[name].tolerance, name
