"""Quantities as people write and read them: lengths, sizes, durations."""

from __future__ import annotations

import math
import re

from ..codec.errors import UsageError

_CENTIMETRES = {"mm": 0.1, "cm": 1.0, "m": 100.0, "um": 1e-4, "in": 2.54}
_SPAN = re.compile(r"\s*([0-9]*\.?[0-9]+)\s*s\s*-\s*([0-9]*\.?[0-9]+)\s*s\s*")
_SECONDS = re.compile(r"\s*([0-9]*\.?[0-9]+)\s*s?\s*")
_LENGTH = re.compile(r"\s*([0-9]*\.?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*([a-zA-Z]+)\s*")


def parse_length(text: str) -> float:
    """Return a length such as ``1mm``, ``0.5 cm`` or ``2in`` in centimetres.

    Raises `UsageError`; a number without a unit is one, because a guess would be silent.
    """
    found = _LENGTH.fullmatch(text)
    if not found or found[2].lower() not in _CENTIMETRES:
        raise UsageError(
            f"{text!r} is not a length",
            advice=f"Write a number and a unit ({', '.join(_CENTIMETRES)}), such as 1mm",
        )
    return float(found[1]) * _CENTIMETRES[found[2].lower()]


def parse_bound(text: str) -> tuple[str, float]:
    """Return (name, centimetres) of a bound such as ``LeftFoot=0.2mm``. Raises `UsageError`."""
    name, found, length = text.rpartition("=")
    if not found or not name.strip():
        raise UsageError(f"{text!r} is no bound", advice="Write it as LeftFoot=0.2mm")
    return name.strip(), parse_length(length)


def parse_weight(text: str) -> tuple[str, float]:
    """Return (name, weight) of a weight such as ``LeftFoot=5``. Raises `UsageError`."""
    name, found, number = text.rpartition("=")
    advice = "Write it as LeftFoot=5, or LeftFoot=0.5 for less"
    try:
        weight = float(number)
    except ValueError:
        weight = 0.0
    if not found or not name.strip() or not 0.0 < weight < math.inf:
        raise UsageError(f"{text!r} is no weight", advice=advice)
    return name.strip(), weight


def parse_span_bound(text: str) -> tuple[float, float, float]:
    """Return (from second, to second, centimetres) of a bound such as ``2s-3.5s=0.2mm``.

    Raises `UsageError`.
    """
    span, length = parse_bound(text)
    found = _SPAN.fullmatch(span)
    if not found or float(found[1]) > float(found[2]):
        raise UsageError(f"{span!r} is no time span", advice="Write it as 2s-3.5s=0.2mm")
    return float(found[1]), float(found[2]), length


def parse_seconds(text: str) -> float:
    """Return a time such as ``2.5s`` or ``2.5`` in seconds. Raises `UsageError`."""
    found = _SECONDS.fullmatch(text)
    if not found:
        raise UsageError(f"{text!r} is no time", advice="Write seconds, such as 2.5s")
    return float(found[1])


def parse_counts(text: str) -> list[int]:
    """Return counts such as ``10,30,100``. Raises `UsageError`."""
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise UsageError(f"{text!r} are no counts", advice="Write them as 10,30,100") from None


def show_length(centimetres: float) -> str:
    """Return a length for people, in millimetres below 10 cm."""
    if centimetres < 10.0:
        return f"{centimetres * 10:.4g} mm"
    return f"{centimetres:.4g} cm"


def show_bytes(count: int) -> str:
    """Return a size for people, in decimal units."""
    if count < 1000:
        return f"{count} B"
    size = float(count)
    for unit in ("kB", "MB", "GB"):
        size /= 1000.0
        if size < 999.5:  # what three digits can hold
            return f"{size:.3g} {unit}"
    size /= 1000.0
    return f"{size:.3g} TB" if size < 999.5 else f"{size:,.0f} TB"


def show_duration(seconds: float) -> str:
    """Return a duration for people."""
    if seconds < 120.0:
        return f"{seconds:.3g} s"
    if seconds < 7200.0:
        return f"{seconds / 60:.3g} min"
    hours = seconds / 3600
    return f"{hours:.3g} h" if hours < 999.5 else f"{hours:,.0f} h"


def show_ratio(before: int, after: int) -> str:
    """Return how many times smaller ``after`` bytes are than ``before``."""
    return f"{before / after:.2f}" if after else "-"
