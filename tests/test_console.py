"""What commands show: tables that line up, JSON that parses, progress only on terminals."""

from __future__ import annotations

import io
import json
import sys
import time

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from motifold.workflows.console import ProgressLine, show_json, show_table

cells = st.text(st.characters(codec="ascii", exclude_categories=["Cc"]), max_size=9)
tables = st.integers(1, 4).flatmap(
    lambda width: st.lists(st.lists(cells, min_size=width, max_size=width), max_size=5)
)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@given(tables)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_every_cell_is_in_its_row_and_columns_line_up(
    capsys: pytest.CaptureFixture[str], rows: list[list[str]]
) -> None:
    capsys.readouterr()
    show_table(rows)
    lines = capsys.readouterr().out.split("\n")[:-1]
    assert len(lines) == len(rows)
    if not rows:
        return
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for line, row in zip(lines, rows, strict=True):
        at = 0
        for cell, width in zip(row, widths, strict=True):
            assert line[at : at + width].strip() == cell.strip()
            at += width + 2


def test_text_is_to_the_left_and_numbers_to_the_right(capsys: pytest.CaptureFixture[str]) -> None:
    show_table([["clip", "bytes"], ["01_01.amc", "7"], ["run", "1,234"]], header=True)
    assert capsys.readouterr().out.split("\n") == [
        "clip       bytes",
        "---------  -----",
        "01_01.amc      7",
        "run        1,234",
        "",
    ]


def test_nothing_is_shown_for_no_rows(capsys: pytest.CaptureFixture[str]) -> None:
    show_table([], header=True)
    assert capsys.readouterr().out == ""


def test_json_comes_back(capsys: pytest.CaptureFixture[str]) -> None:
    record = {"a": [1, 2.5, None, "caf\udce9 ü"]}
    show_json(record)
    out = capsys.readouterr().out
    assert out.isascii()
    assert json.loads(out) == record


def test_progress_is_silent_where_nobody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    log = io.StringIO()
    for line in (ProgressLine(log), ProgressLine(io.StringIO())):
        line.update("encode", 1, 2)
        line.clear()
    assert log.getvalue() == ""
    monkeypatch.setattr(sys, "stderr", log)
    ProgressLine().update("encode", 1, 2)
    assert log.getvalue() == ""


def test_progress_says_how_far_and_leaves_no_trace(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(time, "monotonic", lambda: now)
    terminal = Terminal()
    line = ProgressLine(terminal)
    line.update("encode", 0, 40)
    for now, done in ((1.0, 10), (1.01, 11), (2.0, 20), (2.01, 40)):  # noqa: B007 - monotonic's
        line.update("encode", done, 40, ", 9.0 : 1 so far")
    shown = terminal.getvalue()
    assert "10/40 clips, 10 clips/s, 9.0 : 1 so far" in shown
    assert "[######.................." in shown
    assert "11/40" not in shown, "ten times a second is enough"
    assert "40/40" in shown, "but the end is shown"
    line.clear()
    assert terminal.getvalue().endswith("\r\x1b[K")
    assert "\n" not in terminal.getvalue()


def test_each_stage_has_a_clock_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([0.0, 100.0, 101.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(times))
    terminal = Terminal()
    line = ProgressLine(terminal)
    line.update("survey", 0, 8)
    line.update("encode", 0, 8)
    line.update("encode", 8, 8)
    assert "8/8 clips, 8 clips/s" in terminal.getvalue()


def test_progress_of_nothing_divides_by_nothing() -> None:
    line = ProgressLine(Terminal())
    line.update("encode", 0, 0)
