"""Where the real motion library is, for the tests that need it."""

from __future__ import annotations

import os
import tarfile
import tempfile
from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


def library_path(*parts: str) -> Path:
    """Return a path inside the unpacked real library, or skip the test where there is none.

    The first of ``parts`` is the set (``bandai``, ``cmu_amc`` or ``misc``). Sets are unpacked
    once into ``$MOTIFOLD_LIBRARY`` or a folder of the temporary directory.
    """
    root = Path(os.environ.get("MOTIFOLD_LIBRARY", Path(tempfile.gettempdir()) / "motifold-data"))
    target = root / parts[0]
    if not target.is_dir():
        source = SHARED / f"{parts[0]}.tar.xz"
        if not source.is_file():
            pytest.skip(f"needs the real motion library ({source.name} in ../shared/data)")
        partial = root / f"{parts[0]}.part{os.getpid()}"
        with tarfile.open(source) as archive:
            archive.extractall(partial, filter="data")
        try:
            (partial / parts[0]).rename(target)
        except OSError:  # another test process was faster
            assert target.is_dir()
    return root.joinpath(*parts)
