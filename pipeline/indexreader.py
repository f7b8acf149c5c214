"""Reading one index file of an archive, of whatever version."""

from __future__ import annotations

from pathlib import Path
from typing import overload

from ..codec.anyfile import unpack_any
from ..codec.errors import DamagedError, MotifoldError
from ..codec.version1.index_file import IndexFile
from ..codec.version2.motionfile import MotionFile

PAGE = 4096  # bytes: what a file system reads at the least


class PagedFile:
    """The bytes of a file, of which only the pages that are asked for are read, once each.

    Raises `DamagedError` where it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self._size = path.stat().st_size
        except OSError as problem:
            raise _unreadable(path, problem) from problem
        self._pages: dict[int, bytes] = {}

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, index: int, /) -> int: ...
    @overload
    def __getitem__(self, index: slice, /) -> bytes: ...
    def __getitem__(self, index: int | slice, /) -> int | bytes:
        if isinstance(index, int):
            return self[index : index + 1][0]
        start, stop, _ = index.indices(self._size)
        first, last = start // PAGE, max(-(-stop // PAGE), start // PAGE)
        self._fetch(first, last)
        found = b"".join(self._pages[page] for page in range(first, last))
        return found[start - first * PAGE : max(stop, start) - first * PAGE]

    def _fetch(self, first: int, last: int) -> None:
        """Read the pages from ``first`` to ``last`` that are missing, at one go."""
        missing = [page for page in range(first, last) if page not in self._pages]
        if not missing:
            return
        low, high = missing[0], missing[-1] + 1
        try:
            with self._path.open("rb") as file:
                file.seek(low * PAGE)
                data = file.read((high - low) * PAGE)
        except OSError as problem:
            raise _unreadable(self._path, problem) from problem
        for page in range(low, high):
            at = (page - low) * PAGE
            self._pages[page] = data[at : at + PAGE]

    @property
    def read(self) -> int:
        """Bytes that were read so far."""
        return sum(map(len, self._pages.values()))


def read_index(
    path: Path, *, prefix_only: bool = False, piecewise: bool = False
) -> IndexFile | MotionFile:
    """Return an index file, checked; ``piecewise``: see `unpack_motion`.

    Of the preview's prefix, and piecewise, only the pages of the file that are needed are read.
    Raises `DamagedError` or `VersionError`.
    """
    try:
        data = PagedFile(path)
        return unpack_any(data, prefix_only=prefix_only, piecewise=piecewise)
    except MotifoldError as problem:
        raise problem.within(path) from problem


def _unreadable(path: Path, problem: OSError) -> DamagedError:
    return DamagedError(
        f"the index file {path.name} cannot be read ({problem.strerror})",
        file=path,
        advice="Restore it from a copy",
    )
