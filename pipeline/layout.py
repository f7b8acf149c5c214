"""Where things are in an archive, and which rows are current."""

from __future__ import annotations

from pathlib import Path

from ..codec.errors import DamagedError
from .commit import Commit
from .ledger import Ledger, Row, ledger_path, read_ledger


def index_path(archive: Path, name: str) -> Path:
    """Return where the index file with a digest is."""
    return archive / "clips" / name[:2] / f"{name}.mfi"


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
