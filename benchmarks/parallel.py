"""The same function on many items, in processes of their own."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_processes(
    function: Callable[[Item], Result], items: Iterable[Item], workers: int | None
) -> list[Result]:
    """Return the results in order; ``workers`` None means one a core, 0 or 1 none."""
    if workers is not None and workers <= 1:
        return [function(item) for item in items]
    count = workers or os.cpu_count()
    with ProcessPoolExecutor(count, get_context("spawn")) as pool:
        return list(pool.map(function, items, chunksize=8))
