"""Checking a catalog: that it is whole, and what its archive says."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ..codec.errors import ArchiveError, MotifoldError
from ..pipeline.archive import Archive
from ..pipeline.durable import digest
from .bodysignals import body_signals
from .catalogfolder import Batch, read_batch, read_vocabulary
from .catalogrecord import FOLDER, BatchRecord, read_record
from .indexing import files_of
from .postings import TERMS, make_postings, passages_of, softness_of
from .vocabulary import Vocabulary


def check_catalog(folder: str | Path, archive: Archive, *, decode: bool = False) -> list[str]:
    """Return what is wrong with a catalog, in words; nothing if it fits the archive.

    Every file's digest; that the current clips, and no others, are in it; that the postings are
    those of the words. ``decode``: that the words are those of the decoded clips, too.
    """
    path = Path(folder)
    try:
        record = read_record(path)
        if record is None:
            return []  # it was never asked for
        vocabulary = read_vocabulary(path, record)
        batches = [read_batch(path / FOLDER, each) for each in record.batches]
    except ArchiveError as problem:
        return [str(problem)]
    wrong = [
        f"{path / FOLDER / name} is damaged. Make it again with: motifold index --rebuild"
        for name, file in files_of(record)
        if digest((path / FOLDER / name).read_bytes()) != file.digest
    ]
    if wrong:
        return wrong
    indexed = {key for batch in batches for key in batch.keys} - set(record.replaced)
    for row, _ in archive.rows.values():
        if (row.name, row.index) not in indexed and row.name not in record.left_out:
            wrong.append(f"{row.name} is not in the catalog. Add it with: motifold index")
    before = np.zeros(TERMS, np.int64), 0
    for each, batch in zip(record.batches, batches, strict=True):
        soft = softness_of(vocabulary, each.sizes)
        made = make_postings(batch.words, batch.starts, batch.spans, soft, before)
        same = (
            np.array_equal(made.starts, batch.postings.starts)
            and np.array_equal(made.passages, batch.postings.passages)
            and np.array_equal(made.weights, batch.postings.weights)
            and np.allclose(made.norms, batch.postings.norms)
            and np.allclose(vocabulary.amplitudes(batch.words, batch.starts), batch.amplitudes)
            and np.array_equal(passages_of(batch.starts), batch.spans)
        )
        if not same:
            wrong.append(f"{path / FOLDER / each.folder}: its postings are not those of its words")
        before = before[0] + made.frequencies, before[1] + len(batch.spans)
        if decode:
            wrong += _other_words(archive, batch, vocabulary, each, set(record.replaced))
    return wrong


def _other_words(
    archive: Archive,
    batch: Batch,
    vocabulary: Vocabulary,
    record: BatchRecord,
    replaced: set[tuple[str, str]],
) -> Iterator[str]:
    """Yield which clips of a batch have other words than those that it says."""
    then = Vocabulary(
        {kind: vocabulary.centres[kind][:size] for kind, size in record.sizes.items()},
        vocabulary.usual,
        vocabulary.far,
    )
    for number, name in enumerate(batch.names):
        if batch.keys[number] in replaced or name not in archive:
            continue
        clip = archive[name]
        said = batch.words[batch.starts[number] : batch.starts[number + 1]]
        try:
            made = then.words_of(body_signals(clip.decode(), clip.rig.parts))
        except MotifoldError as problem:
            yield f"{name}: {problem}"
            continue
        if made.shape != said.shape or (made != said).mean() > 0.01:  # sines round differently
            yield f"{name}: its words in the catalog are not those of its motion"
