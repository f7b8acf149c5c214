"""``motifold duplicates``: clips that a library holds twice."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from .console import ProgressLine, show_json, show_table
from .quantities import show_length


def duplicates(
    archive: Annotated[Path, typer.Argument(help="Archive folder.")],
    retakes: Annotated[
        bool, typer.Option("--retakes/--no-retakes", help="Takes of the same movement, too.")
    ] = True,
    json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """Find equal files, near duplicates, crops, mirrored takes and retakes in ARCHIVE."""
    from ..catalog.catalogfolder import Catalog
    from ..catalog.duplicates import find_duplicates
    from ..pipeline.archive import Archive

    line = ProgressLine()
    with Archive(archive) as opened:
        found = find_duplicates(
            opened,
            Catalog(archive, many=True),
            retakes=retakes,
            progress=lambda done, clips: line.update("compare", done, clips),
        )
    line.clear()
    if json:
        show_json([asdict(pair) for pair in found])
        return
    if not found:
        print("no clip is there twice")
        return
    rows = [["kind", "clip", "other", "starts at", "apart"]]
    for pair in found:
        place = f"{pair.offset:.3f} s"
        rows.append([pair.kind, pair.clip, pair.other, place, show_length(pair.distance)])
    show_table(rows, header=True)
    counts = Counter(pair.kind for pair in found)
    print("\n" + ", ".join(f"{kind}: {count:,}" for kind, count in counts.items()))
