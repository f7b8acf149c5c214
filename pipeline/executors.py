"""Engines that run a plan's tasks: in this process, or on Dask workers.

An executor maps a function over items and yields the results in the items' order, so that
whoever consumes them gets the same sequence whatever the number of workers and the order in
which they finish. Only a bounded window of results exists at any time.
"""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Any, Protocol, TypeVar

from threadpoolctl import threadpool_limits

from ..codec.errors import SchedulerError

Item = TypeVar("Item")
Result = TypeVar("Result")

WINDOW = 4  # batches under way per worker
PATIENCE = 10.0  # seconds without news, after which the cluster is looked at
RESTART = 6.0  # times as long, on a busy machine, until a worker that died is back
_SENDINGS = 5  # tries
# Ctrl-C reaches every process of a terminal; this one stops the others in good order
_DEAF = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"


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


def map_batches(
    engine: Executor,
    function: Callable[..., Result],
    batches: Sequence[Sequence[Item]],
    *shared: Any,
    lost: Callable[[Sequence[Item]], Result],
) -> Iterator[tuple[Sequence[Item], Result]]:
    """Yield (batch, ``function(batch, *shared)``) for each batch, in order.

    A batch that kills its worker is taken apart and tried again item by item, so that one bad
    file does not cost its neighbours; see `Executor.map_ordered` for the rest.
    """
    results: Iterator[Result | None] = engine.map_ordered(
        function, batches, *shared, lost=lambda batch: lost(batch) if len(batch) == 1 else None
    )
    for batch, result in zip(batches, results, strict=True):
        if result is not None:
            yield batch, result
            continue
        singles = [batch[place : place + 1] for place in range(len(batch))]
        again = engine.map_ordered(function, singles, *shared, lost=lost)
        yield from zip(singles, again, strict=True)


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
        from concurrent.futures import CancelledError

        from distributed import KilledWorker

        sent = self._send(shared)
        waiting: deque[tuple[Item, Any]] = deque()
        window = WINDOW * max(1, len(self._client.nthreads()))
        source = iter(items)
        while True:
            for item in islice(source, window - len(waiting)):
                waiting.append((item, self._submit(function, item, sent)))
            if not waiting:
                return
            item, future = waiting.popleft()
            try:
                result = self._wait(future)
            except (KilledWorker, CancelledError):
                # its own doing, or that of a neighbour on the same worker: once more, alone
                for _, other in waiting:
                    with suppress(Exception):
                        self._wait(other)
                self._settle()
                for _ in range(_SENDINGS):
                    # the workers that are gone may have been all that had what is shared
                    sent = self._send(shared)
                    try:
                        result = self._wait(self._submit(function, item, sent))
                        break
                    except CancelledError:  # it was lost on the way, which is not its doing
                        result = lost(item)
                    except KilledWorker:
                        result = lost(item)
                        break
            yield result

    def _settle(self) -> None:
        """Wait until no worker is half gone: a task that is sent to one would count as deadly."""
        for _ in range(_SENDINGS):
            self._check_cluster()
            with suppress(OSError):
                self._client.run(os.getpid)
                return

    def _send(self, shared: Sequence[Any]) -> list[Any]:
        for _ in range(_SENDINGS):
            self._check_cluster()
            with suppress(OSError):  # a worker went while it was sent to
                # in a list of one, because a dict would be taken apart and scattered by its keys;
                # to one worker, from which others take it: sending it to all waits for ever
                # for one that dies meanwhile
                return [self._client.scatter([value], hash=False)[0] for value in shared]
        raise _gone("its workers go as fast as they come")

    def _submit(self, function: Callable[..., Result], item: Item, sent: list[Any]) -> Any:
        return self._client.submit(one_thread, function, item, *sent, pure=False)

    def _wait(self, future: Any) -> Any:
        from concurrent.futures import CancelledError

        while True:
            try:
                return future.result(timeout=PATIENCE)
            except CancelledError:
                self._check_cluster()
                raise
            except TimeoutError:
                if future.status == "error":  # the task's own
                    raise
                self._check_cluster()
            except OSError as problem:
                if future.status == "error":
                    raise
                raise _gone(problem) from problem

    def _check_cluster(self) -> None:
        """Raise `SchedulerError` if nobody is there to do the work, and nobody comes soon."""
        if self._client.status != "running":
            raise _gone("the scheduler does not answer")
        try:
            self._client.wait_for_workers(1, timeout=RESTART * PATIENCE)
        except OSError as problem:  # a time-out is one
            raise _gone("it has no workers") from problem


def _gone(problem: object) -> SchedulerError:
    return SchedulerError(
        f"the Dask cluster is gone ({problem})",
        advice="Start it again and run the same command; the archive is unharmed",
    )


@contextmanager
def executor(workers: int | None = None, scheduler: str | None = None) -> Iterator[Executor]:
    """Yield an executor: on a scheduler's address, on local worker processes, or serial.

    ``workers``: local processes (None: one per core); 0 or 1 means serial, in this process.
    ``scheduler``: address of a running Dask scheduler, such as ``tcp://host:8786``, whose
    workers see library and archive under the same paths. Raises `SchedulerError`.
    """
    count = workers if workers is not None else (os.cpu_count() or 1)
    if scheduler is None and count <= 1:
        yield SerialExecutor()
        return
    from dask import config
    from distributed import Client, LocalCluster

    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # `SchedulerError` says it
    if scheduler is not None:
        try:
            client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as problem:
            raise SchedulerError(
                f"no Dask scheduler at {scheduler} ({problem})",
                advice="Start one with: dask scheduler",
            ) from problem
        with client:
            yield DaskExecutor(client)
        return
    rules = {
        "distributed.scheduler.allowed-failures": 0,  # `map_ordered` tries again
        # A worker that dies is restarted by its nanny. Dask looks once, this long after a death,
        # and closes the nanny for good if its worker is not there: it may have died again.
        "distributed.deploy.lost-worker-timeout": "365 days",
    }
    with (
        config.set(rules),
        LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # not a port that others use
            preload=[_DEAF],
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield DaskExecutor(client)
