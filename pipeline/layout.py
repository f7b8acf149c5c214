"""Where things are in an archive, and which rows are current."""

from __future__ import annotations

from pathlib import Path

from ..codec.errors import DamagedError
from .commit import Commit
from .durable import folder_bytes
from .ledger import Ledger, Row, ledger_path, read_ledger
from .lock import NAME as LOCK

CATALOG, TRAITS = DERIVED = "catalog", "traits"
"""Folders that no clip needs: the search catalog, and what later jobs know of earlier clips."""


def index_path(archive: Path, name: str) -> Path:
    """Return where the index file with a digest is."""
    return archive / "clips" / name[:2] / f"{name}.mfi"


def traits_path(archive: Path, generation: int) -> Path:
    """Return where the traits of a job's clips are."""
    return archive / TRAITS / f"{generation:06d}.traits"


def archive_bytes(archive: Path) -> int:
    """Return the size of an archive, in bytes, without what is derived from it or in the way."""
    total = folder_bytes(archive) - sum(folder_bytes(archive / folder) for folder in DERIVED)
    lock = archive / LOCK
    return total - (lock.stat().st_size if lock.exists() else 0)


def read_ledgers(archive: Path, commit: Commit) -> dict[int, Ledger]:
    """Return the ledgers of all published jobs by generation. Raises `DamagedError`."""
    ledgers = {}
    for job in commit.jobs:
        path = ledger_path(archive, job.generation)
        ledgers[job.generation] = read_ledger(path, job.ledger)
        if len(ledgers[job.generation].rows) != job.clips:
            raise DamagedError(f"does not have the {job.clips} clips of its job", file=path)
    return ledgers


def current_rows(ledgers: dict[int, Ledger]) -> dict[str, tuple[Row, int]]:
    """Return the newest row of every clip with its generation, by name, ordered by name."""
    newest: dict[str, tuple[Row, int]] = {}
    for generation, ledger in sorted(ledgers.items()):
        newest.update((row.name, (row, generation)) for row in ledger.rows)
    return {name: newest[name] for name in sorted(newest)}
