"""The ledger: one file a job, with a row for every clip that it archived.

Columns rather than rows, as JSON under xz: small, and ``xzcat`` shows it to a person.
"""

from __future__ import annotations

import json
import lzma
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..codec.clip import Repair
from ..codec.errors import DamagedError
from .durable import NAME_DIGITS, digest, write_whole


@dataclass(frozen=True)
class Row:
    """One archived clip.

    ``index``: name of its index file, the first 8 digits of its digest (all 16 where another
    file has these; 12 or 16 of earlier motifolds); ``source``: the same of its source bytes;
    ``source_bytes``: their number; ``numbers``: how many of the source's numbers vary (for the
    float32 baseline).
    """

    name: str
    index: str
    source: str
    source_bytes: int
    frames: int
    rig: int
    numbers: int
    repairs: tuple[Repair, ...] = ()

    @property
    def content(self) -> tuple[str, int]:
        """What rows with equal source bytes share, whichever motifold wrote them."""
        return self.source[:NAME_DIGITS], self.source_bytes


@dataclass(frozen=True)
class Failure:
    """One file that was left out, with the reason."""

    name: str
    reason: str


@dataclass(frozen=True)
class Ledger:
    """What one job did."""

    settings: dict[str, Any]
    rows: tuple[Row, ...]
    failures: tuple[Failure, ...] = ()
    store: dict[str, str] = field(default_factory=dict)  # store file to digest


_COLUMNS = ("name", "index", "source", "source_bytes", "frames", "rig", "numbers")


def ledger_path(archive: Path, generation: int) -> Path:
    """Return where a generation's ledger is."""
    return archive / "ledger" / f"{generation:06d}.json.xz"


def write_ledger(path: Path, ledger: Ledger) -> str:
    """Write a ledger file; return its digest."""
    record = {
        "settings": ledger.settings,
        "clips": {column: [getattr(row, column) for row in ledger.rows] for column in _COLUMNS},
        "repairs": _repaired_rows(ledger.rows),
        "failures": [[failure.name, failure.reason] for failure in ledger.failures],
        "store": ledger.store,
    }
    text = json.dumps(record, separators=(",", ":"))
    data = lzma.compress(text.encode("ascii"), preset=9 | lzma.PRESET_EXTREME)
    write_whole(path, data)
    return digest(data)


def read_ledger(path: Path, expected: str) -> Ledger:
    """Return the ledger in ``path``, whose digest must be ``expected``; `DamagedError` if not."""
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise DamagedError(f"cannot be read ({problem.strerror})", file=path) from problem
    if digest(data) != expected:
        raise DamagedError(
            "is not the ledger that was published", file=path, advice="Restore it from a copy"
        )
    try:
        record = json.loads(lzma.decompress(data))
        clips = [record["clips"][column] for column in _COLUMNS]
        repairs = _repairs(record["repairs"], clips[0])
        rows = tuple(
            Row(**dict(zip(_COLUMNS, values, strict=True)), repairs=repairs.get(number, ()))
            for number, values in enumerate(zip(*clips, strict=True))
        )
        failures = tuple(Failure(name, reason) for name, reason in record["failures"])
        return Ledger(record["settings"], rows, failures, record["store"])
    except (ValueError, KeyError, TypeError, lzma.LZMAError) as problem:
        raise DamagedError(f"is not a ledger ({problem})", file=path) from problem


def _repaired_rows(rows: Sequence[Row]) -> list[list[Any]]:
    """Return [[place, what] pairs, numbers of rows]: many clips share their repairs."""
    found: dict[tuple[Repair, ...], list[int]] = {}
    for number, row in enumerate(rows):
        if row.repairs:
            found.setdefault(row.repairs, []).append(number)
    return [
        [[[repair.place, repair.what] for repair in repairs], numbers]
        for repairs, numbers in found.items()
    ]


def _repairs(record: Any, names: Sequence[str]) -> dict[int, tuple[Repair, ...]]:
    """Return repairs by row number; earlier motifolds kept pairs by clip name."""
    if isinstance(record, dict):
        record = [[record[name], [row]] for row, name in enumerate(names) if name in record]
    return {
        number: tuple(Repair(what, place) for place, what in pairs)
        for pairs, numbers in record
        for number in numbers
    }
