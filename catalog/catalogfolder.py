"""The catalog in an archive's folder: what search reads, and nothing else.

::

    ARCHIVE/catalog/CATALOG.json          what is current; replaced atomically
    ARCHIVE/catalog/vocabulary-000001.npz
    ARCHIVE/catalog/000001/batch.npz      a small batch of clips, compressed
    ARCHIVE/catalog/000002/clips.json     a large one: names, seconds, index files, rigs
    ARCHIVE/catalog/000002/*.npy          its words, passages and postings

All of it is derived from the archive and can be made again. It must open in a moment, so
nothing here imports the pipeline, large arrays are mapped rather than read, and files are
checked by their size; `catalogcheck.check_catalog` checks every byte.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..codec.clip import FloatArray, IntArray
from ..codec.errors import DamagedError
from .batchfile import UNREADABLE, read_packed, unpack
from .bodysignals import PARTS
from .catalogrecord import (
    FOLDER,
    REBUILD,
    BatchRecord,
    CatalogRecord,
    newest_ledger,
    read_record,
)
from .postings import TERMS, Postings, rareness, softness_of
from .vocabulary import COLUMNS, POSTURE_COLUMNS, Vocabulary, Words, kind_of


@dataclass(frozen=True, eq=False)
class Batch:
    """The clips of one batch: ``names``, ``seconds``, ``index`` (digests) and ``rigs``, per clip.

    ``words``: (samples, columns) of all clips, which begin at ``starts`` (clips + 1,). ``spans``:
    (passages, 3) as by `postings.passages_of`. ``amplitudes``: (clips, postures) centimetres.
    """

    names: list[str]
    seconds: list[float]
    index: list[str]
    rigs: list[int]
    words: Words
    starts: IntArray
    amplitudes: npt.NDArray[np.float32]
    spans: npt.NDArray[np.int32]
    postings: Postings
    _norms: dict[bytes, npt.NDArray[np.float32]] = field(default_factory=dict)

    def norms(self, weights: FloatArray) -> npt.NDArray[np.float32]:
        """Return (passages,) the lengths of passages as vectors, for the weights of parts.

        The last ones are kept: most queries weigh all parts alike.
        """
        key = weights.tobytes()
        if key not in self._norms:
            made = np.sqrt(self.postings.norms @ np.square(weights).astype(np.float32))
            self._norms.clear()
            self._norms[key] = np.maximum(made, 1e-9)
        return self._norms[key]

    @property
    def keys(self) -> list[tuple[str, str]]:
        """The name and the index file of each clip."""
        return list(zip(self.names, self.index, strict=True))

    def amplitude_gaps(self, own: FloatArray, weights: FloatArray) -> npt.NDArray[np.float32]:
        """Return (clips,) how far amplitudes are from ``own`` (postures,), centimetres.

        ``weights``: (postures,) what the square of each difference counts.
        """
        out = np.zeros(len(self.names), np.float32)
        for column, amplitude, weight in zip(
            self._amplitudes_by_posture, own, weights, strict=True
        ):
            out += np.float32(weight) * np.square(column - np.float32(amplitude))
        return np.sqrt(out)

    @cached_property
    def _amplitudes_by_posture(self) -> npt.NDArray[np.float32]:
        return np.ascontiguousarray(self.amplitudes.T)

    @cached_property
    def first_passages(self) -> IntArray:
        """(clips,) the number of each clip's first passage."""
        return np.searchsorted(self.spans[:, 0], np.arange(len(self.names)))

    @cached_property
    def passage_counts(self) -> IntArray:
        """(clips,) the number of passages of each clip."""
        return np.bincount(self.spans[:, 0], minlength=len(self.names))


class Catalog:
    """An archive's catalog, open for reading.

    ``problems``: in words, what is damaged; those clips are left out, the others are searched.
    ``stale``: whether the archive has changed since the catalog was written. ``many``: whether
    there will be many queries, for which compiled loops pay. Raises `NotAnArchiveError`,
    `VersionError` or `DamagedError`.
    """

    def __init__(self, archive: str | Path, *, many: bool = False) -> None:
        self.archive = Path(archive)
        self.many = many
        ledger = newest_ledger(self.archive)
        record = read_record(self.archive)
        if record is None:
            raise DamagedError(
                "has no catalog yet",
                file=self.archive,
                advice=f"Make it with: motifold index {self.archive}",
            )
        self.record = record
        self.stale = record.ledger != ledger
        self.problems: list[str] = []
        self.vocabulary = read_vocabulary(self.archive, record)
        self.batches: list[Batch] = []
        for each in record.batches:
            try:
                self.batches.append(read_batch(self.archive / FOLDER, each))
            except DamagedError as problem:
                self.problems.append(str(problem))
        self._offsets = np.cumsum([0, *(len(batch.names) for batch in self.batches)])

    @cached_property
    def names(self) -> list[str]:
        """The clips' names by number."""
        return [name for batch in self.batches for name in batch.names]

    @cached_property
    def numbers(self) -> dict[str, int]:
        """The current clips' numbers by name."""
        return {self.names[number]: int(number) for number in np.flatnonzero(self.current)}

    @cached_property
    def current(self) -> npt.NDArray[np.bool_]:
        """(clips,) whether no newer version of a clip replaced it."""
        old = set(self.record.replaced)
        if not old:
            return np.ones(len(self), bool)
        return np.array([key not in old for batch in self.batches for key in batch.keys], bool)

    def __len__(self) -> int:
        return int(self._offsets[-1])

    def words(self, number: int) -> Words:
        """Return the words (samples, columns) of a clip."""
        batch, clip = self._place(number)
        return batch.words[batch.starts[clip] : batch.starts[clip + 1]]

    def seconds(self, number: int) -> float:
        """Return how long a clip lasts."""
        batch, clip = self._place(number)
        return batch.seconds[clip]

    def rig(self, number: int) -> int:
        """Return the number of a clip's rig in the archive."""
        batch, clip = self._place(number)
        return batch.rigs[clip]

    def offset(self, batch: int) -> int:
        """Return the number of a batch's first clip."""
        return int(self._offsets[batch])

    @cached_property
    def passages(self) -> int:
        """The number of passages."""
        return sum(len(batch.spans) for batch in self.batches)

    @cached_property
    def rareness(self) -> FloatArray:
        """(terms,) the inverse document frequency of every term."""
        return rareness(self.frequencies, self.passages)

    @cached_property
    def frequencies(self) -> IntArray:
        """(terms,) how many passages hold each term."""
        counts = [batch.postings.frequencies for batch in self.batches]
        return np.asarray(np.sum([np.zeros(TERMS, np.int64), *counts], axis=0))

    @cached_property
    def softness(self) -> list[FloatArray]:
        """Per part, how much its words count for each other."""
        return softness_of(self.vocabulary, self.vocabulary.sizes)

    @cached_property
    def table(self) -> npt.NDArray[np.float32]:
        """(columns, 256, 256) distances from word to word; 1 where there is none."""
        out = np.ones((len(COLUMNS), 256, 256), np.float32)
        for number, column in enumerate(COLUMNS):
            table = self.vocabulary.tables.get(kind_of(column))
            if table is not None:
                out[number, : len(table), : len(table)] = table
        return out

    def _place(self, number: int) -> tuple[Batch, int]:
        batch = int(np.searchsorted(self._offsets, number, side="right")) - 1
        return self.batches[batch], number - int(self._offsets[batch])


def read_vocabulary(archive: Path, record: CatalogRecord) -> Vocabulary:
    """Return the vocabulary. Raises `DamagedError`."""
    path = archive / FOLDER / record.vocabulary
    if not record.vocabulary:
        return Vocabulary({}, {}, {})
    try:
        if path.stat().st_size != record.vocabulary_file.size:
            raise ValueError("its size has changed")
        return Vocabulary.from_arrays(read_packed(path))
    except UNREADABLE as problem:
        raise DamagedError(f"cannot be read ({problem})", file=path, advice=REBUILD) from problem


def read_batch(folder: Path, record: BatchRecord) -> Batch:
    """Return a batch; of a large one, the arrays are mapped. Raises `DamagedError`."""
    path = folder / record.folder
    try:
        for name, file in record.files.items():
            if (path / name).stat().st_size != file.size:
                raise ValueError(f"the size of {name} has changed")
        clips, arrays = unpack(path, record.files)
    except UNREADABLE as problem:
        raise DamagedError(f"cannot be read ({problem})", file=path, advice=REBUILD) from problem
    starts, term_starts = arrays["starts"], arrays["term_starts"]
    whole = (
        len(starts) == len(clips["names"]) + 1
        and arrays["words"].shape == (starts[-1], len(COLUMNS))
        and arrays["words"].dtype == np.uint8
        and arrays["amplitudes"].shape == (len(clips["names"]), len(POSTURE_COLUMNS))
        and arrays["norms"].shape == (len(arrays["spans"]), len(PARTS))
        and len(term_starts) == TERMS + 1
        and term_starts[-1] == len(arrays["postings"]) == len(arrays["weights"])
        and term_starts[0] == starts[0] == 0
        and (np.diff(starts) >= 0).all()
        and (np.diff(term_starts) >= 0).all()
    )
    if not whole:
        raise DamagedError("its files do not fit together", file=path, advice=REBUILD)
    postings = Postings(term_starts, arrays["postings"], arrays["weights"], arrays["norms"])
    return Batch(
        clips["names"],
        clips["seconds"],
        clips["index"],
        clips["rigs"],
        arrays["words"],
        starts,
        arrays["amplitudes"],
        arrays["spans"],
        postings,
    )
