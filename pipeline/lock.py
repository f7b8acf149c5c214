"""One writer an archive: a lock file that says who holds it."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..codec.errors import BusyError

NAME = ".writer.lock"
_BOOT = Path("/proc/sys/kernel/random/boot_id")


@contextmanager
def writer_lock(archive: Path) -> Iterator[None]:
    """Hold the archive's writer lock; raises `BusyError` while another process holds it.

    A lock left by a process of this host that is no longer alive, or by an earlier boot of it,
    is taken over.
    """
    archive.mkdir(parents=True, exist_ok=True)
    path = archive / NAME
    holder = {"host": socket.gethostname(), "pid": os.getpid(), "boot": _boot()}
    while True:
        try:
            handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY)
            break
        except FileExistsError:
            _remove_if_stale(path)
    with os.fdopen(handle, "w") as file:
        json.dump(holder, file)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def _remove_if_stale(path: Path) -> None:
    try:
        text = path.read_text()
    except FileNotFoundError:
        return
    try:
        holder = json.loads(text)
        host, pid, boot = holder["host"], int(holder["pid"]), holder["boot"]
    except (ValueError, KeyError, TypeError):
        host, pid, boot = "an unknown host", 0, ""
    here = host == socket.gethostname()
    if here and (boot != _boot() or not _alive(pid)):
        path.unlink(missing_ok=True)
        return
    raise BusyError(
        f"being written by process {pid} on {host}",
        file=path.parent,
        advice=f"Wait for it; if it is gone, delete {path}",
    )


def _alive(pid: int) -> bool:
    with suppress(PermissionError):  # somebody else's process: alive
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
    return True


def _boot() -> str:
    return _BOOT.read_text().strip() if _BOOT.exists() else ""
