"""One writer an archive: a lock file that says who holds it."""

from __future__ import annotations

import fcntl
import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..codec.errors import BusyError
from .durable import writing

NAME = ".writer.lock"
_BOOT = Path("/proc/sys/kernel/random/boot_id")


@contextmanager
def writer_lock(archive: Path) -> Iterator[None]:
    """Hold the archive's writer lock; raises `BusyError` while another process holds it.

    A lock left by a process of this host that is no longer alive, or by an earlier boot of it,
    is taken over.
    """
    path = archive / NAME
    with writing(archive):
        archive.mkdir(parents=True, exist_ok=True)
        while True:
            try:
                handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
                break
            except FileExistsError:
                _remove_if_stale(path)
        with os.fdopen(handle, "w") as file:
            json.dump(_this_process(), file)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)


def _this_process() -> dict[str, Any]:
    pid = os.getpid()
    return {"host": socket.gethostname(), "pid": pid, "boot": _boot(), "started": _started(pid)}


def _remove_if_stale(path: Path) -> None:
    with suppress(FileNotFoundError), path.open() as file:
        # one at a time: who comes second must not remove the lock of who came first
        fcntl.flock(file, fcntl.LOCK_EX)
        if not os.path.samestat(os.fstat(file.fileno()), path.stat()):
            return
        try:
            holder = json.loads(file.read())
            host, pid = holder["host"], int(holder["pid"])
            boot, started = holder["boot"], holder["started"]
        except (ValueError, KeyError, TypeError):
            host, pid, boot, started = "an unknown host", 0, "", ""
        if host == socket.gethostname() and (boot != _boot() or not _alive(pid, started)):
            path.unlink()
            return
        raise BusyError(
            f"being written by process {pid} on {host}",
            file=path.parent,
            advice=f"Wait for it; if it is gone, delete {path}",
        )


def _alive(pid: int, started: str) -> bool:
    """Return whether the process is there, and is not another one with the same number."""
    with suppress(PermissionError):  # somebody else's process: alive
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
    return _started(pid) == started


def _started(pid: int) -> str:
    """Return when a process started, in ticks since boot; empty where the system does not say."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19]
    except (OSError, IndexError):
        return ""


def _boot() -> str:
    return _BOOT.read_text().strip() if _BOOT.exists() else ""
