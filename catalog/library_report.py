"""What is in a library: clips, hours, rigs, repairs, patterns, and clips like nothing else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..pipeline.archive import Archive
from .bodysignals import PARTS
from .catalogfolder import Catalog
from .pages import page, table, word_drawing
from .search import Query, best_clips, clip_scores, part_weights
from .vocabulary import NO_WORD, kind_of

SHOWN = 10


def library_record(archive: Archive, catalog: Catalog) -> dict[str, Any]:
    """Return the report as JSON values; sizes in bytes, times in seconds."""
    rows = [row for row, _ in archive.rows.values()]
    rigs = archive.store.rigs
    seconds = {row.name: row.frames * rigs[row.rig].frame_time for row in rows}
    sizes = {row.name: archive[row.name].path.stat().st_size for row in rows}
    repairs = Counter(repair.what for row in rows for repair in row.repairs)
    used = Counter(row.rig for row in rows)
    return {
        "clips": len(rows),
        "hours": sum(seconds.values()) / 3600,
        "frame_rates": _counted(
            f"{1 / rigs[row.rig].frame_time:.5g} Hz" if rigs[row.rig].frame_time else "none"
            for row in rows
        ),
        "rigs": [
            {
                "rig": number,
                "kind": rigs[number].kind,
                "format": rigs[number].layout.format,
                "joints": rigs[number].skeleton.joints,
                "clips": count,
            }
            for number, count in used.most_common()
        ],
        "repairs": [{"what": what, "files": count} for what, count in repairs.most_common()],
        "largest": [
            {"clip": name, "bytes": size, "seconds": seconds[name]}
            for name, size in sorted(sizes.items(), key=lambda entry: -entry[1])[:SHOWN]
        ],
        "patterns": _most_used(catalog),
        "unlike_all_others": _loners(catalog),
        "not_searchable": catalog.record.left_out,
    }


def library_page(record: Mapping[str, Any], catalog: Catalog) -> str:
    """Return the report as a page, with a small drawing of each pattern."""
    facts = [
        ["", "value"],
        ["clips", f"{record['clips']:,}"],
        ["hours", f"{record['hours']:.2f}"],
        *([f"at {rate}", f"{count:,} clips"] for rate, count in record["frame_rates"].items()),
    ]
    drawings = []
    for part, words in record["patterns"].items():
        cells = "".join(
            f"<div>{word_drawing(catalog.vocabulary, part, each['word'])}<br>"
            f'<span class="small">{100 * each["share"]:.1f} %</span></div>'
            for each in words
        )
        drawings.append(f'<h3>{part}</h3><div class="drawings">{cells}</div>')
    note = (
        '<p class="small">The path of the part\'s end in 0.9 s, seen from the side: the body '
        "looks to the right, the dot is the end. Share of all moments.</p>"
    )
    sections = [
        ("", table(facts)),
        ("Rigs", _listed(record["rigs"])),
        ("Repairs", _listed(record["repairs"])),
        ("Largest clips", _listed(record["largest"])),
        ("Most used patterns", note + "".join(drawings)),
        ("Unlike everything else", _listed(record["unlike_all_others"])),
    ]
    return page("The library", sections)


def _most_used(catalog: Catalog) -> dict[str, list[dict[str, Any]]]:
    out = {}
    for number, part in enumerate(PARTS):
        said = [batch.words[:, number] for batch in catalog.batches]
        counts = np.bincount(np.concatenate(said), minlength=256) if said else np.zeros(256)
        counts[NO_WORD] = 0
        if kind_of(part) in catalog.vocabulary.centres and counts.sum():
            best = np.argsort(-counts, kind="stable")[:8]
            out[part] = [
                {"word": int(word), "share": float(counts[word] / counts.sum())}
                for word in best
                if counts[word]
            ]
    return out


def _loners(catalog: Catalog) -> list[dict[str, Any]]:
    """Return the clips whose nearest other clip is the least like them, by the postings."""
    found = []
    for name, number in catalog.numbers.items():
        query = Query(np.asarray(catalog.words(number)), own=number)
        clips, scores = best_clips(clip_scores(catalog, query, part_weights(query), "whole"), 1)
        if len(clips):
            found.append((float(scores[0]), name, catalog.names[int(clips[0])]))
    return [
        {"clip": name, "likeness": round(score, 3), "nearest": nearest}
        for score, name, nearest in sorted(found)[:SHOWN]
    ]


def _counted(values: Any) -> dict[str, int]:
    return dict(Counter(values).most_common())


def _listed(records: list[dict[str, Any]]) -> str:
    if not records:
        return "<p>None.</p>"
    return table([list(records[0]), *([_text(each) for each in row.values()] for row in records)])


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.3f}"
    return f"{value:,}" if isinstance(value, int) else str(value)
