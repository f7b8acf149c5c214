"""Printing tables of figures, for the terminal or as Markdown."""

from __future__ import annotations

from collections.abc import Sequence


def print_table(rows: Sequence[Sequence[str]], *, markdown: bool = False) -> None:
    """Print rows, the first of which is the header; the first column is text."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for number, row in enumerate(rows):
        cells = [
            cell.rjust(width) if column else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        print(f"| {' | '.join(cells)} |" if markdown else "  ".join(cells).rstrip())
        if number == 0:
            lines = ["-" * (width - 1) + ("-:"[column > 0]) for column, width in enumerate(widths)]
            print(f"| {' | '.join(lines)} |" if markdown else "  ".join("-" * w for w in widths))
