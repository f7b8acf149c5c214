"""Rate-distortion curves as a small SVG file: both axes logarithmic, one panel a set."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape

Points = Sequence[tuple[float, float]]

WIDTH, HEIGHT = 440, 350  # of a panel, pixels
LEFT, RIGHT, TOP, BOTTOM = 58, 14, 40, 48
INK, FAINT, GRID = "#24292f", "#57606a", "#e4e8ec"
STYLE = "font-family: -apple-system, 'Segoe UI', Helvetica, Arial, sans-serif"


@dataclass(frozen=True)
class Curve:
    """A line through ``points`` (x, y), or with ``hollow`` only a ring at each."""

    label: str
    colour: str
    points: Points
    hollow: bool = False


@dataclass(frozen=True)
class Panel:
    """One diagram; ``levels`` are (label, y) of dashed horizontal lines."""

    title: str
    curves: Sequence[Curve]
    levels: Sequence[tuple[str, float]] = field(default_factory=tuple)


@dataclass(frozen=True)
class Axis:
    """A logarithmic axis from ``low`` to ``high``, drawn from pixel ``start`` to ``stop``."""

    low: float
    high: float
    start: float
    stop: float

    def at(self, value: float) -> float:
        """Return the pixel of a value."""
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return self.start + share * (self.stop - self.start)

    def ticks(self) -> list[float]:
        """Return round values on the axis: powers of ten, with 2 and 5 where these are few."""
        decades = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        for digits in ((1,), (1, 2, 5)):
            values = [digit * 10.0**decade for decade in decades for digit in digits]
            shown = [v for v in values if self.low * 0.999 <= v <= self.high * 1.001]
            if len(shown) >= 4:
                break
        return shown


def draw(panels: Sequence[Panel], x_title: str, y_title: str) -> str:
    """Return the SVG text of panels side by side, all with the same axes.

    Raises ValueError where there is no point, or one that is not positive.
    """
    points = [point for panel in panels for curve in panel.curves for point in curve.points]
    if not points or any(not 0 < value < math.inf for point in points for value in point):
        raise ValueError("a logarithmic picture needs points, and all of them positive")
    heights = [y for _, y in points] + [y for panel in panels for _, y in panel.levels]
    x_range = _widened([x for x, _ in points])
    y_range = _widened(heights)
    width = WIDTH * len(panels)
    body = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {HEIGHT}" '
        f'width="{width}" height="{HEIGHT}" style="{STYLE}" font-size="12" fill="{INK}">',
        f'<rect width="{width}" height="{HEIGHT}" rx="6" fill="#ffffff"/>',
    ]
    for number, panel in enumerate(panels):
        left = number * WIDTH
        x = Axis(*x_range, left + LEFT, left + WIDTH - RIGHT)
        y = Axis(*y_range, HEIGHT - BOTTOM, TOP)
        body += _frame(panel, x, y, x_title, y_title if number == 0 else "")
        body += _legend(panel.curves, x, y)
        for label, level in panel.levels:
            body += _level(label, level, x, y)
        for curve in panel.curves:
            body += _curve(curve, x, y)
    return "\n".join([*body, "</svg>"]) + "\n"


def _widened(values: Sequence[float]) -> tuple[float, float]:
    return min(values) / 1.35, max(values) * 1.35


def _frame(panel: Panel, x: Axis, y: Axis, x_title: str, y_title: str) -> list[str]:
    out = []
    for value in x.ticks():
        out += [_line(x.at(value), y.start, x.at(value), y.stop, GRID)]
        out += [_text(x.at(value), y.start + 17, f"{value:g}", FAINT, "middle")]
    for value in y.ticks():
        out += [_line(x.start, y.at(value), x.stop, y.at(value), GRID)]
        out += [_text(x.start - 7, y.at(value) + 4, f"{value:g}", FAINT, "end")]
    middle = (x.start + x.stop) / 2
    out += [_line(x.start, y.start, x.stop, y.start, FAINT)]
    out += [_line(x.start, y.start, x.start, y.stop, FAINT)]
    out += [_text(x.start, y.stop - 14, panel.title, INK, "start", 'font-weight="600"')]
    out += [_text(middle, y.start + 37, x_title, INK, "middle")]
    if y_title:
        place = x.start - 40, (y.start + y.stop) / 2
        turn = f'transform="rotate(-90 {place[0]:.1f} {place[1]:.1f})"'
        out += [_text(*place, y_title, INK, "middle", turn)]
    return out


def _level(label: str, level: float, x: Axis, y: Axis) -> list[str]:
    dashed = 'stroke-dasharray="5 4"'
    return [
        _line(x.start, y.at(level), x.stop, y.at(level), FAINT, dashed),
        _text(x.start + 6, y.at(level) - 5, label, FAINT, "start", 'font-size="11"'),
    ]


def _curve(curve: Curve, x: Axis, y: Axis) -> list[str]:
    places = [(x.at(a), y.at(b)) for a, b in sorted(curve.points)]
    if curve.hollow:
        return [_ring(*place, curve.colour) for place in places]
    path = " ".join(f"{a:.1f},{b:.1f}" for a, b in places)
    line = f'<polyline points="{path}" fill="none" stroke="{curve.colour}" stroke-width="2"/>'
    return [line, *(_dot(*place, curve.colour) for place in places)]


def _legend(curves: Sequence[Curve], x: Axis, y: Axis) -> list[str]:
    """Bottom left, where curves that fall leave room."""
    left, top = x.start + 10, y.start - 10 - 18 * len(curves)
    width = 36 + 6.3 * max(len(curve.label) for curve in curves)
    out = [
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" '
        f'height="{18 * len(curves) + 4}" rx="4" fill="#ffffff"/>'
    ]
    for number, curve in enumerate(curves):
        height = top + 12 + 18 * number
        if curve.hollow:
            out += [_ring(left + 13, height, curve.colour)]
        else:
            wide = 'stroke-width="2"'
            out += [_line(left + 4, height, left + 22, height, curve.colour, wide)]
            out += [_dot(left + 13, height, curve.colour)]
        out += [_text(left + 30, height + 4, curve.label, INK, "start")]
    return out


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, more: str = "") -> str:
    place = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {place} stroke="{colour}" {more}/>'


def _text(x: float, y: float, words: str, colour: str, anchor: str, more: str = "") -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
    return f'<text {place} fill="{colour}" {more}>{escape(words)}</text>'


def _dot(x: float, y: float, colour: str) -> str:
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>'


def _ring(x: float, y: float, colour: str) -> str:
    circle = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="#ffffff"'
    return f'{circle} stroke="{colour}" stroke-width="1.8"/>'
