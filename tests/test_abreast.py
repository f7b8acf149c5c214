"""Work on threads: in order, each item once, few at a time, and errors come through."""

from __future__ import annotations

import os
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.learned.abreast import abreast


@given(st.lists(st.integers(-100, 100), max_size=40))
def test_it_is_a_map(items: list[int]) -> None:
    assert list(abreast(lambda item: item * item, items)) == [item * item for item in items]


def test_it_asks_for_few_items_ahead() -> None:
    cores, asked = os.cpu_count() or 1, 0

    def items() -> object:
        nonlocal asked
        for item in range(100):
            asked += 1
            yield item

    for done, _ in enumerate(abreast(str, items()), 1):  # type: ignore[arg-type]
        assert asked <= done + cores + 1
    assert asked == 100


def test_as_many_run_at_once_as_there_are_cores() -> None:
    together = threading.Barrier(os.cpu_count() or 1, timeout=20.0)
    assert len(list(abreast(lambda _: together.wait(), range(os.cpu_count() or 1)))) > 0


def test_errors_come_through() -> None:
    with pytest.raises(ZeroDivisionError):
        list(abreast(lambda item: 1 // item, [1, 2, 0, 3]))
