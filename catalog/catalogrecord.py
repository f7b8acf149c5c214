"""CATALOG.json: what of an archive's catalog is current.

Read on the way to every search, so nothing here imports the pipeline.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..codec.errors import DamagedError, NotAnArchiveError, VersionError

FOLDER = "catalog"
NAME = "CATALOG.json"
FORMAT = 3
READABLE = 2, 3  # of 2, every batch is large
REBUILD = "Make it again with: motifold index --rebuild"


@dataclass(frozen=True)
class FileRecord:
    """The size and digest that a file of the catalog was published with."""

    size: int
    digest: str


@dataclass(frozen=True)
class BatchRecord:
    """What CATALOG.json says of a batch; ``sizes``: the words of each kind that it knew."""

    folder: str
    clips: int
    passages: int
    sizes: dict[str, int]
    files: dict[str, FileRecord]


@dataclass(frozen=True)
class CatalogRecord:
    """The contents of CATALOG.json.

    ``ledger``: digest of the archive's newest ledger when it was written. ``replaced``: names
    and index files of clips that newer ones replaced; ``left_out``: clips without words, with
    the reason.
    """

    ledger: str = ""
    vocabulary: str = ""
    vocabulary_file: FileRecord = FileRecord(0, "")
    batches: tuple[BatchRecord, ...] = ()
    replaced: tuple[tuple[str, str], ...] = ()
    left_out: dict[str, str] = field(default_factory=dict)


def read_record(archive: Path) -> CatalogRecord | None:
    """Return the contents of CATALOG.json, or None if there is none. Raises `DamagedError`."""
    path = archive / FOLDER / NAME
    try:
        record = json.loads(path.read_text("utf-8"))
        if record["format"] not in READABLE:
            written = record["format"]
            raise VersionError(
                f"catalog format {written}; this motifold reads {FORMAT}",
                file=path,
                advice=REBUILD,
            )
        batches = tuple(
            BatchRecord(
                each["folder"],
                each["clips"],
                each["passages"],
                each["sizes"],
                _files(each["files"]),
            )
            for each in record["batches"]
        )
        vocabulary = FileRecord(*record["vocabulary_file"])
        return CatalogRecord(
            record["ledger"],
            record["vocabulary"],
            vocabulary,
            batches,
            tuple((name, index) for name, index in record["replaced"]),
            record["left_out"],
        )
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise DamagedError(f"is no catalog ({problem})", file=path, advice=REBUILD) from problem


def record_text(record: CatalogRecord) -> str:
    """Return CATALOG.json as text."""
    values = {
        "format": FORMAT,
        "ledger": record.ledger,
        "vocabulary": record.vocabulary,
        "vocabulary_file": [record.vocabulary_file.size, record.vocabulary_file.digest],
        "batches": [
            {
                "folder": batch.folder,
                "clips": batch.clips,
                "passages": batch.passages,
                "sizes": batch.sizes,
                "files": {name: [file.size, file.digest] for name, file in batch.files.items()},
            }
            for batch in record.batches
        ],
        "replaced": list(record.replaced),
        "left_out": record.left_out,
    }
    return json.dumps(values, indent=1, sort_keys=True) + "\n"


def newest_ledger(archive: Path) -> str:
    """Return the digest of the archive's newest ledger, "" if it is empty.

    Read here and not by the pipeline, which takes longer to import than a search may take.
    Raises `NotAnArchiveError` or `DamagedError`.
    """
    path = archive / "COMMIT.json"
    try:
        jobs = json.loads(path.read_text("utf-8"))["jobs"]
        return str(jobs[-1]["ledger"]) if jobs else ""
    except (FileNotFoundError, NotADirectoryError):
        advice = "Make one with: motifold archive"
        raise NotAnArchiveError("no motifold archive", file=archive, advice=advice) from None
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise DamagedError(f"cannot be read ({problem})", file=path) from problem


def _files(record: Mapping[str, Any]) -> dict[str, FileRecord]:
    return {name: FileRecord(*values) for name, values in record.items()}
