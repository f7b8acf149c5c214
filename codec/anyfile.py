"""Index files of every version, told apart."""

from __future__ import annotations

from .streams.envelope import Readable
from .version1.index_file import MAGIC, IndexFile, unpack
from .version2.motionfile import MotionFile, unpack_motion


def unpack_any(
    data: Readable, *, prefix_only: bool = False, piecewise: bool = False
) -> IndexFile | MotionFile:
    """Return the parts of an index file, checked; ``piecewise``: see `unpack_motion`.

    Raises `DamagedError` or `VersionError`.
    """
    if data[2:3] != MAGIC[2:]:
        return unpack_motion(data, prefix_only=prefix_only, piecewise=piecewise)
    return unpack(data[: len(data)], prefix_only=prefix_only)


def check_whole(data: bytes) -> None:
    """Raise `DamagedError` if an index file is not whole."""
    unpack_any(data)
