"""What commands show: tables for people, JSON for programs, progress on the terminal."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from typing import Any, TextIO


def show_table(rows: Sequence[Sequence[str]], *, header: bool = False) -> None:
    """Print rows in aligned columns: the first one and text to the left, numbers to the right.

    With ``header`` the first row is one: a line is drawn below it.
    """
    if not rows:
        return
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for number, row in enumerate(rows):
        cells = [
            cell.rjust(width) if column and _numeric(cell) else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        print("  ".join(cells).rstrip())
        if header and number == 0:
            print("  ".join("-" * width for width in widths))


def _numeric(cell: str) -> bool:
    return cell[:1].isdigit()


def show_json(record: Any) -> None:
    """Print a record as JSON."""
    print(json.dumps(record, indent=2))


class ProgressLine:
    """One line on the terminal that says how far a job is, and how fast.

    On standard error if no stream is named; silent when that is no terminal, so that logs stay
    readable.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self._shown = self._stream.isatty()
        self._stage = ""
        self._start = self._last = 0.0

    def update(self, stage: str, done: int, total: int, note: str = "") -> None:
        """Show that ``done`` of ``total`` clips have passed ``stage``."""
        now = time.monotonic()
        if stage != self._stage:
            self._stage, self._start, self._last = stage, now, 0.0
        if not self._shown or (now - self._last < 0.1 and done < total):
            return
        self._last = now
        rate = done / max(now - self._start, 1e-6)
        filled = 24 * done // max(total, 1)
        bar = "#" * filled + "." * (24 - filled)
        text = f"{stage:>8} [{bar}] {done}/{total} clips, {rate:.0f} clips/s{note}"
        self._stream.write(f"\r\x1b[K{text}")
        self._stream.flush()

    def clear(self) -> None:
        """Remove the line."""
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()
