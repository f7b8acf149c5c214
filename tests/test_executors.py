"""Executors: order, a bounded window, poisoned tasks, clusters that come and go."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from threadpoolctl import threadpool_info

from motifold.codec.errors import FormatError, MotifoldError, SchedulerError
from motifold.pipeline import executors
from motifold.pipeline.executors import (
    WINDOW,
    DaskExecutor,
    Executor,
    SerialExecutor,
    executor,
    map_batches,
)

SCHEDULER = """
import asyncio
from distributed import Scheduler
async def run():
    async with Scheduler(port=0, host="127.0.0.1", dashboard_address="127.0.0.1:0") as running:
        print(running.address, flush=True)
        await running.finished()
asyncio.run(run())
"""

WORKER = "--no-nanny --nthreads 1 --no-dashboard"


@pytest.fixture(scope="module")
def pair() -> Iterator[Executor]:
    """Two worker processes of our own, for tasks that kill."""
    with executor(2) as engine:
        yield engine


@pytest.fixture(params=["serial", "dask"])
def engine(request: pytest.FixtureRequest) -> Executor:
    """Every engine must do what these tests say."""
    found: Executor = (
        SerialExecutor() if request.param == "serial" else request.getfixturevalue("pair")
    )
    return found


@pytest.fixture
def scheduler() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A scheduler in another process, without workers: its address and its process."""
    process = subprocess.Popen(
        [sys.executable, "-c", SCHEDULER],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    yield process.stdout.readline().strip(), process
    process.kill()
    process.wait()


def never(_: object) -> Any:
    raise AssertionError("nothing was lost")


def late_square(number: int, wait: float) -> int:
    time.sleep(wait if number % 3 == 0 else 0.0)
    return number * number


def joined(item: str, left: str, right: dict[str, str]) -> str:
    return left + item + right["end"]


def refuse(number: int) -> int:
    if number == 2:
        raise FormatError("torn", file="a.bvh", place=f"line {number}")
    return number


def fail(kind: type[Exception]) -> None:
    raise kind("the task's own")


def threads(_: int) -> list[int]:
    return [int(pool["num_threads"]) for pool in threadpool_info()]


def deadly(number: int, killers: set[int], diary: str) -> int:
    """Note the call in a diary; die of some numbers, and let others be under way meanwhile."""
    with Path(diary).open("a") as file:
        file.write(f"{number}\n")
    if number in killers:
        time.sleep(0.1)
        os._exit(1)
    time.sleep(0.03)
    return number


def deadly_batch(batch: list[int], killers: set[int]) -> list[int]:
    if killers & set(batch):
        os._exit(1)
    return batch


def test_results_come_in_the_order_of_the_items(engine: Executor) -> None:
    found = engine.map_ordered(late_square, range(20), 0.05, lost=never)
    assert list(found) == [number * number for number in range(20)]


def test_no_items_give_no_results(engine: Executor) -> None:
    assert list(engine.map_ordered(late_square, [], 0.0, lost=never)) == []


def test_shared_values_arrive_whole(engine: Executor) -> None:
    found = engine.map_ordered(joined, ["a", "b"], "<", {"end": ">"}, lost=never)
    assert list(found) == ["<a>", "<b>"]


def test_errors_come_through_with_what_they_say(engine: Executor) -> None:
    results = engine.map_ordered(refuse, range(5), lost=never)
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(FormatError, match=r"a\.bvh, line 2: torn") as caught:
        next(results)
    assert caught.value.place == "line 2"


@pytest.mark.parametrize("kind", [TimeoutError, PermissionError, ValueError])
def test_a_task_s_own_error_is_not_taken_for_the_cluster_s(
    engine: Executor, kind: type[Exception]
) -> None:
    with pytest.raises(kind, match="the task's own"):
        list(engine.map_ordered(fail, [kind], lost=never))


def test_linear_algebra_has_one_thread(engine: Executor) -> None:
    for found in engine.map_ordered(threads, range(2), lost=never):
        assert set(found) <= {1}


def test_only_a_window_of_items_is_taken_ahead(engine: Executor) -> None:
    taken = 0

    def items() -> Iterator[int]:
        nonlocal taken
        for number in range(100):
            taken = number + 1
            yield number

    workers = 2 if isinstance(engine, DaskExecutor) else 0
    results = engine.map_ordered(late_square, items(), 0.0, lost=never)
    for done, _ in enumerate(results, 1):
        assert taken <= done + WINDOW * workers


def test_one_worker_or_none_needs_no_cluster() -> None:
    for workers in (0, 1):
        with executor(workers) as engine:
            assert isinstance(engine, SerialExecutor)


def test_a_deadly_task_is_tried_again_alone_and_then_lost(pair: Executor, tmp_path: Path) -> None:
    diary = tmp_path / "diary"
    killers = {3, 4}
    found = list(
        pair.map_ordered(deadly, range(10), killers, str(diary), lost=lambda number: -number)
    )
    assert found == [-number if number in killers else number for number in range(10)]
    calls = [int(line) for line in diary.read_text().split()]
    assert set(calls) == set(range(10))
    assert calls.count(3) == 2
    assert calls.count(4) <= 2, "the death of 3 may have kept 4 from its first try"


def test_a_worker_s_death_costs_no_other_item_of_the_batch(pair: Executor) -> None:
    batches = [[1, 2], [3, 4, 5], [6], [7]]
    found = map_batches(pair, deadly_batch, batches, {4, 6}, lost=lambda batch: [-n for n in batch])
    assert list(found) == [
        ([1, 2], [1, 2]),
        ([3], [3]),
        ([4], [-4]),
        ([5], [5]),
        ([6], [-6]),
        ([7], [7]),
    ]


def test_no_worker_of_ours_is_given_up(pair: Executor) -> None:
    """Dask would close the nanny of one that has died twice within some seconds."""
    from dask import config, utils

    assert isinstance(pair, DaskExecutor)
    assert utils.parse_timedelta(config.get("distributed.deploy.lost-worker-timeout")) > 1e6


def test_a_cluster_that_runs_already_is_used(cluster: Any) -> None:
    with executor(scheduler=cluster.scheduler_address) as engine:
        assert isinstance(engine, DaskExecutor)
        found = list(engine.map_ordered(late_square, range(9), 0.01, lost=never))
    assert found == [number * number for number in range(9)]
    assert len(cluster.scheduler_info["workers"]) == 3, "it is not ours to stop"


@pytest.mark.parametrize("address", ["", "nonsense://x", "tcp://127.0.0.1:{free}"])
def test_an_address_without_a_scheduler_is_told_soon(
    monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    monkeypatch.setattr(executors, "PATIENCE", 1.0)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        free = probe.getsockname()[1]
    start = time.monotonic()
    with (
        pytest.raises(SchedulerError, match="no Dask scheduler at"),
        executor(scheduler=address.format(free=free)),
    ):
        pass
    assert time.monotonic() - start < 10


def test_a_scheduler_without_workers_is_told_soon(
    monkeypatch: pytest.MonkeyPatch, scheduler: tuple[str, Any]
) -> None:
    monkeypatch.setattr(executors, "PATIENCE", 1.0)
    with (
        executor(scheduler=scheduler[0]) as engine,
        pytest.raises(SchedulerError, match="no workers"),
    ):
        list(engine.map_ordered(late_square, range(3), 0.0, lost=never))


def test_a_scheduler_that_dies_is_told(
    monkeypatch: pytest.MonkeyPatch, scheduler: tuple[str, Any]
) -> None:
    monkeypatch.setattr(executors, "PATIENCE", 1.0)
    address, process = scheduler
    worker = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_worker", address, *WORKER.split()],
        stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    )
    try:
        monkeypatch.setattr(executors, "PATIENCE", 20.0)
        with executor(scheduler=address) as engine:
            results = engine.map_ordered(late_square, [0, 3, 6, 9, 12], 0.3, lost=never)
            assert next(results) == 0
            process.kill()
            with pytest.raises(MotifoldError, match="the archive is unharmed") as caught:
                list(results)
            assert isinstance(caught.value, SchedulerError)
    finally:
        worker.kill()
        worker.wait()
