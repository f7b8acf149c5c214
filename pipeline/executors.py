"""Engines that run a plan's tasks: in this process, or on Dask workers.

An executor maps a function over items and yields the results in the items' order, so that
whoever consumes them gets the same sequence whatever the number of workers and the order in
which they finish. Only a bounded window of results exists at any time.
"""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from ..codec.errors import SchedulerError

Item = TypeVar("Item")
Result = TypeVar("Result")

WINDOW = 4  # batches under way per worker


class Executor(Protocol):
    """Maps a function over items, in order."""

    def map_ordered(
        self,
        function: Callable[..., Result],
        items: Iterable[Item],
        *shared: Any,
        lost: Callable[[Item], Result],
    ) -> Iterator[Result]:
        """Yield ``function(item, *shared)`` for each item, in order.

        ``shared`` values are sent to each worker once. ``lost(item)`` stands in for the result
        of an item that kills its worker twice, alone the second time.
        """
        ...


def one_thread(function: Callable[..., Result], *arguments: Any) -> Result:
    """Call a task with one-threaded linear algebra: sums come out alike on any machine."""
    with threadpool_limits(1):
        return function(*arguments)


class SerialExecutor:
    """Runs every task in this process, one after the other: for debugging, and one worker."""

    def map_ordered(
        self,
        function: Callable[..., Result],
        items: Iterable[Item],
        *shared: Any,
        lost: Callable[[Item], Result],
    ) -> Iterator[Result]:
        """Yield the results; see `Executor`. Nothing is ever lost."""
        del lost
        for item in items:
            yield one_thread(function, item, *shared)


class DaskExecutor:
    """Runs tasks on the workers of a Dask client, a window of them ahead."""

    def __init__(self, client: Any) -> None:
        self._client = client

    def map_ordered(
        self,
        function: Callable[..., Result],
        items: Iterable[Item],
        *shared: Any,
        lost: Callable[[Item], Result],
    ) -> Iterator[Result]:
        """Yield the results; see `Executor`. Raises `SchedulerError` if the cluster is gone."""
        # in a list of one, because a dict would be taken apart and scattered by its keys
        sent = [self._client.scatter([value], broadcast=True, hash=False)[0] for value in shared]
        waiting: deque[tuple[Item, Any]] = deque()
        window = WINDOW * max(1, len(self._client.nthreads()))
        source = iter(items)
        while True:
            while len(waiting) < window:
                try:
                    item = next(source)
                except StopIteration:
                    break
                waiting.append((item, self._submit(function, item, sent)))
            if not waiting:
                return
            yield self._result(function, *waiting.popleft(), sent, lost)

    def _submit(self, function: Callable[..., Result], item: Item, sent: list[Any]) -> Any:
        return self._client.submit(one_thread, function, item, *sent, pure=False)

    def _result(
        self,
        function: Callable[..., Result],
        item: Item,
        future: Any,
        sent: list[Any],
        lost: Callable[[Item], Result],
    ) -> Result:
        from distributed import KilledWorker

        # a task that kills its worker also takes down its innocent neighbours: try once more
        for attempt in (future, None):
            waited = self._submit(function, item, sent) if attempt is None else attempt
            try:
                result: Result = self._wait(waited)
                return result
            except KilledWorker:
                continue
        return lost(item)

    def _wait(self, future: Any) -> Any:
        from dask.utils import parse_timedelta
        from distributed import TimeoutError as DaskTimeoutError
        from distributed.comm import CommClosedError

        patience = parse_timedelta("10s")
        while True:
            try:
                return future.result(timeout=patience)
            except DaskTimeoutError:
                self._check_cluster()
            except (CommClosedError, OSError) as problem:
                raise SchedulerError(
                    f"the Dask scheduler is gone ({problem})",
                    advice="Start it again and run the same command; the archive is unharmed",
                ) from problem

    def _check_cluster(self) -> None:
        """Raise `SchedulerError` if nobody is left to finish the work."""
        try:
            alive = self._client.status == "running" and self._client.scheduler_info()["workers"]
        except OSError:
            alive = False
        if not alive:
            raise SchedulerError(
                "the Dask scheduler has no workers left",
                advice="Start workers and run the same command; the archive is unharmed",
            )


@contextmanager
def executor(workers: int | None = None, scheduler: str | None = None) -> Iterator[Executor]:
    """Yield an executor: on a scheduler's address, on local worker processes, or serial.

    ``workers``: local processes (None: one per core); 0 or 1 means serial, in this process.
    ``scheduler``: address of a running Dask scheduler, such as ``tcp://host:8786``, whose
    workers see the library under the same paths. Raises `SchedulerError`.
    """
    count = workers if workers is not None else (os.cpu_count() or 1)
    if scheduler is None and count <= 1:
        yield SerialExecutor()
        return
    from distributed import Client, LocalCluster

    if scheduler is not None:
        try:
            client = Client(scheduler, timeout="10s", set_as_default=False)
        except (OSError, ValueError) as problem:
            raise SchedulerError(
                f"no Dask scheduler at {scheduler} ({problem})",
                advice="Start one with: dask scheduler",
            ) from problem
        with client:
            yield DaskExecutor(client)
        return
    with (
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield DaskExecutor(client)
