"""Measured figures as Markdown tables, each with its command, and as the picture's panels.

Figures come as ``{"acl/bandai": {...}, "sz3/bandai": {...}, ...}``: a section by what was
compared and on which set, as `rate_distortion` measures and keeps them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from curve_picture import Curve, Panel
from motion_sets import SETS
from targets import ACL, GROWTH, GROWTH_CLIPS, QUICK_CODERS, SZ3, Figure

Section = Mapping[str, Any]
Results = Mapping[str, Section]

MATCHED = {
    "mean": "mean joint error matched over the library",
    "max": "largest shell error matched clip by clip",
}


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """Return rows, the first of which is the header, as a Markdown table."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]])


def all_tables(results: Results) -> str:
    """Return every table that there are figures for, and what is missed, as Markdown."""
    blocks = []
    figures: list[Figure] = []
    for title, make in (
        ("ACL 2.1", _acl),
        ("SZ3", _sz3),
        ("Growth", _growth),
        ("General compressors", _text),
    ):
        words, found = make(results)
        figures += found
        if words:
            blocks.append(f"**{title}.** {words}")
    blocks += _verdict(figures)
    if len({section["code"] for section in results.values()}) > 1:
        codes = ", ".join(f"{name} {section['code']}" for name, section in results.items())
        blocks.append(f"These figures come from different states of the code: {codes}.")
    return "\n\n".join(blocks)


def _verdict(figures: Sequence[Figure]) -> list[str]:
    """Return a paragraph that says which targets are missed, if any figure is judged."""
    judged = [figure for figure in figures if figure.judged]
    if not judged:
        return []
    missed = [figure.what for figure in judged if figure.missed]
    if not missed:
        return [f"**All {len(judged)} targets measured here are met.**"]
    return [f"**Missed: {len(missed)} of {len(judged)} targets:** {'; '.join(missed)}."]


def of_clips(name: str, section: Section) -> str:
    """Return which clips a section is about, in words."""
    title = SETS[name].title
    if _whole(section):
        return f"all {section['of']:,} {title}"
    return f"a random {section['clips']:,} of {section['of']:,} {title}"


def _whole(section: Section) -> bool:
    return bool(section["clips"] == section["of"])


def _sections(results: Results, kind: str) -> list[tuple[str, Section]]:
    return [(name, results[f"{kind}/{name}"]) for name in SETS if f"{kind}/{name}" in results]


def _commands(sections: Sequence[tuple[str, Section]]) -> str:
    return "\n".join(f"`{section['command']}`  " for _, section in sections).rstrip()


def _acl(results: Results) -> tuple[str, list[Figure]]:
    sections = _sections(results, "acl")
    if not sections:
        return "", []
    precisions = [figure["precision"] for figure in sections[0][1]["figures"]]
    given = [f"{QUICK_CODERS[p]:.2f}" if p in QUICK_CODERS else "" for p in precisions]
    rows = [
        ["bytes / ACL's at its precision of", *(f"{float(p):g} cm" for p in precisions)],
        ["best quick coder with context mixing, Bandai, mean joint error matched", *given],
    ]
    figures, notes = [], []
    for name, section in sections:
        by_precision = {figure["precision"]: figure for figure in section["figures"]}
        for matched, words in MATCHED.items():
            row = []
            for precision in precisions:
                if precision not in by_precision:
                    row.append("")
                    continue
                figures.append(
                    Figure(
                        f"ACL, {SETS[name].title}, {matched} matched, {float(precision):g} cm",
                        by_precision[precision][f"{matched}_ratio"],
                        ACL.get((name, matched), {}).get(precision),
                        _whole(section),
                    )
                )
                row.append(figures[-1].cell)
            rows.append([f"motifold, {of_clips(name, section)}, {words}", *row])
        for figure in section["figures"]:
            told = "; ".join(figure["notes"])
            notes += [f"{SETS[name].title} at {figure['precision']} cm: {told}."] if told else []
    words = (
        "Bytes of the whole archive, store and ledger counted, over ACL's (bind pose as defaults) "
        "on the same clips, at ACL's own error."
    )
    return "\n\n".join([words, markdown_table(rows), _commands(sections), *notes]), figures


def _sz3(results: Results) -> tuple[str, list[Figure]]:
    sections = _sections(results, "sz3")
    if not sections:
        return "", []
    kinds = {"codec": "levers of the codec", "reach": "levers by reach"}
    rows = [["no joint off by more than", "clips", "archive"]]
    for kind in kinds.values():
        rows[0] += [f"SZ3, {kind}", "archive / it"]
    figures = []
    for name, section in sections:
        for entry in section["figures"]:
            tolerance = _length(entry["tolerance"])
            row = [tolerance, of_clips(name, section), f"{entry['archive_bytes']:,}"]
            for kind, label in kinds.items():
                what = f"SZ3 with {label}, {SETS[name].title}, {tolerance}"
                target = SZ3.get((name, entry["tolerance"]))
                figures.append(Figure(what, entry[kind]["ratio"], target, _whole(section)))
                row += [f"{entry[kind]['bytes']:,}", figures[-1].cell]
            rows.append(row)
    words = (
        "One-dimensional, channel after channel of rotation vectors times their joints' levers, "
        "each clip's bound searched to the same largest shell error, decoded and posed to check "
        "it. The codec's levers are for world orientations; by reach they suit SZ3's local "
        "rotations better, which makes it the harder peer."
    )
    return "\n\n".join([words, markdown_table(rows), _commands(sections)]), figures


def _growth(results: Results) -> tuple[str, list[Figure]]:
    sections = _sections(results, "growth")
    if not sections:
        return "", []
    blocks = ["float32 of the varying channels : whole archive, in a small and a large library."]
    figures = []
    for _, section in sections:
        few = f"{section['small']} clips (of {section['draws']} draws)"
        rows = [["no joint off by more than", few, f"{section['large']:,} clips", "growth"]]
        whole = (section["small"], section["large"]) == GROWTH_CLIPS
        for entry in section["figures"]:
            tolerance = _length(entry["tolerance"])
            what, target = f"growth, {tolerance}", GROWTH.get(entry["tolerance"])
            figures.append(Figure(what, entry["growth"], target, whole, at_least=True))
            spread = f"{entry['small_least']:.2f}–{entry['small_most']:.2f}"
            small = f"{entry['small_ratio']:.2f} ({spread})"
            rows.append([tolerance, small, f"{entry['large_ratio']:.2f}", figures[-1].cell])
        blocks.append(markdown_table(rows))
    return "\n\n".join([*blocks, _commands(sections)]), figures


def _text(results: Results) -> tuple[str, list[Figure]]:
    sections = _sections(results, "text")
    if not sections:
        return "", []
    rows = [["clips", "", "bytes", "text : bytes"]]
    for name, section in sections:
        sizes = [
            ("source text", section["text_bytes"]),
            ("zip -9, file by file", section["zip_bytes"]),
            ("xz -9e, file by file", section["xz_bytes"]),
            ("float32 of what varies", section["float32_bytes"]),
        ]
        for entry in section["figures"]:
            sizes.append((f"motifold, {_length(entry['tolerance'])}", entry["archive_bytes"]))
        who = of_clips(name, section)
        for label, size in sizes:
            rows.append([who, label, f"{size:,}", f"{section['text_bytes'] / size:.2f}"])
    words = "zip and xz lose nothing of the text; motifold keeps its tolerance."
    return "\n\n".join([words, markdown_table(rows), _commands(sections)]), []


def _length(centimetres: float) -> str:
    return f"{centimetres * 10:g} mm" if centimetres < 1.0 else f"{centimetres:g} cm"


def panels(results: Results) -> list[Panel]:
    """Return a panel for each set that was compared with ACL: bits per joint and frame."""
    out = []
    for name, section in _sections(results, "acl"):
        bits = 8.0 / section["joint_frames"]
        rings = [
            (figure["acl_joint_mean"] * 10.0, target * figure["acl_bytes"] * bits)
            for figure in section["figures"]
            for precision, target in ACL.get((name, "mean"), {}).items()
            if precision == figure["precision"]
        ]
        curves = [
            Curve("ACL 2.1", "#8250df", _points(section["acl_curve"], bits)),
            *_sz3_curve(results, name, section, bits),
            Curve("motifold, whole archive", "#0969da", _points(section["curve"], bits)),
        ]
        if rings:
            curves.append(Curve("targets", "#cf222e", rings, hollow=True))
        text = results.get(f"text/{name}")
        levels = []
        if text and _same_clips(text, section):
            levels = [("xz of the text, lossless", text["xz_bytes"] * bits)]
        title = of_clips(name, section)
        out.append(Panel(title[0].upper() + title[1:], curves, levels))
    return out


def _points(curve: Sequence[Sequence[float]], bits: float) -> list[tuple[float, float]]:
    """Return (mean joint error in millimetres, bits) of (centimetres, bytes)."""
    return [(mean * 10.0, size * bits) for mean, size in curve]


def _sz3_curve(results: Results, name: str, section: Section, bits: float) -> list[Curve]:
    other = results.get(f"sz3/{name}")
    if not other or not _same_clips(other, section):
        return []
    curve = [(entry["reach"]["joint_mean"], entry["reach"]["bytes"]) for entry in other["figures"]]
    return [Curve("SZ3, one-dimensional", "#bf8700", _points(curve, bits))]


def _same_clips(one: Section, other: Section) -> bool:
    return (one["clips"], one["seed"]) == (other["clips"], other["seed"])
