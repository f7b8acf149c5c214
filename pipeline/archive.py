"""An open archive: a read-only mapping from clip names to clips that decode when asked."""

from __future__ import annotations

import difflib
import threading
from collections.abc import Iterable, Iterator, Mapping
from fnmatch import fnmatch
from functools import lru_cache
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any

from ..codec.errors import DamagedError, UnknownClipError, UsageError
from ..codec.figure.rig import Rig
from ..codec.patterns.patterns import Codebook
from .archived_clip import ArchivedClip
from .commit import Commit, read_commit
from .layout import current_rows, read_ledgers
from .ledger import Ledger, Row
from .shelf import Shelf
from .store import Store, read_store


class Archive(Mapping[str, "ArchivedClip"]):
    """The clips of an archive folder, as of the moment it was opened.

    A mapping from clip name (the source's path in its library) to `ArchivedClip`, ordered by
    name. Opening reads one small file; the rest is read when it is first needed. Safe to use
    from several threads, and to send to other processes that see the same folder. Use it in a
    ``with`` block, or call `close`: a closed archive answers no more.

    Raises `NotAnArchiveError`, `VersionError` or `DamagedError`; a name that is not there
    raises `UnknownClipError`, which is a KeyError too.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.commit: Commit = read_commit(self.path)
        self._lock = threading.Lock()
        self._loaded: dict[str, Any] = {}
        self._codebooks: dict[tuple[str, int], Codebook] = {}
        self._closed = False

    def __enter__(self) -> Archive:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        problem: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of everything that was read."""
        with self._lock:
            self._closed = True
            self._loaded.clear()
            self._codebooks.clear()
        _reopened.cache_clear()

    def __reduce__(self) -> tuple[Any, ...]:
        return _reopened, (str(self.path.absolute()), _last_ledger(self.commit))

    def __getitem__(self, name: str) -> ArchivedClip:
        entry = self.rows.get(name)
        if entry is None:
            close = difflib.get_close_matches(str(name), list(self.rows), 3)
            advice = f"Did you mean {' or '.join(close)}?" if close else "See: motifold info"
            raise UnknownClipError(f"no clip {name!r}", file=self.path, advice=advice)
        return ArchivedClip(self, *entry)

    def __contains__(self, name: object) -> bool:
        return name in self.rows

    def __iter__(self) -> Iterator[str]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def find(self, text: str) -> list[str]:
        """Return the names that ``text`` means: a name, a name without suffix, or a glob.

        Raises `UnknownClipError` if it means none.
        """
        if text in self.rows:
            return [text]
        found = self.stems.get(text) or [name for name in self.rows if fnmatch(name, text)]
        return found or [self[text].name]

    @property
    def ledgers(self) -> dict[int, Ledger]:
        """The ledgers of all jobs, by generation."""
        value: dict[int, Ledger] = self._once(
            "ledgers", lambda: read_ledgers(self.path, self.commit)
        )
        return value

    @property
    def rows(self) -> dict[str, tuple[Row, int]]:
        """The current ledger row of every clip with its generation, by name."""
        ledgers = self.ledgers
        value: dict[str, tuple[Row, int]] = self._once("rows", lambda: current_rows(ledgers))
        return value

    @property
    def stems(self) -> dict[str, list[str]]:
        """The names of the clips by what is left of them without their suffix."""
        rows = self.rows
        value: dict[str, list[str]] = self._once("stems", lambda: _by_stem(rows))
        return value

    @property
    def store(self) -> Store:
        """The pattern store."""
        ledgers = self.ledgers
        value: Store = self._once("store", lambda: read_store(self.path, self.commit, ledgers))
        return value

    def codebook(self, family: str, generation: int) -> Codebook:
        """Return a rig family's patterns as of a generation."""
        counts = self.commit.job(generation).patterns.get(family)
        if counts is None:
            raise DamagedError(f"generation {generation} does not know rig family {family}")
        store = self.store
        with self._lock:
            if (family, generation) not in self._codebooks:
                self._codebooks[family, generation] = store.codebook(family, counts)
            return self._codebooks[family, generation]

    @property
    def numbered(self) -> list[Row]:
        """The rows of all jobs by clip number, replaced ones too."""
        return [row for _, ledger in sorted(self.ledgers.items()) for row in ledger.rows]

    @property
    def shelf(self) -> Shelf:
        """The decoded clips that others refer to."""
        store, ledgers = self.store, self.ledgers
        value: Shelf = self._once("shelf", lambda: Shelf.of(self.path, store, ledgers))
        return value

    def rig(self, number: int) -> Rig:
        """Return a rig by its number."""
        rigs = self.store.rigs
        if not 0 <= number < len(rigs):
            raise DamagedError(f"names rig {number} of {len(rigs)}")
        return rigs[number]

    def _once(self, key: str, read: Any) -> Any:
        with self._lock:
            if self._closed:
                raise UsageError("the archive is closed", file=self.path)
            if key not in self._loaded:
                self._loaded[key] = read()
            return self._loaded[key]


def _by_stem(names: Iterable[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(str(PurePosixPath(name).with_suffix("")), []).append(name)
    return found


def _last_ledger(commit: Commit) -> str:
    return commit.jobs[-1].ledger if commit.jobs else ""


@lru_cache(maxsize=8)
def _reopened(path: str, last_ledger: str) -> Archive:
    """Open an archive in another process, once; as of the job that was the last one when sent."""
    archive = Archive(path)
    jobs = archive.commit.jobs
    while jobs and jobs[-1].ledger != last_ledger:
        jobs = jobs[:-1]
    archive.commit = Commit(jobs)
    if _last_ledger(archive.commit) != last_ledger:
        raise DamagedError("another archive took its place", file=path, advice="Open it again")
    return archive
