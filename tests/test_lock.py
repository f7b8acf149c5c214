"""The writer's lock: one at a time, and the dead do not block the living."""

from __future__ import annotations

import fcntl
import json
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from motifold.codec.errors import ArchiveError, BusyError
from motifold.pipeline.lock import NAME, writer_lock

HOLD = """
import sys
from pathlib import Path
from motifold.pipeline.lock import writer_lock
with writer_lock(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def holder_of(archive: Path) -> dict[str, Any]:
    record: dict[str, Any] = json.loads((archive / NAME).read_text())
    return record


def leave(archive: Path, **changes: object) -> None:
    """Leave the lock that this process would, with changes."""
    with writer_lock(archive):
        record = holder_of(archive)
    (archive / NAME).write_text(json.dumps(record | changes))


def dead_process() -> int:
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return child.pid


def test_the_lock_says_who_holds_it_and_goes(tmp_path: Path) -> None:
    archive = tmp_path / "new" / "archive"
    with writer_lock(archive):
        record = holder_of(archive)
    assert (record["host"], record["pid"]) == (socket.gethostname(), os.getpid())
    assert list(archive.iterdir()) == []


def test_it_goes_when_the_job_fails(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), writer_lock(tmp_path):
        _ = 1 // 0
    assert not (tmp_path / NAME).exists()


def test_a_second_writer_is_refused_whoever_it_is(tmp_path: Path) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == b"held\n"
    with pytest.raises(BusyError, match=f"process {child.pid} on .*Wait for it"):
        writer_lock(tmp_path).__enter__()
    child.communicate(b"")
    with writer_lock(tmp_path), pytest.raises(BusyError):
        writer_lock(tmp_path).__enter__()  # the same process, too


def test_many_threads_take_turns(tmp_path: Path) -> None:
    inside, most, taken = 0, 0, 0
    guard = threading.Lock()

    def work() -> None:
        nonlocal inside, most, taken
        for _ in range(50):
            try:
                with writer_lock(tmp_path):
                    with guard:
                        inside += 1
                        most, taken = max(most, inside), taken + 1
                    with guard:
                        inside -= 1
            except BusyError:
                pass

    threads = [threading.Thread(target=work) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1
    assert taken > 0


def test_the_lock_of_a_dead_process_is_taken_over(tmp_path: Path) -> None:
    leave(tmp_path, pid=dead_process())
    with writer_lock(tmp_path):
        assert holder_of(tmp_path)["pid"] == os.getpid()
    assert not (tmp_path / NAME).exists()


def test_the_lock_of_an_earlier_boot_is_taken_over(tmp_path: Path) -> None:
    leave(tmp_path, boot="an earlier one")
    with writer_lock(tmp_path):
        assert holder_of(tmp_path)["boot"] != "an earlier one"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_another_process_with_the_number_of_the_dead_one_does_not_hold_it(tmp_path: Path) -> None:
    leave(tmp_path, started="12")  # as in a container, where the job always has the same number
    with writer_lock(tmp_path):
        pass


def test_the_lock_of_another_host_is_respected(tmp_path: Path) -> None:
    leave(tmp_path, host="elsewhere", pid=dead_process(), boot="its own")
    before = (tmp_path / NAME).read_bytes()
    with pytest.raises(BusyError, match="on elsewhere"):
        writer_lock(tmp_path).__enter__()
    assert (tmp_path / NAME).read_bytes() == before


@pytest.mark.parametrize("text", ["", "{", "[]", '{"host": 1}', '{"host": "x", "pid": null}'])
def test_a_lock_that_nobody_can_read_is_respected(tmp_path: Path, text: str) -> None:
    (tmp_path / NAME).write_text(text)
    with pytest.raises(BusyError, match=r"unknown host.*delete .*\.writer\.lock"):
        writer_lock(tmp_path).__enter__()


def test_who_takes_over_second_does_not_remove_the_lock_of_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave(tmp_path, host="elsewhere")
    winner = (tmp_path / NAME).read_text()
    (tmp_path / NAME).unlink()
    leave(tmp_path, pid=dead_process())
    real = fcntl.flock

    def flock(file: Any, how: int) -> None:
        real(file, how)
        if (tmp_path / NAME).read_text() != winner:  # another process was faster
            (tmp_path / NAME).unlink()
            (tmp_path / NAME).write_text(winner)

    monkeypatch.setattr(fcntl, "flock", flock)
    with pytest.raises(BusyError, match="on elsewhere"):
        writer_lock(tmp_path).__enter__()
    assert (tmp_path / NAME).read_text() == winner


def test_a_file_is_no_place_for_an_archive(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ArchiveError, match="cannot be written"):
        writer_lock(tmp_path / "file").__enter__()
    assert (tmp_path / "file").read_text() == "mine"
