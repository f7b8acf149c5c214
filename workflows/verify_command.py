"""``motifold verify``: check that an archive is whole."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from .console import ProgressLine, show_json
from .quantities import show_length


def verify(
    archive: Annotated[Path, typer.Argument(help="Archive folder.")],
    decode: Annotated[bool, typer.Option("--decode", help="Decode every clip too.")] = False,
    library: Annotated[
        Path | None,
        typer.Option(help="The archived folder: compare every clip with its source file."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; 0 or 1: none. Default: one a core.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was found as JSON.")] = False,
) -> None:
    """Check that every file of ARCHIVE is what was published, and every certificate holds."""
    from ..catalog.catalogcheck import check_catalog
    from ..pipeline.archive import Archive
    from ..pipeline.executors import executor
    from ..pipeline.verify import verify_archive

    line = ProgressLine()
    with Archive(archive) as opened, executor(workers if decode or library else 0) as engine:
        found = verify_archive(
            opened,
            engine=engine,
            decode=decode,
            library=library,
            progress=lambda count, total: line.update("verify", count, total),
        )
        found.problems += check_catalog(archive, opened, decode=decode)
    line.clear()
    if json:
        show_json(asdict(found))
    else:
        done = f"{found.clips:,} clips, {found.decoded:,} decoded"
        if library is not None:
            done += f", {found.measured:,} compared with their sources"
        print(f"{done}; largest error {show_length(found.max_error)}")
        if found.orphans:
            print(f"{found.orphans:,} index files belong to no published job (harmless)")
        for problem in found.problems:
            print(f"problem: {problem}")
        print("the archive is whole" if not found.problems else "the archive is DAMAGED")
    if found.problems:
        raise typer.Exit(3)
