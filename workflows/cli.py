"""The ``motifold`` command: one subcommand a file, imported only when it runs.

Exit codes: 0 done; 1 a bug of motifold (with a traceback); 2 wrong use, or an archive that
cannot be used; 3 done, but some inputs failed; 130 interrupted.
"""

from __future__ import annotations

import io
import sys
from enum import IntEnum

import typer

from ..codec.errors import MotifoldError
from . import (
    archive_command,
    demo_command,
    duplicates_command,
    evaluate_command,
    index_command,
    info_command,
    report_command,
    restore_command,
    search_command,
    verify_command,
)


class Exit(IntEnum):
    """What the exit code of a command says."""

    DONE = 0
    BUG = 1
    WRONG_USE = 2
    SOME_FAILED = 3
    INTERRUPTED = 130


app = typer.Typer(
    name="motifold",
    help="Fold a motion-capture library into a small archive, and get every clip back "
    "inside a certified error.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.command("archive")(archive_command.archive)
app.command("restore")(restore_command.restore)
app.command("verify")(verify_command.verify)
app.command("info")(info_command.info)
app.command("search")(search_command.search)
app.command("duplicates")(duplicates_command.duplicates)
app.command("evaluate")(evaluate_command.evaluate)
app.command("index")(index_command.index)
app.add_typer(report_command.report, name="report")
app.command("demo")(demo_command.demo)


@app.callback(invoke_without_command=True)
def _version(
    context: typer.Context,
    version: bool = typer.Option(False, "--version", help="Print the version and exit."),
) -> None:
    if version:
        from importlib.metadata import version as installed

        print(f"motifold {installed('motifold')}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit(Exit.WRONG_USE)


def main() -> None:
    """Run the command line; motifold's own errors become one line and an exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # file names need not be text
            stream.reconfigure(errors="surrogateescape")
    try:
        app()
    except MotifoldError as problem:
        print(f"motifold: {problem}", file=sys.stderr)
        sys.exit(Exit.WRONG_USE)
    except SystemExit as ended:
        if ended.code == Exit.INTERRUPTED:  # typer's answer to Ctrl-C
            print("motifold: interrupted; the archive is as it was", file=sys.stderr)
        raise
