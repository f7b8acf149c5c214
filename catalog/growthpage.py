"""The growth report as a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .pages import chart, page, table

BASELINES = {
    "source": "the source files",
    "text": "the numbers that vary, as text of ten bytes each",
    "float32": "the numbers that vary, as float32",
}


def growth_page(record: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Return the page of a growth report (see `growth.growth_record`)."""
    sections = [
        (
            "",
            "<p>Bytes of each baseline over bytes of the whole archive: index files, store and "
            "ledgers. Clips with equal source files count once. The search catalog, which is "
            "made from the archive, is not counted.</p>",
        )
    ]
    if record["replay"]:
        sections.append(("Random subsets, archived again", _part(record["replay"])))
    sections.append(("After each job", _part(record["jobs"])))
    return page("How the archive grows", sections)


def _part(points: Sequence[Mapping[str, Any]]) -> str:
    out = []
    for key, title in BASELINES.items():
        if len(points) > 1:
            out.append(f"<h3>Against {title}</h3>")
            out.append(chart(_curves(points, key), "clips", "times smaller"))
    return "\n".join([*out, growth_table(points)])


def growth_picture(points: Sequence[Mapping[str, Any]], baseline: str = "float32") -> str:
    """Return the curves of a growth report against one baseline as an SVG file."""
    title = f"{baseline} : archive, whole store counted"
    drawn = chart(_curves(points, baseline), "clips", title)
    head = '<svg xmlns="http://www.w3.org/2000/svg" font-family="Helvetica, Arial, sans-serif" '
    white = '<rect width="100%" height="100%" fill="#ffffff"/>'
    opened, _, rest = drawn.replace("<svg ", head, 1).partition("\n")
    return f"{opened}\n{white}\n{rest}\n"


def growth_markdown(points: Sequence[Mapping[str, Any]]) -> str:
    """Return the points of a growth report as a Markdown table."""
    header, *rows = growth_rows(points)
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _curves(
    points: Sequence[Mapping[str, Any]], baseline: str
) -> dict[str, list[tuple[float, float]]]:
    curves: dict[str, list[tuple[float, float]]] = {}
    for point in points:
        name = f"{10 * point['tolerance']:g} mm"
        curves.setdefault(name, []).append((point["clips"], point["ratios"][baseline]))
    return curves


def growth_table(points: Sequence[Mapping[str, Any]]) -> str:
    """Return the points of a growth report as an HTML table."""
    return table(growth_rows(points))


def growth_rows(points: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Return the points of a growth report as rows of text, the first one a header."""
    rows = [
        [
            *("tolerance", "clips", "archive, bytes", *(f"{key} : archive" for key in BASELINES)),
            *("mean error", "largest error", "patterns", "predicted clips"),
            *("100 more clips, bytes", "equal files left out"),
        ]
    ]
    for point in points:
        rows.append(
            [
                f"{10 * point['tolerance']:g} mm",
                f"{point['clips']:,}",
                f"{point['archive_bytes']:,}",
                *(f"{point['ratios'][key]:.1f}" for key in BASELINES),
                f"{10 * point['mean_error']:.3g} mm",
                f"{10 * point['max_error']:.4g} mm",
                f"{point['patterns']:,}",
                f"{100 * point['predicted']:.0f} %",
                f"{point['added_100']:,.0f}",
                f"{point['duplicates']:,}",
            ]
        )
    return rows
