"""Pages for people: HTML in one file, without anything from elsewhere; pictures are inline SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from ..codec.clip import FloatArray
from .bodysignals import PARTS
from .catalogfolder import Catalog
from .search import Hit, Query
from .vocabulary import NO_WORD, WINDOW, Vocabulary, Words, kind_of

COLOURS = ("#0969da", "#bf3989", "#1a7f37", "#9a6700", "#8250df", "#cf222e")
_STYLE = """
body { font: 15px/1.5 -apple-system, 'Segoe UI', Helvetica, Arial, sans-serif; color: #24292f;
  max-width: 72em; margin: 2em auto; padding: 0 1em }
table { border-collapse: collapse; margin: 1em 0 }
th, td { padding: .3em .8em; border-bottom: 1px solid #e4e8ec; text-align: left }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums }
svg { max-width: 100%; height: auto } .small { color: #57606a; font-size: 13px }
.drawings { display: flex; flex-wrap: wrap; gap: 1em }
"""


def page(title: str, sections: Sequence[tuple[str, str]]) -> str:
    """Return a page; ``sections``: headings (text) and their contents (HTML)."""
    body = "\n".join(
        f"<h2>{escape(heading)}</h2>\n{content}" if heading else content
        for heading, content in sections
    )
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n"
        f"<body>\n<h1>{escape(title)}</h1>\n{body}\n</body>\n</html>\n"
    )


def table(rows: Sequence[Sequence[str]]) -> str:
    """Return a table of texts; the first row is its header."""
    if len(rows) < 2:
        return "<p>None.</p>"

    def line(cells: Sequence[str], tag: str, numeric: Sequence[bool]) -> str:
        return "".join(
            f"<{tag}{' class=number' if number else ''}>{escape(cell)}</{tag}>"
            for cell, number in zip(cells, numeric, strict=True)
        )

    numeric = [cell[:1].isdigit() for cell in rows[1]]
    head = f"<thead><tr>{line(rows[0], 'th', numeric)}</tr></thead>"
    body = "".join(f"<tr>{line(row, 'td', numeric)}</tr>\n" for row in rows[1:])
    return f"<table>{head}<tbody>{body}</tbody></table>"


def chart(curves: Mapping[str, Sequence[tuple[float, float]]], x_title: str, y_title: str) -> str:
    """Return curves of points (x, y), all positive, over logarithmic axes, as SVG."""
    points = [point for curve in curves.values() for point in curve if min(point) > 0]
    if not points:
        return "<p>Nothing to draw.</p>"
    width, height, left, right, top, bottom = 640, 360, 60, 170, 20, 50
    spans = [_ticks(values) for values in zip(*points, strict=True)]

    def at(x: float, y: float) -> tuple[float, float]:
        shares = [
            math.log(value / low) / math.log(high / low)
            for value, (low, high, _) in zip((x, y), spans, strict=True)
        ]
        return (
            left + shares[0] * (width - left - right),
            height - bottom - shares[1] * (height - top - bottom),
        )

    out = [f'<svg viewBox="0 0 {width} {height}" width="{width}" font-size="12" fill="#24292f">']
    (x_low, x_high, x_ticks), (y_low, y_high, y_ticks) = spans
    for tick in x_ticks:
        (x, y), (_, up) = at(tick, y_low), at(tick, y_high)
        out.append(f'<path d="M{x:.1f} {y:.1f}V{up:.1f}" stroke="#e4e8ec"/>')
        out.append(f'<text x="{x:.1f}" y="{y + 16:.1f}" text-anchor="middle">{tick:g}</text>')
    for tick in y_ticks:
        (x, y), (far, _) = at(x_low, tick), at(x_high, tick)
        out.append(f'<path d="M{x:.1f} {y:.1f}H{far:.1f}" stroke="#e4e8ec"/>')
        out.append(f'<text x="{x - 6:.1f}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>')
    for number, (name, curve) in enumerate(curves.items()):
        colour = COLOURS[number % len(COLOURS)]
        places = [at(*point) for point in sorted(curve) if min(point) > 0]
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        out.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        out += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>' for x, y in places]
        x, y = width - right + 14, top + 12 + 18 * number
        out.append(f'<circle cx="{x}" cy="{y}" r="4" fill="{colour}"/>')
        out.append(f'<text x="{x + 10}" y="{y + 4}">{escape(name)}</text>')
    middle = (left + width - right) / 2
    out.append(
        f'<text x="{middle}" y="{height - 12}" text-anchor="middle">{escape(x_title)}</text>'
    )
    turn = f"rotate(-90 16 {height / 2})"
    out.append(
        f'<text x="16" y="{height / 2}" text-anchor="middle" transform="{turn}">'
        f"{escape(y_title)}</text></svg>"
    )
    return "\n".join(out)


def word_drawing(vocabulary: Vocabulary, part: str, word: int) -> str:
    """Return a small drawing of a movement: the path of the part's end, from the side.

    A filled dot is where it ends. Of the root: its velocity from moment to moment.
    """
    path = movement_path(vocabulary, part, word)
    size = float(np.abs(path).max()) or 1.0
    places = [(32 + 28 * x / size, 32 - 28 * y / size) for x, y in path.tolist()]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    x, y = places[-1]
    return (
        '<svg viewBox="0 0 64 64" width="64" height="64">'
        '<path d="M32 4V60M4 32H60" stroke="#e4e8ec"/>'
        f'<polyline points="{line}" fill="none" stroke="{COLOURS[0]}" stroke-width="2"/>'
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{COLOURS[0]}"/></svg>'
    )


def movement_path(vocabulary: Vocabulary, part: str, word: int) -> FloatArray:
    """Return (window, 2) how far forwards and up a part's end is in the window of a word."""
    features = vocabulary.centres[kind_of(part)][word]
    channels = len(features) // (WINDOW + 1)
    moves = features[channels:].reshape(WINDOW, channels)
    first = 0 if part == "root" else channels - 3
    return np.asarray(moves[:, [first + 2, first + 1]])


def search_page(catalog: Catalog, query: Query, text: str, hits: Sequence[Hit]) -> str:
    """Return a page that shows hits, with the words of the query and of each hit in colour."""
    rows = [["clip", "from", "to", "score", *(hits[0].parts if hits else ())]]
    for hit in hits:
        likeness = [f"{100 * value:.0f} %" for value in hit.parts.values()]
        span = f"{hit.start:.2f} s", f"{hit.stop:.2f} s"
        rows.append([hit.clip, *span, f"{hit.score:.3f}", *likeness])
    strips = [_strip("query", query.words)]
    for hit in hits:
        words = catalog.words(catalog.numbers[hit.clip])
        strips.append(_strip(hit.clip, words[round(hit.start * 10) : round(hit.stop * 10) + 1]))
    note = (
        '<p class="small">A row is a body part ('
        + escape(", ".join(PARTS))
        + "), a column a tenth of a second, a colour a pattern of movement.</p>"
    )
    return page(
        f"Motion like {text}", [("Hits", table(rows)), ("Patterns", note + "".join(strips))]
    )


def _strip(title: str, words: Words) -> str:
    cells = []
    for column in range(len(PARTS)):
        for sample, word in enumerate(words[:, column].tolist()):
            if word != NO_WORD:
                hue, light = (word * 47) % 360, 45 + (word * 13) % 30
                cells.append(
                    f'<rect x="{8 * sample}" y="{8 * column}" width="8" height="8" '
                    f'fill="hsl({hue},60%,{light}%)"/>'
                )
    wide = 8 * max(len(words), 1)
    picture = f'<svg viewBox="0 0 {wide} 56" width="{wide}" height="56">{"".join(cells)}</svg>'
    return f"<p>{escape(title)}<br>{picture}</p>"


def _ticks(values: Sequence[float]) -> tuple[float, float, list[float]]:
    """Return the range of a logarithmic axis, and round values on it."""
    low, high = min(values) / 1.2, max(values) * 1.2
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for digits in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 4, 5, 7)):
        ticks = [digit * 10.0**decade for decade in decades for digit in digits]
        ticks = [tick for tick in ticks if low <= tick <= high]
        if len(ticks) >= 4:
            break
    return low, high, ticks
