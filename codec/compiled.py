"""Compiling the codec's inner loops with Numba.

Loops that follow a clip block by block cannot be array operations: each block is predicted from
the decoded one before. The compiled code is kept on disk, so that it is made once a machine.
Floating-point contraction and reordering stay off (Numba's default): what a decoder computes
must not depend on the processor.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return ``function`` compiled, with the same signature."""
    return cast(Function, njit(cache=True, nogil=True, error_model="numpy")(function))
