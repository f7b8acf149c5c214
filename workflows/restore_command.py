"""``motifold restore``: get clips back as motion files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .console import ProgressLine, show_json
from .quantities import parse_seconds, show_bytes


def restore(
    archive: Annotated[Path, typer.Argument(help="Archive folder.")],
    clips: Annotated[
        list[str] | None, typer.Argument(help="Clip names or globs; none means all.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder to write to.")] = ...,  # type: ignore[assignment]
    tier: Annotated[
        str, typer.Option(help="tolerance: inside the certified error; preview: a quick sketch.")
    ] = "tolerance",
    format: Annotated[
        str | None, typer.Option(help="bvh, trc or npz. Default: the source's, where possible.")
    ] = None,
    parts: Annotated[
        str, typer.Option(help="Only these body parts, and what they hang on: left_arm,head.")
    ] = "",
    start: Annotated[
        str | None, typer.Option("--from", help="Only from here on, such as 2.0s.")
    ] = None,
    stop: Annotated[str | None, typer.Option("--to", help="Only up to here, such as 3.5s.")] = None,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; 0 or 1: none. Default: one a core.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was done as JSON.")] = False,
) -> None:
    """Write CLIPS of ARCHIVE as motion files into a folder.

    Parts of skeletons are written as npz, parts of marker sets as trc or npz.
    """
    from ..codec.errors import UsageError
    from ..codec.formats.files import WRITABLE
    from ..pipeline.archive import Archive
    from ..pipeline.executors import executor
    from ..pipeline.restore import Excerpt, restore_clips

    if tier not in ("preview", "tolerance"):
        raise UsageError(f"unknown tier {tier!r}", advice="Use preview or tolerance")
    if format is not None and format not in WRITABLE:
        raise UsageError(f"cannot write {format!r}", advice=f"Use {', '.join(WRITABLE)}")
    excerpt = Excerpt(
        tuple(part.strip() for part in parts.split(",") if part.strip()),
        None if start is None else parse_seconds(start),
        None if stop is None else parse_seconds(stop),
    )
    line = ProgressLine()
    with Archive(archive) as opened:
        names = list(dict.fromkeys(name for text in clips or ["*"] for name in opened.find(text)))
        with executor(workers if len(names) > 32 else 0) as engine:
            done = restore_clips(
                opened,
                names,
                out,
                engine=engine,
                tier="preview" if tier == "preview" else "tolerance",
                format=format,
                excerpt=excerpt,
                progress=lambda count, total: line.update("restore", count, total),
            )
    line.clear()
    if json:
        failed = [[failure.name, failure.reason] for failure in done.failures]
        show_json({"files": done.files, "bytes": done.bytes, "failures": failed})
    else:
        print(f"restored {len(done.files):,} clips, {show_bytes(done.bytes)}, into {out}")
        for failure in done.failures:
            print(f"failed: {failure.name}: {failure.reason}")
    if done.failures:
        raise typer.Exit(3)
