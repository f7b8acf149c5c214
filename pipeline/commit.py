"""COMMIT.json, the only file of an archive that ever changes, and what it points to.

A job writes everything under new names, makes it durable, and publishes it by replacing
COMMIT.json. Readers look at it once. What a published generation points to never changes.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from ..codec.errors import DamagedError, NotAnArchiveError, UsageError, VersionError
from .durable import sync, write_whole

FORMAT = 1
NAME = "COMMIT.json"


@dataclass(frozen=True)
class Job:
    """One published job, which is one generation of the store.

    ``ledger``: digest of its ledger file. ``rigs``: number of rigs in the store after it;
    ``patterns``: per rig family and part, the number of patterns after it.
    """

    generation: int
    ledger: str
    clips: int
    rigs: int
    patterns: dict[str, list[int]]


@dataclass(frozen=True)
class Commit:
    """The state of an archive: its jobs, oldest first."""

    jobs: tuple[Job, ...] = field(default=())

    @property
    def generation(self) -> int:
        """Number of the last published generation; 0 for an empty archive."""
        return self.jobs[-1].generation if self.jobs else 0

    def job(self, generation: int) -> Job:
        """Return the job of a generation. Raises `DamagedError` if there is none."""
        for job in self.jobs:
            if job.generation == generation:
                return job
        raise DamagedError(f"names generation {generation} of {self.generation}")


def read_commit(archive: Path) -> Commit:
    """Return the state of the archive in folder ``archive``.

    Raises `NotAnArchiveError`, `VersionError` or `DamagedError`.
    """
    path = archive / NAME
    try:
        text = path.read_text("utf-8")
    except (FileNotFoundError, NotADirectoryError):
        raise NotAnArchiveError(
            "no motifold archive", file=archive, advice="Make one with: motifold archive"
        ) from None
    except (OSError, UnicodeDecodeError) as problem:
        raise DamagedError(f"cannot be read ({problem})", file=path) from problem
    try:
        record: dict[str, Any] = json.loads(text)
        version = record["format"]
        if version != FORMAT:
            raise VersionError(
                f"archive format {version}; this motifold reads format {FORMAT}",
                file=path,
                advice="Use a newer motifold",
            )
        return Commit(tuple(Job(**job) for job in record["jobs"]))
    except (ValueError, KeyError, TypeError) as problem:
        raise DamagedError(
            f"is not a commit record ({problem})", file=path, advice="Restore it from a copy"
        ) from problem


def read_or_start(archive: Path) -> Commit:
    """Return the state of the archive in folder ``archive``, which is begun if that is empty.

    A job removes what an interrupted one left, so it must not take another folder, or an
    archive that lost its COMMIT.json, for an archive of its own: raises `UsageError`.
    """
    try:
        return read_commit(archive)
    except NotAnArchiveError:
        strangers = sorted(p.name for p in archive.iterdir() if not p.name.startswith("."))
    if strangers:
        raise UsageError(
            f"is no archive (no {NAME}), but holds {', '.join(strangers[:3])}",
            file=archive,
            advice="Name a new folder or an empty one",
        )
    publish(archive, Commit())
    return Commit()


def publish(archive: Path, commit: Commit) -> None:
    """Make ``commit`` the state of the archive, atomically and durably."""
    record = {"format": FORMAT, "jobs": [asdict(job) for job in commit.jobs]}
    write_whole(archive / NAME, (json.dumps(record, indent=1, sort_keys=True) + "\n").encode())
    sync(archive)
