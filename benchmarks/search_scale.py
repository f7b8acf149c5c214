"""Search over a synthetic catalog of 100,000 clips: building it, its size, and query times.

The clips' words are drawn from those of a real archive's catalog: spans of its clips, one after
the other, with a share of the words changed at random, so that the lists are as long, and as
uneven, as in a real library.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from motifold.catalog.bodysignals import PARTS, RATE
from motifold.catalog.catalogfolder import Catalog
from motifold.catalog.catalogrecord import CatalogRecord
from motifold.catalog.indexing import publish
from motifold.catalog.search import cut_query, search
from motifold.catalog.vocabulary import COLUMNS, Words

CHANGED = 0.1  # of the words


def synthetic_words(catalog: Catalog, clips: int, seed: int) -> list[Words]:
    """Return the words (samples, columns) of clips made of spans of a catalog's clips."""
    rng = np.random.default_rng(seed)
    used = [
        np.unique(np.concatenate([b.words[:, c] for b in catalog.batches]))
        for c in range(len(COLUMNS))
    ]
    out = []
    for _ in range(clips):
        spans = []
        for number in rng.integers(0, len(catalog), rng.integers(1, 3)):
            words = catalog.words(int(number))
            first = int(rng.integers(0, max(len(words) // 2, 1)))
            spans.append(words[first : first + int(rng.integers(20, 60))])
        words = np.concatenate(spans)
        for column, known in enumerate(used):
            changed = rng.random(len(words)) < CHANGED
            words[changed, column] = rng.choice(known, int(changed.sum()))
        out.append(words)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("archive", type=Path, help="an archive with a catalog to draw from")
    parser.add_argument("out", type=Path, help="an empty folder")
    parser.add_argument("--clips", type=int, default=100_000)
    parser.add_argument("--queries", type=int, default=500)
    options = parser.parse_args()
    source = Catalog(options.archive)
    words = synthetic_words(source, options.clips, 0)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "COMMIT.json").write_text('{"format": 1, "jobs": []}')
    clips = [
        (f"clip{number:06d}.bvh", f"{number:016x}", 0, each, len(each) / RATE)
        for number, each in enumerate(words)
    ]
    start = time.perf_counter()
    made = publish(options.out, CatalogRecord(), source.vocabulary, clips)
    built = time.perf_counter() - start
    start = time.perf_counter()
    catalog = Catalog(options.out, many=True)
    opened = time.perf_counter() - start
    rng = np.random.default_rng(1)
    chosen = rng.integers(0, options.clips, options.queries).tolist()
    figures = {}
    for mode, rerank, count in (
        ("whole", "none", options.queries),
        ("whole", "dtw", options.queries // 5),
        ("windows", "none", options.queries // 5),
        ("windows", "dtw", options.queries // 5),
    ):
        times, busy = [], []
        for place, number in enumerate([chosen[0], *chosen[:count]]):
            said = np.array(catalog.words(number))
            begin = min(1.0, (len(said) - 1) / RATE)
            span = (None, None) if mode == "whole" else (begin, begin + 1.5)
            query = replace(cut_query(said, *span), own=number)
            start, began = time.perf_counter(), time.process_time()
            search(catalog, query, mode=mode, rerank=rerank)  # type: ignore[arg-type]
            if place:
                times.append(1000 * (time.perf_counter() - start))
                busy.append(1000 * (time.process_time() - began))
        figures[f"{mode}, {rerank}"] = {
            "median_ms": float(np.median(times)),
            "percentile_99_ms": float(np.percentile(times, 99)),
            "median_processor_ms": float(np.median(busy)),
            "percentile_99_processor_ms": float(np.percentile(busy, 99)),
        }
    record = {
        "clips": options.clips,
        "hours": sum(len(each) for each in words) / RATE / 3600,
        "parts": len(PARTS),
        "build_seconds": built,
        "open_seconds": opened,
        "catalog_bytes": made.catalog_bytes,
        "peak_memory_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "queries": figures,
    }
    print(json.dumps(record, indent=2))


if __name__ == "__main__":
    main()
