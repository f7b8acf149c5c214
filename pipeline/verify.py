"""Checking an archive: that it is whole, that it decodes, and that the sources agree."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ..codec.errors import DamagedError, InputError, MotifoldError
from ..codec.formats.files import read_clip, source_bytes
from ..codec.geometry.metrics import measure
from .archive import Archive
from .archived_clip import ArchivedClip
from .durable import is_named
from .executors import Executor, map_batches
from .layout import index_path
from .store import check_generation
from .traits import check_traits

BATCH_CLIPS = 32
ROUNDED_UP = 1.05  # how much index files may overstate the mean error


@dataclass
class Verified:
    """What a check found.

    ``problems``: in words, with the file named. ``decoded``, ``measured``: how many clips were
    decoded, and measured against their sources. ``max_error``: the largest certificate, or
    measured error, centimetres.
    """

    clips: int = 0
    decoded: int = 0
    measured: int = 0
    max_error: float = 0.0
    problems: list[str] = field(default_factory=list)
    orphans: int = 0


def verify_archive(
    archive: Archive,
    *,
    engine: Executor,
    decode: bool = False,
    library: str | Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Verified:
    """Check every file of an archive against what was published; return what was found.

    Always: ledgers, store files and index files, of older versions too, are there, whole and
    consistent, what was kept for later jobs is whole if it is there, and every certificate is
    inside the tolerance of its job. ``decode``: every clip is decoded. ``library``: the folder
    that was archived; every clip is compared with its source, and its true error with its
    certificate.
    """
    found = Verified()
    for generation, ledger in archive.ledgers.items():
        found.problems += check_generation(archive.path, generation, ledger.store)
    try:
        _ = archive.store
    except DamagedError as problem:
        if not found.problems:
            found.problems.append(str(problem))
    found.problems += check_traits(archive.path, archive.ledgers)
    found.problems += _superseded(archive)
    names = list(archive)
    batches = [names[i : i + BATCH_CLIPS] for i in range(0, len(names), BATCH_CLIPS)]
    folder = None if library is None else str(Path(library).absolute())
    for batch, result in map_batches(
        engine, _verify_batch, batches, archive, decode, folder, lost=_lost
    ):
        found.clips += len(batch)
        found.decoded += result.decoded
        found.measured += result.measured
        found.max_error = max(found.max_error, result.max_error)
        found.problems += result.problems
        if progress:
            progress(found.clips, len(names))
    needed = {
        index_path(archive.path, row.index)
        for ledger in archive.ledgers.values()
        for row in ledger.rows
    }
    present = set((archive.path / "clips").glob("*/*"))
    found.orphans = len(present - needed)
    return found


def _superseded(archive: Archive) -> list[str]:
    """Return what is wrong with index files that newer versions of their clips replaced."""
    current = {row.index for row, _ in archive.rows.values()}
    old = {row.index: row.name for ledger in archive.ledgers.values() for row in ledger.rows}
    wrong = []
    for index in sorted(old.keys() - current):
        path = index_path(archive.path, index)
        try:
            whole = is_named(path.read_bytes(), index)
        except OSError:
            whole = False
        if not whole:
            wrong.append(f"{path} is damaged or missing (an older version of {old[index]})")
    return wrong


def _verify_batch(
    names: Sequence[str], archive: Archive, decode: bool, library: str | None
) -> Verified:
    found = Verified()
    for name in names:
        try:
            _verify_clip(archive[name], decode, library, found)
        except MotifoldError as problem:
            found.problems.append(f"{name}: {problem}")
    return found


def _verify_clip(clip: ArchivedClip, decode: bool, library: str | None, found: Verified) -> None:
    index = clip.index()
    if not is_named(clip.path.read_bytes(), clip.row.index):
        raise DamagedError("its bytes do not fit its name", file=clip.path)
    worst = index.certificate.maximum
    if worst > clip.largest:
        raise DamagedError(f"certifies {worst:g} cm, outside {clip.largest:g} cm", file=clip.path)
    mean = clip.mean_tolerance
    if mean is not None and index.certificate.mean > ROUNDED_UP * mean:
        raise DamagedError(
            f"certifies a mean of {index.certificate.mean:g} cm, outside {mean:g} cm",
            file=clip.path,
        )
    if decode or library is not None:
        decoded = clip.decode()
        found.decoded += 1
        if library is not None:
            units = clip.archive.ledgers[clip.generation].settings["units"]
            source = Path(library)
            path = source if source.is_file() else source / clip.name
            if not is_named(source_bytes(path), clip.row.source):
                raise InputError("has changed since it was archived", file=path)
            original = read_clip(path, units)
            measured = measure(original, decoded).maximum
            found.measured += 1
            if measured > worst * (1 + 1e-6):
                raise DamagedError(
                    f"is {measured:g} cm off its source, but certifies {worst:g} cm",
                    file=clip.path,
                )
            worst = measured
    found.max_error = max(found.max_error, worst)


def _lost(names: Sequence[str]) -> Verified:
    return Verified(
        problems=[f"{name}: the worker process died while it decoded" for name in names]
    )
