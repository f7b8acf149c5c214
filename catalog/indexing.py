"""Keeping the catalog of an archive: words for new clips, batch by batch; checking; rebuilding.

The catalog is derived: it can be made again from the archive at any time, and whatever goes
wrong with it harms no clip. A batch is written whole, and CATALOG.json, replaced atomically,
says which batches count.
"""

from __future__ import annotations

import io
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..codec.errors import ArchiveError, MotifoldError
from ..pipeline.archive import Archive
from ..pipeline.durable import digest, sync, write_whole, writing
from ..pipeline.executors import Executor, map_batches, one_thread
from .batchfile import ARRAYS, pack
from .bodysignals import Signals, body_signals
from .catalogfolder import read_batch, read_vocabulary
from .catalogrecord import (
    FOLDER,
    NAME,
    BatchRecord,
    CatalogRecord,
    FileRecord,
    newest_ledger,
    read_record,
    record_text,
)
from .postings import TERMS, make_postings, passages_of, softness_of
from .vocabulary import Vocabulary, Words

BATCH_CLIPS = 32
MOST_BATCHES = 8  # more are made into one
LEARNED_FROM = 400  # clips


@dataclass
class Indexed:
    """What an update of the catalog did. ``left_out``: clips without words, with the reason."""

    clips: int = 0
    new: int = 0
    left_out: dict[str, str] = field(default_factory=dict)
    words: dict[str, int] = field(default_factory=dict)
    catalog_bytes: int = 0


def update_catalog(
    folder: str | Path,
    *,
    engine: Executor,
    rebuild: bool = False,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Indexed:
    """Give the clips of an archive that have none yet their words; return what was done.

    ``rebuild``: begin anew, with a vocabulary learned from the clips that are there now. A
    catalog that cannot be read is rebuilt, too. ``seed``: of the learning. The caller holds the
    archive's writer lock. Raises `ArchiveError`.
    """
    path = Path(folder)
    record = CatalogRecord() if rebuild else _readable(path)
    with Archive(path) as archive:
        rows = {(row.name, row.index): row for row, _ in archive.rows.values()}
        known = _indexed(path, record)
        todo = [row.name for key, row in rows.items() if key not in known]
        replaced = tuple(sorted(known - rows.keys()))
        ledger = newest_ledger(path)
        if not todo and (record.ledger, record.replaced) == (ledger, replaced):
            return _summary(path, record, 0)
        vocabulary = read_vocabulary(path, record)
        left_out = {name: why for name, why in record.left_out.items() if name in archive}
        steps = _Steps(archive, engine, left_out, len(todo), progress)
        step = max(1, len(todo) // LEARNED_FROM)
        signals: dict[str, Signals] = dict(steps.run(todo[::step], None))
        vocabulary = one_thread(vocabulary.grown, list(signals.values()), seed)
        words = {name: vocabulary.words_of(each) for name, each in signals.items()}
        rest = [name for name in todo if name not in words and name not in left_out]
        words.update(steps.run(rest, vocabulary))
        clips = [
            (
                row.name,
                row.index,
                row.rig,
                words[row.name],
                row.frames * archive.rig(row.rig).frame_time,
            )
            for row in rows.values()
            if row.name in words
        ]
    record = replace(record, ledger=ledger, replaced=replaced, left_out=left_out)
    return publish(path, record, vocabulary, clips)


Clips = Sequence[tuple[str, str, int, Words, float]]
"""Of each clip: name, digest of its index file, number of its rig, words, seconds."""


def publish(folder: Path, record: CatalogRecord, vocabulary: Vocabulary, clips: Clips) -> Indexed:
    """Add a batch of clips to the catalog and make it current; return what was done."""
    place = folder / FOLDER
    number = 1 + max([0, *(int(batch.folder) for batch in record.batches)])
    batches, before = list(record.batches), _frequencies(place, record)
    new = len(clips)
    if clips and len(batches) >= MOST_BATCHES:
        old = set(record.replaced)
        clips = [each for each in _clips_of(place, record) if each[:2] not in old] + list(clips)
        batches, before = [], (np.zeros(TERMS, np.int64), 0)
        record = replace(record, replaced=())
    if clips:
        batches.append(_write_batch(place, f"{number:06d}", vocabulary, clips, before))
        data = io.BytesIO()
        np.savez_compressed(data, allow_pickle=False, **vocabulary.to_arrays())
        name = f"vocabulary-{number:06d}.npz"
        write_whole(place / name, data.getvalue())
        file = FileRecord(len(data.getvalue()), digest(data.getvalue()))
        record = replace(record, vocabulary=name, vocabulary_file=file)
    record = replace(record, batches=tuple(batches))
    write_whole(place / NAME, record_text(record).encode())
    sync(place)
    _sweep(place, record)
    return _summary(folder, record, new, vocabulary)


def _readable(path: Path) -> CatalogRecord:
    """Return the catalog's record, an empty one where it cannot be read."""
    try:
        record = read_record(path) or CatalogRecord()
        read_vocabulary(path, record)
        for batch in record.batches:
            read_batch(path / FOLDER, batch)
    except ArchiveError:
        return CatalogRecord()
    return record


def _indexed(path: Path, record: CatalogRecord) -> set[tuple[str, str]]:
    """Return the clips that have words: name and index file."""
    return {key for batch in record.batches for key in read_batch(path / FOLDER, batch).keys}


class _Steps:
    """Decoding clips with an engine, and counting them."""

    def __init__(
        self,
        archive: Archive,
        engine: Executor,
        left_out: dict[str, str],
        clips: int,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self._archive, self._engine, self._left_out = archive, engine, left_out
        self._clips, self._done, self._progress = clips, 0, progress

    def run(self, names: list[str], vocabulary: Vocabulary | None) -> Iterator[tuple[str, Any]]:
        """Yield each clip's signals, or its words if there is a vocabulary."""
        batches = [names[i : i + BATCH_CLIPS] for i in range(0, len(names), BATCH_CLIPS)]
        for batch, (made, failed) in map_batches(
            self._engine, _heard, batches, self._archive, vocabulary, lost=_lost
        ):
            for name in batch:
                self._left_out.pop(name, None)
            self._left_out.update(failed)
            yield from made.items()
            self._done += len(batch)
            if self._progress:
                self._progress(self._done, self._clips)


def _heard(
    names: Sequence[str], archive: Archive, vocabulary: Vocabulary | None
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the signals of clips, or their words; and which have none, with the reason."""
    made: dict[str, Any] = {}
    failed = {}
    for name in names:
        try:
            clip = archive[name]
            signals = body_signals(clip.decode(), clip.rig.parts)
        except MotifoldError as problem:
            failed[name] = str(problem)
            continue
        if signals:
            made[name] = signals if vocabulary is None else vocabulary.words_of(signals)
        else:
            failed[name] = "has no frames, or no body part that is searched"
    return made, failed


def _lost(names: Sequence[str]) -> tuple[dict[str, Any], dict[str, str]]:
    return {}, dict.fromkeys(names, "the worker process died while it decoded")


def _clips_of(place: Path, record: CatalogRecord) -> Iterator[tuple[str, str, int, Words, float]]:
    for each in record.batches:
        batch = read_batch(place, each)
        for number, name in enumerate(batch.names):
            words = np.array(batch.words[batch.starts[number] : batch.starts[number + 1]])
            yield name, batch.index[number], batch.rigs[number], words, batch.seconds[number]


def _frequencies(place: Path, record: CatalogRecord) -> tuple[Any, int]:
    """Return in how many passages each term is, and how many there are."""
    total, passages = np.zeros(TERMS, np.int64), 0
    for each in record.batches:
        batch = read_batch(place, each)
        total, passages = total + batch.postings.frequencies, passages + len(batch.spans)
    return total, passages


def _write_batch(
    place: Path, name: str, vocabulary: Vocabulary, clips: Clips, before: tuple[Any, int]
) -> BatchRecord:
    names, index, rigs, said, seconds = zip(*clips, strict=True)
    starts = np.concatenate([[0], np.cumsum([len(each) for each in said])]).astype(np.int64)
    words, spans = np.concatenate(said), passages_of(starts)
    made = make_postings(words, starts, spans, softness_of(vocabulary, vocabulary.sizes), before)
    far = vocabulary.amplitudes(words, starts)
    values = words, starts, far, spans, made.starts, made.passages, made.weights, made.norms
    records = {"names": names, "index": index, "rigs": rigs, "seconds": seconds}
    folder = place / name
    files = pack(records, dict(zip(ARRAYS, values, strict=True)))
    with writing(folder):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for file, content in files.items():
            write_whole(folder / file, content)
        sync(folder)
    return BatchRecord(
        name,
        len(names),
        len(spans),
        vocabulary.sizes,
        {file: FileRecord(len(content), digest(content)) for file, content in files.items()},
    )


def files_of(record: CatalogRecord) -> Iterator[tuple[str, FileRecord]]:
    """Yield the files that a catalog needs, by their names in its folder."""
    if record.vocabulary:
        yield record.vocabulary, record.vocabulary_file
    for batch in record.batches:
        for name, file in batch.files.items():
            yield f"{batch.folder}/{name}", file


def _sweep(place: Path, record: CatalogRecord) -> None:
    """Remove what is no longer current; who reads it has it open."""
    kept = {NAME, record.vocabulary, *(batch.folder for batch in record.batches)}
    for path in place.iterdir():
        if path.name not in kept:
            with suppress(OSError):
                shutil.rmtree(path) if path.is_dir() else path.unlink()


def _summary(
    folder: Path, record: CatalogRecord, new: int, vocabulary: Vocabulary | None = None
) -> Indexed:
    vocabulary = vocabulary or read_vocabulary(folder, record)
    clips = sum(batch.clips for batch in record.batches) - len(record.replaced)
    size = sum(file.size for _, file in files_of(record)) + (folder / FOLDER / NAME).stat().st_size
    return Indexed(clips, new, record.left_out, vocabulary.sizes, size)
