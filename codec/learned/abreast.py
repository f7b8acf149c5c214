"""Samples worked on side by side: compiled walks let go of the interpreter, so threads help."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def abreast(function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
    """Yield what ``function`` makes of every item, in their order, on a thread per core.

    Only as many items as there are cores, and one more, are asked for ahead.
    """
    cores = os.cpu_count() or 1
    with ThreadPoolExecutor(cores) as pool:
        waiting: deque[Future[Result]] = deque()
        for item in items:
            waiting.append(pool.submit(function, item))
            if len(waiting) > cores:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
