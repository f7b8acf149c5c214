"""The demo: quick, and everything that it claims is so."""

from __future__ import annotations

import re
import time
from pathlib import Path

import oracle
import pytest
from libraries import counted_bytes, tree
from typer.testing import CliRunner

from motifold.codec.errors import UsageError
from motifold.workflows.cli import app
from motifold.workflows.quantities import parse_length, show_bytes


def shown(out: str, label: str) -> str:
    found = re.search(rf"^{re.escape(label)}\s+(.+)$", out, re.MULTILINE)
    assert found, f"{label} is not shown"
    return found[1].strip()


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, float]:
    folder = tmp_path_factory.mktemp("demo") / "kept"
    start = time.monotonic()
    result = CliRunner().invoke(
        app, ["demo", "--clips", "6", "--workers", "0", "--out", str(folder)]
    )
    assert result.exit_code == 0, result.output
    return folder, result.output, time.monotonic() - start


def test_it_is_quick(demo: tuple[Path, str, float]) -> None:
    assert demo[2] < 20


def test_its_figures_are_those_of_the_files(demo: tuple[Path, str, float]) -> None:
    folder, out, _ = demo
    source = sum(map(len, tree(folder / "library").values()))
    archive = counted_bytes(folder / "archive")
    assert shown(out, "clips") == "6"
    assert shown(out, "source files") == show_bytes(source)
    assert shown(out, "archive, with store") == show_bytes(archive)
    assert shown(out, "source : archive") == f"{source / archive:.2f}"
    assert f"kept in {folder}: library/, archive/, restored/" in out


def test_every_clip_came_back_inside_the_tolerance(demo: tuple[Path, str, float]) -> None:
    folder, out, _ = demo
    assert "all 6 clips came back inside 1 mm" in out
    library, restored = tree(folder / "library"), tree(folder / "restored")
    assert library.keys() == restored.keys()
    worst = 0.0
    for name, source in library.items():
        error = oracle.shell_error(oracle.read_bvh(source), oracle.read_bvh(restored[name]))
        worst = max(worst, float(error.max()))
    assert worst <= 0.1 + 1e-4
    assert parse_length(shown(out, "largest error, measured")) == pytest.approx(worst, abs=2e-4)


def test_it_keeps_nothing_unless_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import tempfile

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    words = ["demo", "--clips", "1", "--workers", "0", "--tolerance", "5mm", "--seed", "3"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0
    assert "all 1 clips came back inside 5 mm" in result.output
    assert list(tmp_path.iterdir()) == []


def test_it_overwrites_nothing(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("")
    result = CliRunner().invoke(app, ["demo", "--out", str(tmp_path)])
    assert isinstance(result.exception, UsageError)
    assert tree(tmp_path) == {"mine": b""}
