"""Compiling the codec's inner loops with Numba.

Loops that follow a clip block by block cannot be array operations: each block is predicted from
the decoded one before. Floating-point contraction and reordering stay off (Numba's default):
what a decoder computes must not depend on the processor.

The compiled code is kept on disk, in a folder named after the sources of all of the codec and of
the caller's folder together, because Numba's own cache only looks at the file of the outermost
function, and would go on using a loop whose inner functions have changed.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Return ``function`` compiled, with the same signature."""
    return _compiled(function, True)


def lean(function: Function) -> Function:
    """Return a function that makes no arrays compiled, without counting references to them.

    Counting takes long in small functions that are called for every joint: each count is an
    atomic operation. A function that makes an array does not compile so.
    """
    return _compiled(function, False)


def _compiled(function: Function, counting: bool) -> Function:
    folder = _cache_folder(Path(function.__code__.co_filename).parent)
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = folder or before  # read when the decorator runs, and not later
    try:
        options = {"nogil": True, "error_model": "numpy", "_nrt": counting}
        made = njit(cache=folder is not None, **options)(function)
    finally:
        numba.config.CACHE_DIR = before
    return cast(Function, made)


@lru_cache
def _cache_folder(caller: Path) -> str | None:
    """Return the folder of the compiled code, or None where nothing can be written."""
    codec = Path(__file__).parents[1]
    sources = hashlib.blake2b(digest_size=8)
    for path in sorted({*codec.rglob("*.py"), *caller.glob("*.py")}):
        sources.update(path.read_bytes())  # constants of any of them are compiled in
    home = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    for base in (codec / "__pycache__", Path(home).expanduser() / "motifold"):
        folder = base / f"compiled-{sources.hexdigest()}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return str(folder)
        except OSError:
            continue
    return None
