"""Walking a library: which files are clips, in one order for ever."""

from __future__ import annotations

import os
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from ..codec.errors import UsageError
from ..codec.formats.files import READABLE


@dataclass(frozen=True, order=True)
class Source:
    """One source file: ``name`` is its path inside the library, with slashes: the clip's name."""

    name: str
    path: str
    size: int


def discover(library: Path, include: Sequence[str] = ()) -> list[Source]:
    """Return the clips of a library folder (or the one file it is), ordered by name.

    ``include``: glob patterns on the name or the base name; none means every readable file.
    Links to folders are not followed. Files and folders that cannot be looked at are among the
    clips, so that reading them says why. Raises `UsageError` if there is no such folder, or
    nothing in it to archive.
    """
    if library.is_file():
        return [Source(library.name, str(library.absolute()), library.stat().st_size)]
    if not library.is_dir():
        raise UsageError("no such folder", file=library, advice="Name a folder of motion files")
    found: list[Source] = []

    def unlisted(problem: OSError) -> None:
        folder = Path(problem.filename).absolute()
        found.append(Source(folder.relative_to(library.absolute()).as_posix(), str(folder), 0))

    for folder, _, names in os.walk(library, onerror=unlisted):
        for base in names:
            path = Path(folder, base)
            name = path.relative_to(library).as_posix()
            wanted = any(fnmatch(name, glob) or fnmatch(base, glob) for glob in include)
            if path.suffix.lower() in READABLE and (wanted or not include):
                size = _size(path)
                if size is not None:
                    found.append(Source(name, str(path.absolute()), size))
    if not found:
        which = f" that match {', '.join(include)}" if include else ""
        raise UsageError(
            f"no motion files{which}",
            file=library,
            advice=f"Readable are {', '.join(sorted(READABLE))}",
        )
    return sorted(found)


def _size(path: Path) -> int | None:
    """Return a file's size, 0 if it cannot be looked at, None for what is no file (a pipe)."""
    try:
        status = path.stat()
    except OSError:
        return 0
    return status.st_size if stat.S_ISREG(status.st_mode) else None
