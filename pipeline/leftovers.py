"""What an interrupted job left in an archive: found by what no published job names."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from .durable import PARTIAL
from .layout import TRAITS, index_path, traits_path
from .ledger import Ledger, ledger_path
from .motion_job import SCRATCH
from .store import NAME as STORE


def remove_leftovers(archive: Path, ledgers: Mapping[int, Ledger], generation: int) -> None:
    """Remove what an interrupted job left: nothing that is published is touched.

    ``ledgers``: of the published jobs; ``generation``: of the job that begins.
    """
    shutil.rmtree(archive / SCRATCH, ignore_errors=True)
    shutil.rmtree(archive / STORE / f"{generation:06d}", ignore_errors=True)
    ledger_path(archive, generation).unlink(missing_ok=True)
    traits_path(archive, generation).unlink(missing_ok=True)
    published = {
        index_path(archive, row.index) for ledger in ledgers.values() for row in ledger.rows
    }
    for path in (archive / "clips").glob("*/*"):
        if path not in published:
            path.unlink()
    for place in (".", "ledger", TRAITS):
        for path in (archive / place).glob(PARTIAL):
            path.unlink()
