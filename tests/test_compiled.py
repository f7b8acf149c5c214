"""Compiled loops are kept by the sources of the whole codec: no change of any of them is missed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba.core import config
from numba.core.errors import NumbaError

from motifold.codec.arithmetic.compiled import lean

CODEC = Path(__file__).resolve().parents[1] / "codec"
ASK = """
import sys

from pathlib import Path

sys.path[:0] = [sys.argv[1]]
from codec.arithmetic.compiled import _cache_folder

print(_cache_folder(Path(sys.argv[1], "other")))
"""


def folder_of(root: Path) -> str:
    done = subprocess.run([sys.executable, "-c", ASK, str(root)], capture_output=True, check=True)
    return done.stdout.decode().strip()


def test_a_change_in_any_room_compiles_anew(tmp_path: Path) -> None:
    skip = shutil.ignore_patterns("__pycache__")
    shutil.copytree(CODEC, tmp_path / "codec", ignore=skip)
    found = {folder_of(tmp_path)}
    assert folder_of(tmp_path) in found
    (tmp_path / "other").mkdir()
    for name in ("arithmetic/fixedpoint.py", "blocks/recall.py", "../other/own.py"):
        with (tmp_path / "codec" / name).open("a") as file:
            file.write("# changed\n")
        folder = folder_of(tmp_path)
        assert folder not in found
        assert Path(folder).is_dir()
        found.add(folder)


@pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
def test_a_lean_function_makes_no_arrays() -> None:
    def last(array: np.ndarray) -> float:
        part = array[1:]
        return float(part[-1])

    def copied(array: np.ndarray) -> float:
        return float(array.copy()[-1])

    assert lean(last)(np.arange(3.0)) == 2.0
    with pytest.raises(NumbaError):
        lean(copied)(np.arange(3.0))
