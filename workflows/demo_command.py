"""``motifold demo``: the whole round on a synthetic library, without any data."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from .console import ProgressLine, show_table
from .quantities import parse_length, show_bytes, show_duration, show_length, show_ratio


def demo(
    out: Annotated[
        Path | None, typer.Option(help="New folder to keep everything in. Default: none is kept.")
    ] = None,
    clips: Annotated[int, typer.Option(min=1, help="Number of clips.")] = 60,
    seed: Annotated[int, typer.Option(help="Seed of the library.")] = 0,
    tolerance: Annotated[str, typer.Option(help="Largest error allowed.")] = "1mm",
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; 0 or 1: none. Default: one a core.")
    ] = None,
) -> None:
    """Make a synthetic library, archive it, verify it, restore it, and show the figures."""
    from ..codec.errors import UsageError

    if out is None:
        with tempfile.TemporaryDirectory(prefix="motifold-demo-") as folder:
            _run(Path(folder), clips, seed, parse_length(tolerance), workers)
        return
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UsageError("is there already", file=out, advice="Name a new folder")
    _run(out, clips, seed, parse_length(tolerance), workers)
    print(f"\nkept in {out}: library/, archive/, restored/")


def _run(folder: Path, clips: int, seed: int, tolerance: float, workers: int | None) -> None:
    from ..pipeline.archive import Archive
    from ..pipeline.executors import SerialExecutor
    from ..pipeline.plan import Settings
    from ..pipeline.restore import restore_clips
    from ..pipeline.run import archive_library
    from ..pipeline.verify import verify_archive
    from .synthetic import write_library

    line = ProgressLine()
    print(f"1. a synthetic library of {clips} clips: walk, run, reach, wave, turn, idle …")
    write_library(
        folder / "library", clips, seed, lambda done, total: line.update("write", done, total)
    )
    print(f"2. archive it, no joint off by more than {show_length(tolerance)}")
    report = archive_library(
        folder / "library",
        folder / "archive",
        Settings(tolerance=tolerance),
        workers=workers,
        progress=lambda step: line.update(step.stage, step.done, step.clips),
    )
    with Archive(folder / "archive") as archive:
        line.clear()
        print("3. verify: decode every clip and compare it with its source")
        engine = SerialExecutor()
        found = verify_archive(archive, engine=engine, library=folder / "library")
        print("4. restore every clip as BVH")
        back = restore_clips(archive, list(archive), folder / "restored", engine=engine)
    line.clear()
    print()
    show_table(
        [
            ["clips", f"{report.clips:,}"],
            ["source files", show_bytes(report.source_bytes)],
            ["float32 of what varies", show_bytes(report.float32_bytes)],
            ["archive, with store", show_bytes(report.archive_bytes)],
            ["source : archive", show_ratio(report.source_bytes, report.archive_bytes)],
            ["float32 : archive", show_ratio(report.float32_bytes, report.archive_bytes)],
            ["largest error, measured", show_length(found.max_error)],
            ["mean error", show_length(report.mean_error)],
            ["time to archive", show_duration(sum(report.seconds.values()))],
        ]
    )
    problems = [f"{failure.name}: {failure.reason}" for failure in report.failures + back.failures]
    problems += found.problems
    for problem in problems:
        print(f"problem: {problem}")
    if problems:
        raise typer.Exit(3)
    print(f"\nall {len(back.files)} clips came back inside {show_length(tolerance)}")
