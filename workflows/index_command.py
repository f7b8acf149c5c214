"""``motifold index``: the catalog of an archive, which `search` reads."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import ProgressLine, show_json, show_table
from .quantities import show_bytes

if TYPE_CHECKING:
    from ..catalog.indexing import Indexed


def index(
    archive: Annotated[Path, typer.Argument(help="Archive folder.")],
    rebuild: Annotated[
        bool, typer.Option("--rebuild", help="Begin anew, with patterns learned from all clips.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Seed of the learning.")] = 0,
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; 0 or 1: none. Default: one a core.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print what was done as JSON.")] = False,
) -> None:
    """Make ARCHIVE searchable: `motifold archive` does it by itself, this mends or renews it."""
    from ..pipeline.commit import read_commit

    read_commit(archive)
    made = update_index(archive, workers=workers, rebuild=rebuild, seed=seed)
    if json:
        show_json(asdict(made))
    else:
        show_index(made)
    if made.left_out:
        raise typer.Exit(3)


def update_index(
    archive: Path,
    *,
    workers: int | None,
    scheduler: str | None = None,
    rebuild: bool = False,
    seed: int = 0,
) -> Indexed:
    """Update the catalog of an archive, with progress on the terminal."""
    from ..catalog.indexing import update_catalog
    from ..pipeline.executors import executor
    from ..pipeline.lock import writer_lock

    line = ProgressLine()
    with writer_lock(archive), executor(workers, scheduler) as engine:
        made = update_catalog(
            archive,
            engine=engine,
            rebuild=rebuild,
            seed=seed,
            progress=lambda done, clips: line.update("index", done, clips),
        )
    line.clear()
    return made


def show_index(made: Indexed) -> None:
    """Print what an update of the catalog did."""
    words = sum(made.words.values())
    show_table(
        [
            ["clips that can be searched", f"{made.clips:,} ({made.new:,} new)"],
            ["patterns they are searched by", f"{words:,}"],
            ["catalog, beside the archive", show_bytes(made.catalog_bytes)],
        ]
    )
    for name, reason in made.left_out.items():
        print(f"not searchable: {name}: {reason}")
