"""``motifold search``: where else in the library does somebody move like this?"""

from __future__ import annotations

import csv as csv_format
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import show_json, show_table
from .quantities import parse_seconds

if TYPE_CHECKING:
    from ..catalog.search import Hit


def search(
    archive: Annotated[Path, typer.Argument(help="Archive folder.")],
    query: Annotated[str, typer.Argument(help="A clip of the archive, or a motion file.")],
    start: Annotated[
        str | None, typer.Option("--from", help="Search for what happens from here, such as 2.0s.")
    ] = None,
    stop: Annotated[str | None, typer.Option("--to", help="Up to here, such as 3.5s.")] = None,
    parts: Annotated[
        str, typer.Option(help="Only these body parts; arm=2 counts twice: left_arm,right_arm=2.")
    ] = "",
    top: Annotated[int, typer.Option(min=1, help="Number of hits.")] = 10,
    windows: Annotated[
        bool | None,
        typer.Option(
            "--windows/--whole-clip",
            help="Spans of clips, or clips from end to end. Default: spans with --from or --to.",
        ),
    ] = None,
    rerank: Annotated[
        str, typer.Option(help="dtw: compare the best word by word; none: order of the postings.")
    ] = "dtw",
    mirror: Annotated[bool, typer.Option("--mirror", help="Find its mirror image.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print as CSV.")] = False,
    html: Annotated[Path | None, typer.Option(help="Write a page with the hits here.")] = None,
) -> None:
    """Find the clips of ARCHIVE, or spans of them, that move like QUERY.

    Exit code 3: some of the catalog is damaged, and those clips were not searched.
    """
    from ..catalog.catalogfolder import Catalog
    from ..catalog.queries import ask
    from ..catalog.search import search as find
    from ..codec.errors import UsageError

    if rerank not in ("dtw", "none"):
        raise UsageError(f"unknown order {rerank!r}", advice="Use --rerank dtw or none")
    catalog = Catalog(archive)
    asked = ask(
        catalog,
        query,
        start=None if start is None else parse_seconds(start),
        stop=None if stop is None else parse_seconds(stop),
        parts=[part for part in parts.split(",") if part.strip()],
        mirror=mirror,
    )
    spans = (start is not None or stop is not None) if windows is None else windows
    mode = "windows" if spans else "whole"
    hits = find(catalog, asked.query, top=top, mode=mode, rerank=rerank)  # type: ignore[arg-type]
    notes = [*asked.notes, *catalog.problems]
    if catalog.stale:
        notes.append("the archive has changed since it was indexed: run motifold index")
    for note in notes:
        print(f"motifold: {note}", file=sys.stderr)
    if html is not None:
        from ..catalog.pages import search_page

        html.write_text(search_page(catalog, asked.query, query, hits), "utf-8")
    if json:
        show_json({"query": query, "mode": mode, "hits": [asdict(hit) for hit in hits]})
    elif csv:
        _show_csv(hits)
    else:
        _show_hits(hits)
    if catalog.problems:
        raise typer.Exit(3)


def _show_csv(hits: list[Hit]) -> None:
    parts = list(hits[0].parts) if hits else []
    out = csv_format.writer(sys.stdout, lineterminator="\n")
    out.writerow(["clip", "start", "stop", "score", *parts])
    for hit in hits:
        out.writerow([hit.clip, hit.start, hit.stop, hit.score, *hit.parts.values()])


def _show_hits(hits: list[Hit]) -> None:
    if not hits:
        print("nothing like it")
        return
    rows = [["clip", "from", "to", "score", *hits[0].parts]]
    for hit in hits:
        likeness = [f"{100 * part:.0f} %" for part in hit.parts.values()]
        rows.append(
            [hit.clip, f"{hit.start:.2f} s", f"{hit.stop:.2f} s", f"{hit.score:.3f}", *likeness]
        )
    show_table(rows, header=True)
