"""``motifold report``: how an archive grows, and what is in it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import ProgressLine, show_json, show_table
from .quantities import (
    parse_counts,
    parse_length,
    show_bytes,
    show_duration,
    show_length,
)

if TYPE_CHECKING:
    from ..catalog.growth import GrowthPoint

report = typer.Typer(help="Reports on an archive, for people and as JSON.", no_args_is_help=True)

_ARCHIVE = Annotated[Path, typer.Argument(help="Archive folder.")]
_HTML = Annotated[Path | None, typer.Option(help="Write a page with pictures here.")]
_JSON = Annotated[bool, typer.Option("--json", help="Print as JSON.")]


@report.command("growth")
def growth(
    archive: _ARCHIVE,
    library: Annotated[
        Path | None, typer.Option(help="The archived folder: what --replay archives again.")
    ] = None,
    replay: Annotated[
        str, typer.Option(help="Sizes of random subsets to archive again, such as 10,30,100.")
    ] = "",
    tolerance: Annotated[
        str, typer.Option(help="Tolerances of the replay, such as 1mm,5mm. Default: the archive's.")
    ] = "",
    seed: Annotated[int, typer.Option(help="Seed of the draw of subsets.")] = 0,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; 0 or 1: none. Default: one a core.")
    ] = None,
    html: _HTML = None,
    svg: Annotated[
        Path | None, typer.Option(help="Write the curves of the replay here, as a picture.")
    ] = None,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the replay as a table of Markdown.")
    ] = False,
    json: _JSON = False,
) -> None:
    """Show how the compression ratio of ARCHIVE grows with its size.

    The whole archive is counted, store and ledgers included, and only clips of distinct content.
    """
    from ..catalog.growth import growth_record, ledger_growth
    from ..catalog.growth import replay as archive_again
    from ..codec.errors import UsageError
    from ..pipeline.archive import Archive
    from ..pipeline.plan import Settings

    sizes = parse_counts(replay) if replay else []
    if sizes and library is None:
        raise UsageError("a replay needs the source files", advice="Name them with --library")
    with Archive(archive) as opened:
        points = ledger_growth(opened)
    lengths = [parse_length(text) for text in tolerance.split(",") if text.strip()]
    lengths = lengths or sorted({point.tolerance for point in points})
    line = ProgressLine()
    again: list[GrowthPoint] = []
    for length in lengths if sizes else ():
        again += archive_again(
            library or Path(),
            sizes,
            Settings(tolerance=length),
            workers=workers,
            seed=seed,
            progress=lambda stage, done, clips, length=length: line.update(  # type: ignore[misc]
                f"{show_length(length)}, {stage}", done, clips
            ),
        )
    line.clear()
    record = {"jobs": growth_record(points), "replay": growth_record(again)}
    if html is not None or svg is not None or markdown:
        from ..catalog.growthpage import growth_markdown, growth_page, growth_picture

        shown = record["replay"] or record["jobs"]
    if svg is not None:
        svg.write_text(growth_picture(shown), "utf-8")
    if html is not None:
        html.write_text(growth_page(record), "utf-8")
    if json:
        show_json(record)
        return
    if markdown:
        print(growth_markdown(shown), end="")
        return
    _show_points("after each job", points)
    if again:
        _show_points("random subsets, archived again", again)


def _show_points(title: str, points: list[GrowthPoint]) -> None:
    print(title)
    header = ["clips", "tolerance", "archive", "source :", "text :", "float32 :"]
    rows = [
        [*header, "mean error", "largest", "predicted", "100 more clips", "equal files", "time"]
    ]
    for point in points:
        rows.append(
            [
                f"{point.clips:,}",
                show_length(point.tolerance),
                show_bytes(point.archive_bytes),
                *(f"{ratio:.1f}" for ratio in point.ratios.values()),
                show_length(point.mean_error),
                show_length(point.max_error),
                f"{100 * point.predicted:.0f} %",
                show_bytes(round(point.added_100)),
                f"{point.duplicates:,}",
                show_duration(point.seconds) if point.seconds else "-",
            ]
        )
    show_table(rows, header=True)


@report.command("library")
def library(archive: _ARCHIVE, html: _HTML = None, json: _JSON = False) -> None:
    """Show what is in ARCHIVE: clips, hours, rigs, repairs, patterns, clips like no other."""
    from ..catalog.catalogfolder import Catalog
    from ..catalog.library_report import library_page, library_record
    from ..pipeline.archive import Archive

    catalog = Catalog(archive, many=True)
    with Archive(archive) as opened:
        record = library_record(opened, catalog)
    if html is not None:
        html.write_text(library_page(record, catalog), "utf-8")
    if json:
        show_json(record)
        return
    show_table(
        [
            ["clips", f"{record['clips']:,}"],
            ["hours", f"{record['hours']:.2f}"],
            *([f"clips at {rate}", f"{count:,}"] for rate, count in record["frame_rates"].items()),
            *([f"repaired: {each['what']}", f"{each['files']:,}"] for each in record["repairs"]),
        ]
    )
    rigs = [["rig", "kind", "format", "joints", "clips"]]
    rigs += [[str(value) for value in each.values()] for each in record["rigs"]]
    largest = [["largest clips", "bytes", "seconds"]]
    largest += [
        [each["clip"], f"{each['bytes']:,}", f"{each['seconds']:.2f}"] for each in record["largest"]
    ]
    unlike = [["unlike everything else", "likeness", "nearest"]]
    unlike += [
        [each["clip"], f"{each['likeness']:.3f}", each["nearest"]]
        for each in record["unlike_all_others"]
    ]
    for rows in (rigs, largest, unlike):
        print()
        show_table(rows, header=True)
