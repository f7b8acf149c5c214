"""Compiled functions as plain Python, whose integers cannot overflow."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType, ModuleType
from typing import Any


def plain_functions(module: ModuleType) -> dict[str, Callable[..., Any]]:
    """Return a module's compiled functions uncompiled, by name; they call one another so too."""
    scope = dict(vars(module))
    found: dict[str, Callable[..., Any]] = {}
    for name, value in vars(module).items():
        if hasattr(value, "py_func"):
            found[name] = FunctionType(value.py_func.__code__, scope, name)
    scope.update(found)
    return found


class Watched(int):
    """A whole number whose sums, products and shifts may not pass 2^62."""

    def __new__(cls, value: int) -> Watched:
        assert abs(value) <= 1 << 62, f"an intermediate value is {value:#x}"
        return super().__new__(cls, value)

    def __add__(self, other: int) -> Watched:
        return Watched(int(self) + int(other))

    def __sub__(self, other: int) -> Watched:
        return Watched(int(self) - int(other))

    def __rsub__(self, other: int) -> Watched:
        return Watched(int(other) - int(self))

    def __mul__(self, other: int) -> Watched:
        return Watched(int(self) * int(other))

    def __neg__(self) -> Watched:
        return Watched(-int(self))

    def __lshift__(self, other: int) -> Watched:
        return Watched(int(self) << int(other))

    def __rshift__(self, other: int) -> Watched:
        return Watched(int(self) >> int(other))

    def __floordiv__(self, other: int) -> Watched:
        return Watched(int(self) // int(other))

    __radd__ = __add__
    __rmul__ = __mul__
