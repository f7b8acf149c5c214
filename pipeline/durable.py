"""Files that are whole or not there at all."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..codec.errors import ArchiveError

NAME_DIGITS = 8
"""Hexadecimal digits by which ledgers name files; those of earlier motifolds have 12 or 16."""

PARTIAL = ".*.part"
"""Files that a crash left half written have names like this."""


def write_whole(path: Path, data: bytes) -> None:
    """Write ``data`` to ``path`` so that a reader, or a crash, sees all of it or none.

    Goes through a temporary name in the same folder (see `PARTIAL`); the bytes are on disk
    before the name is. Raises `ArchiveError`.
    """
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            with partial.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raise what goes wrong with the disk in the block as an `ArchiveError` about ``path``."""
    try:
        yield
    except OSError as problem:
        raise ArchiveError(
            f"cannot be written ({problem.strerror or problem})",
            file=path,
            advice="Check its permissions and the free space",
        ) from problem


def sync(path: Path) -> None:
    """Make a file, or the names in a folder, durable."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def digest(data: bytes) -> str:
    """Return the 64-bit BLAKE2b digest of ``data`` as 16 hexadecimal digits."""
    return hashlib.blake2b(data, digest_size=8).hexdigest()


def name_of(data: bytes) -> str:
    """Return what a ledger calls ``data``: the first 8 digits of its digest."""
    return digest(data)[:NAME_DIGITS]


def is_named(data: bytes, name: str) -> bool:
    """Return whether ``name``, of 8 digits or more, is the beginning of the digest of ``data``."""
    return len(name) >= NAME_DIGITS and digest(data).startswith(name)


def folder_bytes(folder: Path) -> int:
    """Return the size of all files below ``folder``, in bytes."""
    sizes = 0
    for path in folder.rglob("*"):
        with suppress(FileNotFoundError):  # a writer may be at work
            sizes += path.stat().st_size if path.is_file() else 0
    return sizes
