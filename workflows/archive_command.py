"""``motifold archive``: archive the clips of a library."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .console import ProgressLine, show_json, show_table
from .index_command import show_index, update_index
from .quantities import (
    parse_bound,
    parse_length,
    parse_span_bound,
    parse_weight,
    show_bytes,
    show_duration,
    show_length,
    show_ratio,
)

if TYPE_CHECKING:
    from ..pipeline.report import Progress, Report

# Largest error over the allowed mean where no tolerance is given: a joint may not fly off.
NO_BOUND = 100.0


def archive(
    library: Annotated[Path, typer.Argument(help="Folder of motion files.")],
    archive: Annotated[Path, typer.Argument(help="Archive folder; made if it is not there.")],
    tolerance: Annotated[
        str | None,
        typer.Option(help="Largest error of any joint at any frame, such as 0.5mm. Default: 1mm."),
    ] = None,
    mean_tolerance: Annotated[
        str | None,
        typer.Option(help="Largest mean error of a clip, instead of or beside --tolerance."),
    ] = None,
    joint_tolerance: Annotated[
        list[str] | None,
        typer.Option(help="Joints (a name or glob) with their own, such as LeftFoot=0.2mm."),
    ] = None,
    joint_weight: Annotated[
        list[str] | None,
        typer.Option(help="Joints (a name or glob) whose errors count so many times: LeftFoot=5."),
    ] = None,
    span_tolerance: Annotated[
        list[str] | None,
        typer.Option(help="A time span of every clip with its own, such as 2s-3.5s=0.2mm."),
    ] = None,
    include: Annotated[
        list[str] | None, typer.Option(help="Only files that match this glob; may be repeated.")
    ] = None,
    units: Annotated[
        str | None, typer.Option(help="Length unit of the files (mm, cm, m, in), for all of them.")
    ] = None,
    parts: Annotated[
        Path | None, typer.Option(help="TOML file that names body parts (see the README).")
    ] = None,
    segmentation: Annotated[
        str, typer.Option(help="How clips are cut: threshold (Gu 2009) or fisher (optimal).")
    ] = "threshold",
    cluster_bound: Annotated[
        str, typer.Option(help="What clusters bound: max (MaxError) or average (AveError).")
    ] = "max",
    cluster_radius: Annotated[
        float, typer.Option(help="Bound of the clusters, in head diagonals.")
    ] = 0.6,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; 0 or 1: none. Default: one a core.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Dask scheduler to use instead, such as tcp://host:8786.")
    ] = None,
    seed: Annotated[
        int, typer.Option(help="Seed of the draw of references, and of average-bound clustering.")
    ] = 0,
    codec: Annotated[
        str, typer.Option(help="learned (version 2), or patterns (version 1, for comparison).")
    ] = "learned",
    references: Annotated[
        int, typer.Option(min=0, help="Clips that a clip is predicted from at the most.")
    ] = 4,
    model: Annotated[
        str, typer.Option(help="learned, basis (all but the prediction) or fixed.")
    ] = "learned",
    without: Annotated[
        list[str] | None,
        typer.Option(help="Idea to leave out: basis, parents, contexts, world or mirrors."),
    ] = None,
    streams: Annotated[
        str,
        typer.Option(help="runs, or parts: 1 to 4 % more, but a body part decodes by itself."),
    ] = "runs",
    index: Annotated[
        bool, typer.Option("--index/--no-index", help="Keep the search catalog up to date.")
    ] = True,
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
) -> None:
    """Archive the motion files of LIBRARY into ARCHIVE.

    Clips that are there already, unchanged and inside the tolerance, are skipped; files that
    cannot be used are listed at the end (exit code 3) and stop nothing. An interrupted job
    leaves the archive as it was.
    """
    from ..codec.figure.bodyparts import load_parts
    from ..codec.patterns.segments import SegmentRules
    from ..pipeline.clustering import ClusterRules
    from ..pipeline.plan import Settings
    from ..pipeline.run import archive_library

    settings = Settings(
        **_bounds(
            tolerance,
            mean_tolerance,
            joint_tolerance or [],
            joint_weight or [],
            span_tolerance or [],
        ),
        units=units,
        segments=SegmentRules(segmentation),  # type: ignore[arg-type]  # it checks the name
        clusters=ClusterRules(cluster_bound, cluster_radius),  # type: ignore[arg-type]
        seed=seed,
        codec=codec,  # type: ignore[arg-type]
        references=references,
        model=model,  # type: ignore[arg-type]
        without=tuple(without or ()),
        streams=streams,  # type: ignore[arg-type]
    )
    line = ProgressLine()
    report = archive_library(
        library,
        archive,
        settings,
        include=include or (),
        parts=load_parts(parts) if parts else None,
        workers=workers,
        scheduler=scheduler,
        progress=lambda step: _show_progress(line, step),
    )
    line.clear()
    indexed = update_index(archive, workers=workers, scheduler=scheduler) if index else None
    if json:
        show_json({**asdict(report), "index": asdict(indexed) if indexed else None})
    else:
        show_report(report)
        if indexed:
            show_index(indexed)
    if report.failures or (indexed and indexed.left_out):
        raise typer.Exit(3)


def _bounds(
    tolerance: str | None,
    mean: str | None,
    joints: list[str],
    weights: list[str],
    spans: list[str],
) -> dict[str, Any]:
    """Return the bounds of `Settings` that the options ask for.

    What counts five times may be off by a fifth of the tolerance.
    """
    bounds: dict[str, Any] = {
        "span_tolerances": tuple(parse_span_bound(text) for text in spans),
    }
    if mean is not None:
        bounds["mean_tolerance"] = parse_length(mean)
        bounds["tolerance"] = NO_BOUND * bounds["mean_tolerance"]
    if tolerance is not None or mean is None:
        bounds["tolerance"] = parse_length(tolerance or "1mm")
    weighted = [(name, bounds["tolerance"] / weight) for name, weight in map(parse_weight, weights)]
    bounds["joint_tolerances"] = (*map(parse_bound, joints), *weighted)
    return bounds


def _show_progress(line: ProgressLine, step: Progress) -> None:
    note = ""
    if step.archived_bytes:
        note = f", {step.source_bytes / step.archived_bytes:.1f} : 1 so far"
    line.update(step.stage, step.done, step.clips, note)


def show_report(report: Report) -> None:
    """Print what an archive job did."""
    rows = [
        ["clips archived", f"{report.clips:,}"],
        ["clips unchanged", f"{report.unchanged:,}"],
        ["files that failed", f"{len(report.failures):,}"],
    ]
    if report.clips:
        rows += [
            ["source files", show_bytes(report.source_bytes)],
            ["float32 of what varies", show_bytes(report.float32_bytes)],
            ["their index files", show_bytes(report.index_bytes)],
            ["largest error", show_length(report.max_error)],
            ["mean error", show_length(report.mean_error)],
        ]
    rows += [
        ["whole archive, with store", show_bytes(report.archive_bytes)],
        *([["patterns in the store", f"{report.patterns:,}"]] if report.patterns else []),
        ["time", show_duration(sum(report.seconds.values()))],
    ]
    if report.clips and not report.unchanged:
        rows += [
            ["source : archive", show_ratio(report.source_bytes, report.archive_bytes)],
            ["float32 : archive", show_ratio(report.float32_bytes, report.archive_bytes)],
        ]
    show_table(rows)
    for failure in report.failures:
        print(f"failed: {failure.name}: {failure.reason}")
