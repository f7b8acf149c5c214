"""Tables say plainly what is missed, pictures hold their points, READMEs keep the rest."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import numpy as np
import pytest
from acl_comparison import figure, read_acl
from curve_picture import HEIGHT, WIDTH, Axis, Curve, Panel, draw
from hypothesis import given
from hypothesis import strategies as st
from rate_curves import Run
from readme_block import BEGIN, END, with_block
from result_tables import all_tables, markdown_table, panels
from targets import Figure

ABOUT = {"command": "python x.py", "clips": 2476, "of": 2476, "seed": 0, "code": "abc"}


def acl_section(ratio: float, clips: int = 2476) -> dict[str, Any]:
    figures = [
        {
            "precision": precision,
            "acl_bytes": 1000,
            "acl_joint_mean": mean,
            "max_ratio": ratio,
            "mean_ratio": ratio,
            "notes": [],
        }
        for precision, mean in (("0.01", 0.003), ("0.1", 0.03), ("1.0", 0.3))
    ]
    curve = [[0.003, 500], [0.3, 100]]
    section = {"figures": figures, "joint_frames": 80, "curve": curve, "acl_curve": curve}
    return {**ABOUT, **section, "clips": clips}


def growth_section(growth: float, small: int = 24) -> dict[str, Any]:
    entry = {"small_ratio": 2.0, "small_least": 1.0, "small_most": 3.0, "large_ratio": 4.0}
    figures = [{**entry, "tolerance": tolerance, "growth": growth} for tolerance in (0.1, 0.5)]
    return {**ABOUT, "small": small, "large": 2400, "draws": 5, "figures": figures}


def test_verdicts() -> None:
    assert Figure("x", 0.43, 0.42, True).missed
    assert not Figure("x", 0.42, 0.42, True).missed
    assert Figure("x", 1.4, 1.5, True, at_least=True).missed
    assert not Figure("x", 1.5, 1.5, True, at_least=True).missed
    assert not Figure("x", 9.0, None, True).missed
    sample = Figure("x", 9.0, 0.42, False)
    assert not sample.missed
    assert not sample.judged
    assert "sample" in sample.cell


def test_missed_targets_are_named() -> None:
    bad = all_tables({"acl/bandai": acl_section(0.36), "growth/bandai": growth_section(1.2)})
    assert bad.count("**missed**") == 6  # mean at 0.1 and 1, max at 0.1 and 1, growth twice
    assert "Missed: 6 of 8 targets" in bad
    assert "ACL, Bandai clips, mean matched, 1 cm" in bad
    assert "0.360 (target 0.36, met)" in bad
    good = all_tables({"acl/bandai": acl_section(0.1), "growth/bandai": growth_section(1.6)})
    assert "missed" not in good
    assert "All 8 targets" in good
    assert "`python x.py`" in good


def test_samples_are_not_judged() -> None:
    text = all_tables(
        {"acl/bandai": acl_section(9.0, clips=24), "growth/bandai": growth_section(0.5, small=2)}
    )
    assert "a random 24 of 2,476" in text
    assert "issed" not in text
    assert "met)" not in text


def test_mixed_states_of_the_code_are_told() -> None:
    other = {**growth_section(1.6), "code": "def"}
    assert "different states" in all_tables(
        {"acl/bandai": acl_section(0.1), "growth/bandai": other}
    )
    assert "different states" not in all_tables({"acl/bandai": acl_section(0.1)})


def test_sz3_and_text_tables() -> None:
    kinds = {
        "codec": {"bytes": 2000, "ratio": 0.5, "joint_mean": 0.02},
        "reach": {"bytes": 1000, "ratio": 1.0, "joint_mean": 0.02},
    }
    entry = {"tolerance": 0.1, "archive_bytes": 1000, **kinds}
    sizes = {"text_bytes": 9000, "zip_bytes": 3000, "xz_bytes": 1500, "float32_bytes": 1800}
    results = {
        "acl/bandai": acl_section(0.1),
        "sz3/bandai": {**ABOUT, "figures": [entry]},
        "text/bandai": {
            **ABOUT,
            **sizes,
            "figures": [{"tolerance": 1.0, "archive_bytes": 100}],
        },
    }
    text = all_tables(results)
    assert "0.500 (target 0.55, met)" in text
    assert "1.000 (target 0.55, **missed**)" in text
    assert "| motifold, 1 cm | 100 | 90.00 |" in text
    [panel] = panels(results)
    assert [curve.label for curve in panel.curves] == [
        "ACL 2.1",
        "SZ3, one-dimensional",
        "motifold, whole archive",
        "targets",
    ]
    assert panel.curves[1].points == [(0.2, 100.0)]
    assert panel.curves[3].points[0] == pytest.approx((0.03, 42.0))
    results["sz3/bandai"] = {**ABOUT, "clips": 3, "figures": [entry]}
    assert "SZ3, one-dimensional" not in [curve.label for curve in panels(results)[0].curves]


def test_a_picture_holds_its_points() -> None:
    panels = [
        Panel(f"{name} <&>", [Curve("a", "#111111", [(0.1, 3.0), (20.0, 40.0)])], [("level", 90.0)])
        for name in ("one", "two")
    ]
    root = ElementTree.fromstring(draw(panels, "x", "y"))
    assert float(root.get("width", 0)) == 2 * WIDTH
    places = [
        (float(circle.get("cx", -1)), float(circle.get("cy", -1)))
        for circle in root.iter("{http://www.w3.org/2000/svg}circle")
    ]
    assert len(places) == 2 * 3  # a point each, and one in the legend
    assert all(0 < x < 2 * WIDTH and 0 < y < HEIGHT for x, y in places)
    with pytest.raises(ValueError, match="positive"):
        draw([Panel("t", [Curve("a", "#111111", [(0.0, 1.0)])])], "x", "y")
    with pytest.raises(ValueError, match="positive"):
        draw([], "x", "y")


@given(st.floats(1e-6, 1e6), st.floats(1.01, 1e6))
def test_ticks_lie_on_the_axis(low: float, times: float) -> None:
    axis = Axis(low, low * times, 0.0, 100.0)
    assert axis.at(low) == pytest.approx(0.0)
    assert axis.at(low * times) == pytest.approx(100.0)
    assert all(-1 <= axis.at(tick) <= 101 for tick in axis.ticks())


@given(st.text(), st.text(), st.text())
def test_a_readme_keeps_all_but_the_block(before: str, block: str, after: str) -> None:
    text = f"{before}{BEGIN} old {END}{after}"
    if text.count(BEGIN) != 1 or text.count(END) != 1:
        return
    once = with_block(text, block)
    assert once.startswith(before + BEGIN)
    assert once.endswith(END + after)
    assert block.strip() in once
    assert with_block(once, block) == once


@pytest.mark.parametrize("text", ["", BEGIN, f"{END}{BEGIN}", f"{BEGIN}{BEGIN}{END}"])
def test_a_readme_without_its_markers_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="once each"):
        with_block(text, "x")


def test_tables_have_a_line_a_row() -> None:
    assert markdown_table([["a", "b"], ["1", "2"]]) == "| a | b |\n|---|---|\n| 1 | 2 |"


def test_acl_figures_are_weighted_by_frames(tmp_path: Path) -> None:
    path = tmp_path / "acl.csv"
    path.write_text(
        "clip,frames,joints,precision_cm,bytes,shell_max_cm,joint_mean_cm\n"
        "b,30,2,0.1,100,0.2,0.01\n"
        "a,10,2,0.1,50,0.1,0.05\n"
        "c,99,2,0.1,70,0.1,0.99\n"
    )
    acl = read_acl(path, ["a", "b"])["0.1"]
    assert acl.bytes == 150
    assert acl.joint_frames == 80
    assert acl.joint_mean == pytest.approx(0.02)
    assert acl.shell_largest.tolist() == [0.1, 0.2]
    with pytest.raises(SystemExit, match="no row for d"):
        read_acl(path, ["d"])
    with pytest.raises(SystemExit, match="not there"):
        read_acl(tmp_path / "none.csv", ["a"])
    sizes = np.array([20.0, 40.0])
    largest = np.array([0.1, 0.2])
    run = Run("max", 0.2, sizes, largest, 75, 0, 0, 0.02)
    found = figure(acl, [run], [run])
    assert found["max_ratio"] == pytest.approx(75 / 150)
    assert found["mean_ratio"] == pytest.approx(75 / 150)
    assert found["notes"] == []
