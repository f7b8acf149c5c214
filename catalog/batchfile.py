"""The files of a batch of clips: one compressed file where it is small, mapped ones where not.

A small batch is inflated in a few milliseconds, and takes less than half of the disk. A large one
must open without being read, so its arrays lie as they are.
"""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
import numpy.typing as npt

Arrays = Mapping[str, npt.NDArray[Any]]

ARRAYS = ("words", "starts", "amplitudes", "spans", "term_starts", "postings", "weights", "norms")
CLIPS = "clips.json"
PACKED = "batch.npz"
MOST_PACKED = 8_000_000  # bytes of arrays, of some 5,000 clips: inflated in 30 ms
UNREADABLE = (
    *(OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error),
    *(NotImplementedError, RuntimeError),  # what zipfile says of a damaged head
)
"""What reading a damaged file of arrays raises."""


def pack(clips: Mapping[str, Any], arrays: Arrays) -> dict[str, bytes]:
    """Return the files of a batch by name: ``clips``, JSON values, and its `ARRAYS`."""
    text = json.dumps(clips, separators=(",", ":")).encode()
    if sum(array.nbytes for array in arrays.values()) > MOST_PACKED:
        return {CLIPS: text} | {f"{name}.npy": _npy(array) for name, array in arrays.items()}
    # a column after the other, words compress to two thirds
    by_column = {name: np.asfortranarray(array) for name, array in arrays.items()}
    data = io.BytesIO()
    np.savez_compressed(data, clips=np.frombuffer(text, np.uint8), allow_pickle=False, **by_column)
    return {PACKED: data.getvalue()}


def unpack(folder: Path, files: Collection[str]) -> tuple[Mapping[str, Any], Arrays]:
    """Return what `pack` made ``files`` of. Raises what is in `UNREADABLE`."""
    if PACKED in files:
        packed = read_packed(folder / PACKED)
        return json.loads(packed["clips"].tobytes()), {name: packed[name] for name in ARRAYS}
    arrays = {name: np.load(folder / f"{name}.npy", mmap_mode="r") for name in ARRAYS}
    # plain arrays on the mapped bytes: slices of np.memmap are slow
    plain = {name: np.asarray(array) for name, array in arrays.items()}
    return json.loads((folder / CLIPS).read_text("utf-8")), plain


def read_packed(path: Path) -> Arrays:
    """Return the arrays of an NPZ file by name. Raises what is in `UNREADABLE`.

    Checksums are checked before NumPy sees a byte: what it says of damaged heads has no end.
    """
    with ZipFile(path) as packed:
        whole = {entry.removesuffix(".npy"): packed.read(entry) for entry in packed.namelist()}
    return {name: np.load(io.BytesIO(data)) for name, data in whole.items()}


def _npy(array: npt.NDArray[Any]) -> bytes:
    data = io.BytesIO()
    np.save(data, array)
    return data.getvalue()
