"""Whole files: a reader, or a crash, sees all of one or nothing."""

from __future__ import annotations

import os
import shutil
import subprocess
import threading
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.errors import ArchiveError
from motifold.pipeline.durable import PARTIAL, digest, folder_bytes, sync, write_whole


def test_a_file_is_written_with_its_folders_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "c.bin"
    for data in (b"old", b"newer", b""):
        write_whole(path, data)
        assert path.read_bytes() == data
    assert list(path.parent.iterdir()) == [path]


def test_the_bytes_are_on_disk_before_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    write_whole(path, b"old")
    seen: list[bytes] = []
    real = os.fsync

    def fsync(handle: int) -> None:
        (partial,) = tmp_path.glob(PARTIAL)
        seen.extend([path.read_bytes(), partial.read_bytes()])
        real(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    write_whole(path, b"new")
    assert seen == [b"old", b"new"]


def test_what_goes_wrong_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    write_whole(path, b"old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ArchiveError, match=r"file: cannot be written \(No space left on device\)"):
        write_whole(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_in_the_place_of_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(ArchiveError, match="cannot be written"):
        write_whole(tmp_path / "file" / "below", b"")


def test_readers_never_see_half_a_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    contents = {bytes([value]) * 200_000 for value in range(2)}
    write_whole(path, min(contents))
    done = threading.Event()

    def write() -> None:
        for _ in range(15):
            for content in contents:
                write_whole(path, content)
        done.set()

    writer = threading.Thread(target=write)
    writer.start()
    seen = []
    while not done.is_set():
        seen.append(path.read_bytes())
    writer.join()
    assert set(seen) <= contents


def test_sync_takes_files_and_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_bytes(b"x")
    synced: list[tuple[int, int]] = []

    def fsync(handle: int) -> None:
        status = os.fstat(handle)
        synced.append((status.st_dev, status.st_ino))

    monkeypatch.setattr(os, "fsync", fsync)
    for path in (tmp_path, tmp_path / "file"):
        sync(path)
        assert synced[-1] == (path.stat().st_dev, path.stat().st_ino)


@given(st.binary(max_size=300))
def test_a_digest_is_that_of_b2sum(data: bytes) -> None:
    tool: Any = shutil.which("b2sum")
    if tool is None:
        pytest.skip("needs b2sum")
    out = subprocess.run([tool, "-l", "64"], input=data, capture_output=True, check=True)
    assert digest(data) == out.stdout.split()[0].decode()


def test_folder_bytes_counts_every_file_once(tmp_path: Path) -> None:
    for number, name in enumerate(("a", "b/c", "b/d/e", ".hidden")):
        write_whole(tmp_path / name, b"x" * 10**number)
    assert folder_bytes(tmp_path) == 1111


def test_folder_bytes_bears_files_that_vanish(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_whole(tmp_path / "stays", b"x" * 5)
    real = Path.rglob

    def rglob(self: Path, pattern: str) -> list[Path]:
        return [*real(self, pattern), self / "vanished"]

    monkeypatch.setattr(Path, "rglob", rglob)
    monkeypatch.setattr(Path, "is_file", lambda _: True)
    assert folder_bytes(tmp_path) == 5
