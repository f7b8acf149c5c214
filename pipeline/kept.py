"""What was made last, kept for who asks for it next."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable
from typing import Generic, TypeVar

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")


class Kept(Generic[Key, Value]):
    """Values by their keys; those that nobody has asked for longest go when there is no room.

    ``room``: bytes that all may take together; the one that came last stays, whatever it takes.
    Safe to use from several threads.
    """

    def __init__(self, room: int) -> None:
        self._room = room
        self._values: OrderedDict[Key, tuple[Value, int]] = OrderedDict()
        self._held = 0
        self._lock = threading.Lock()

    def get(self, *keys: Key) -> Value | None:
        """Return the value of the first of some keys that has one."""
        with self._lock:
            for key in keys:
                if key in self._values:
                    self._values.move_to_end(key)
                    return self._values[key][0]
        return None

    def keep(self, key: Key, value: Value, size: int) -> Value:
        """Keep a value of ``size`` bytes; return it, or the one that another thread kept."""
        with self._lock:
            if key in self._values:
                return self._values[key][0]
            self._values[key] = value, size
            self._held += size
            while len(self._values) > 1 and self._held > self._room:
                self._held -= self._values.popitem(last=False)[1][1]
        return value
