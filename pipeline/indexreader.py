"""Reading one index file of an archive, of whatever version."""

from __future__ import annotations

from pathlib import Path

from ..codec.anyfile import unpack_any
from ..codec.errors import DamagedError, MotifoldError
from ..codec.version1.index_file import IndexFile
from ..codec.version2.motionfile import MotionFile


def read_index(path: Path, *, prefix_only: bool = False) -> IndexFile | MotionFile:
    """Return an index file, checked. Raises `DamagedError` or `VersionError`."""
    try:
        data = path.read_bytes()
    except OSError as problem:
        raise DamagedError(
            f"the index file {path.name} cannot be read ({problem.strerror})",
            file=path,
            advice="Restore it from a copy",
        ) from problem
    try:
        return unpack_any(data, prefix_only=prefix_only)
    except MotifoldError as problem:
        raise problem.within(path) from problem
