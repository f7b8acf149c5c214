"""Real files through the whole of motifold, checked by readers that are not motifold's.

A sample of files below 0.7 MB by default; all of the library, which takes many minutes, where
``MOTIFOLD_FULL_LIBRARY`` is set.
"""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest
from library import library_path
from oracle_files import file_errors, skeleton_file

from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import executor
from motifold.pipeline.plan import Settings
from motifold.pipeline.restore import restore_clips
from motifold.pipeline.run import archive_library
from motifold.pipeline.verify import verify_archive

pytestmark = pytest.mark.library

FULL = bool(os.environ.get("MOTIFOLD_FULL_LIBRARY"))
TAKES = 40
TRIALS = 3
MOST_BYTES = 700_000
WORKERS = None if FULL else 0  # starting some takes longer than the sample does
SUFFIXES = (".amc", ".bvh", ".c3d", ".trc")


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of links to Bandai clips, CMU trials, and files of many other exporters."""
    folder = tmp_path_factory.mktemp("library")
    takes = sorted(library_path("bandai").glob("*.bvh"))
    trials = sorted(library_path("cmu_amc").rglob("*.amc"))
    others = sorted(p for p in library_path("misc").rglob("*") if p.suffix.lower() in SUFFIXES)
    assert len(takes) > TAKES
    assert len(trials) > TRIALS
    assert len(others) > 20
    if not FULL:
        draw = random.Random(20090803)
        trials, others = _small(trials), _small(others)
        takes, trials = draw.sample(takes, TAKES), draw.sample(trials, TRIALS)
    for trial in [path for path in (*trials, *others) if path.suffix.lower() == ".amc"]:
        _link(folder, skeleton_file(trial))
    for path in (*takes, *trials, *others):
        _link(folder, path)
    return folder


def _small(files: list[Path]) -> list[Path]:
    return [path for path in files if path.stat().st_size < MOST_BYTES]


def _link(folder: Path, source: Path) -> None:
    link = folder / source.parent.name / source.name
    link.parent.mkdir(exist_ok=True)
    if not link.exists():
        link.symlink_to(source)


@pytest.mark.parametrize("millimetres", [1.0, 5.0, 20.0])
def test_every_restored_file_is_inside_the_tolerance(
    library: Path, tmp_path: Path, millimetres: float
) -> None:
    tolerance = millimetres / 10.0
    settings = Settings(tolerance=tolerance)
    report = archive_library(library, tmp_path / "archive", settings, workers=WORKERS)
    assert not report.failures
    files = [path for path in library.rglob("*") if path.suffix.lower() in SUFFIXES]
    assert report.clips == len(files)
    with Archive(tmp_path / "archive") as archive, executor(WORKERS) as engine:
        done = restore_clips(archive, list(archive), tmp_path / "restored", engine=engine)
        assert not done.failures
        assert not verify_archive(archive, engine=engine).problems
        assert sorted(done.files) == sorted(path.relative_to(library).as_posix() for path in files)
        for name, restored in done.files.items():
            clip = archive[name]
            errors = file_errors(library / name, Path(restored), clip.rig.layout.centimetres)
            assert errors.size >= clip.frames, name
            assert errors.max(initial=0.0) <= tolerance, name
            # the decoded clip was certified; the numbers of the restored file are rounded
            assert errors.max(initial=0.0) <= clip.certificate.maximum + 1e-5, name
            # a certificate's mean is stored to a sixteenth octave, rounded up
            assert errors.mean() <= clip.certificate.mean + 1e-5, name
            assert errors.mean() >= clip.certificate.mean / 2 ** (1 / 16) - 1e-5, name
    assert report.float32_bytes > report.index_bytes * 5
