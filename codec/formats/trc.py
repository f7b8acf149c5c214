"""TRC, the tab-separated marker format of Motion Analysis and OpenSim.

Layout as in OpenSim's user guide, "Marker (.trc) Files": a ``PathFileType`` line, a line of
header names and one of their values, a line of marker names (one for three columns), a line
of axis names (``X1 Y1 Z1`` …), a blank line, then one row per frame.
"""

from __future__ import annotations

import math
import re
from array import array
from typing import TypeAlias

import numpy as np

from ..clip import FloatArray, Layout, MarkerClip, Repair, UnitSource
from ..errors import FormatError, InputError, UsageError
from .units import parse_units

Header: TypeAlias = dict[str, str]

FARTHEST = 1e7  # centimetres (100 km): what lies beyond is a damaged number, not a marker
ASSUMED_RATE = 100.0  # frames per second
_FIELDS = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame "
_NUMBER = re.compile(rb"\s*([-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?|nan)?\s*", re.IGNORECASE)
_AXES = re.compile(rb"\s*X\d*(\s|$)", re.IGNORECASE)


def parse_trc(data: bytes, source: str = "", units: str | None = None) -> MarkerClip:
    """Return the clip in a TRC file's bytes; positions in centimetres, gaps as NaN.

    ``source`` names the file in messages; ``units`` overrides the file's own unit. Empty and
    ``NaN`` cells are gaps, and so is a marker of which only some coordinates are there. The
    path in the first line and the facts about the untrimmed take are not kept.

    Raises FormatError (with the line) for what is not a TRC file, for garbage cells and for
    positions beyond 100 km; UsageError if ``units`` is unknown.
    """
    try:
        return _parse(data, units)
    except InputError as error:
        raise (error.within(source) if source else error) from error.__cause__


def format_trc(clip: MarkerClip) -> bytes:
    """Return the bytes of a TRC file of ``clip``, in the unit and newlines of its layout.

    Numbers are rounded to 1e-6 cm (or finer), gaps become empty cells. Takes clips that were
    read from C3D files as well. Raises UsageError for a marker name with a tab or line break.
    """
    if re.search(r"[\t\r\n]", " ".join(clip.names)):
        raise UsageError("a marker name with a tab or line break does not fit into a TRC file")
    (frames, markers), layout = clip.positions.shape[:2], clip.layout
    rate = f"{1.0 / clip.frame_time:.12g}"
    first = int(layout.detail("first_frame", "1"))
    start = float(layout.detail("start_time", repr((first - 1) * clip.frame_time)))
    camera, original = layout.detail("CameraRate", rate), layout.detail("OrigDataRate", rate)
    values = rate, camera, frames, markers, layout.unit, original, first, frames
    top = [
        "PathFileType\t4\t(X/Y/Z)\tmotion.trc",
        _FIELDS.replace(" ", "\t") + "OrigNumFrames",
        "\t".join(map(str, values)),
        "Frame#\tTime\t" + "\t\t\t".join(clip.names) + "\t\t",
        "\t" + "".join(f"\tX{marker}\tY{marker}\tZ{marker}" for marker in range(1, markers + 1)),
        "",
    ]
    places = max(0, math.ceil(math.log10(layout.centimetres / 1e-6)))
    pattern = "%d\t%.6f" + f"\t%.{places}f" * (3 * markers)
    numbers = np.where(clip.seen[:, :, None], clip.positions, np.nan) / layout.centimetres
    body = "\n".join(
        pattern % (first + frame, start + frame * clip.frame_time, *row)
        for frame, row in enumerate(numbers.reshape(frames, 3 * markers).tolist())
    ).replace("nan", "")
    text = "\n".join([*top, body, ""] if frames else [*top, ""])
    return text.replace("\n", "\r\n" if layout.detail("newline") == "crlf" else "\n").encode()


def _parse(data: bytes, units: str | None) -> MarkerClip:
    repairs: list[Repair] = []
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    lines = text.split(b"\n")
    if not lines[0].lstrip().startswith(b"PathFileType") or len(lines) < 4:
        raise _error("not a TRC file: no PathFileType, or cut off in the header", len(lines[:4]))
    header = dict(zip(_words(lines[1]), _words(lines[2]), strict=False))
    unit = marker_unit(header.get("Units", ""), units, "line 3", repairs)
    names = _names(lines[3], repairs)
    first = 5 if len(lines) > 4 and _AXES.match(lines[4]) else 4
    rows = [number for number in range(first, len(lines)) if lines[number].strip()]
    cells = _without_empty_names(header, names, _cells(lines, rows, names, repairs), repairs)
    positions = _positions(cells, unit[1], rows, repairs)
    for key, count in (("NumMarkers", len(names)), ("NumFrames", len(rows))):
        if key in header and header[key] != str(count):
            what = f"{key} is {header[key][:40]!r}, but there are {count}; all are kept"
            repairs.append(Repair(what, "line 3"))
    frame_time, details = _timing(header, cells, lines, rows, repairs)
    if b"\r\n" in data:
        details.append(("newline", "crlf"))
    layout = Layout("trc", unit[0], unit[2], unit[1], details=tuple(details))
    return MarkerClip(tuple(names), frame_time, positions, layout, tuple(repairs))


def _error(problem: str, line: int, advice: str = "Restore the file from a copy") -> FormatError:
    return FormatError(problem, place=f"line {line}", advice=advice)


def _words(line: bytes) -> list[str]:
    try:
        text = line.decode()
    except UnicodeDecodeError:
        text = line.decode("latin-1")
    return [word.strip() for word in text.split("\t")]


def marker_unit(
    declared: str, given: str | None, place: str, repairs: list[Repair]
) -> tuple[str, float, UnitSource]:
    """Return a marker file's unit, centimetres per unit, and how it is known.

    ``declared`` is the file's own text at ``place``, ``given`` the caller's, which wins; without
    either, millimetres are assumed and a repair says so. Raises FormatError if the declared unit
    is unknown, UsageError if the given one is.
    """
    if given is not None:
        return *parse_units(given), "given"
    if not declared:
        repairs.append(Repair("the file names no unit; millimetres are assumed", place))
        return "mm", 0.1, "estimated"
    try:
        return *parse_units(declared), "declared"
    except UsageError as error:
        raise FormatError(f"unknown unit {declared[:40]!r}", place=place) from error


def _names(line: bytes, repairs: list[Repair]) -> list[str]:
    words = _words(line)
    if not words[0].lower().startswith("frame"):
        raise _error("expected the line of marker names, starting with Frame#", 4)
    words = words[2:]
    while words and not words[-1]:
        words.pop()
    if any(word for place, word in enumerate(words) if place % 3):
        repairs.append(Repair("marker names are not three columns apart", "line 4"))
        return [word for word in words if word]
    names = words[::3]
    if not names:
        raise _error("no marker names", 4)
    _name_the_nameless(names, repairs)
    return names


def _name_the_nameless(names: list[str], repairs: list[Repair]) -> None:
    if not all(names):
        what = f"{names.count('')} markers without a name are called M and a number"
        repairs.append(Repair(what, "line 4"))
    names[:] = [name or f"M{number:03d}" for number, name in enumerate(names, 1)]


def _cells(
    lines: list[bytes], rows: list[int], names: list[str], repairs: list[Repair]
) -> FloatArray:
    """Return the numbers (rows, 2 + 3 markers), NaN where blank.

    Appends to ``names`` where every row holds more markers than were named, and takes the last
    of ``rows`` away if it is cut off before its first marker's end.
    """
    ends = [lines[row].rstrip(b"\t \r").count(b"\t") + 1 for row in rows]
    width = 2 + 3 * len(names)
    if ends and min(ends) == max(ends) > width and (ends[0] - 2) % 3 == 0:
        names += [""] * ((ends[0] - width) // 3)
        width = ends[0]
        _name_the_nameless(names, repairs)
    for row, end in zip(rows, ends, strict=True):
        if b"_" in lines[row]:  # float() takes it for a separator of thousands
            raise _error("an underscore among the numbers", row + 1)
        if end > width:
            raise _error(f"{end} cells where the names leave room for {width}", row + 1)
    # Rows may leave out trailing gaps, but memory must stay in proportion to the file.
    if len(rows) * width > 1_000_000 + 8 * sum(map(len, lines)):
        raise _error("rows are far shorter than the line of marker names", rows[0] + 1)

    numbers = array("d")
    unfinished = rows[-1] if rows and rows[-1] == len(lines) - 1 else -1
    for row in rows:
        cells = lines[row].split(b"\t")[:width]
        if row == unfinished and (len(cells) < width or not _NUMBER.fullmatch(cells[-1])):
            cells = cells[: 2 + (len(cells) - 3) // 3 * 3]  # the markers before the cut one
            what = "the last line is cut off; what is missing is left out"
            repairs.append(Repair(what, f"line {row + 1}"))
            if len(cells) < 5:
                rows.pop()
                break
        try:
            values = [float(cell) if cell else math.nan for cell in cells]
        except ValueError:
            values = [_number(cell, column, row) for column, cell in enumerate(cells)]
        numbers.extend(values + [math.nan] * (width - len(values)))
    return np.array(numbers, dtype=np.float64).reshape(len(rows), width)


def _number(cell: bytes, column: int, row: int) -> float:
    if not _NUMBER.fullmatch(cell):
        problem = f"column {column + 1} is no number: {cell[:40]!r}"
        raise _error(problem, row + 1, "Mend it, or empty it for a gap")
    return float(cell.strip() or math.nan)


def _positions(
    cells: FloatArray, centimetres: float, rows: list[int], repairs: list[Repair]
) -> FloatArray:
    """Return (rows, markers, 3) centimetres; impossible ones are refused, halves become gaps."""
    wrong = np.isinf(cells)
    wrong[:, 2:] |= np.abs(cells[:, 2:]) > FARTHEST / centimetres
    if np.any(wrong):
        frame, column = np.argwhere(wrong)[0]
        raise _error(f"column {column + 1} is infinite or beyond 100 km", rows[frame] + 1)
    positions = cells[:, 2:].reshape(len(rows), cells.shape[1] // 3, 3) * centimetres
    blank = np.isnan(positions)
    partial = np.any(blank, axis=2) & ~np.all(blank, axis=2)
    if partial.any():
        line = rows[int(np.flatnonzero(np.any(partial, axis=1))[0])] + 1
        what = f"{partial.sum()} positions with a coordinate missing became gaps"
        repairs.append(Repair(what, f"line {line}"))
        positions[partial] = np.nan
    return positions


def _without_empty_names(
    header: Header, names: list[str], cells: FloatArray, repairs: list[Repair]
) -> FloatArray:
    """Leave out names beyond NumMarkers without any position (Cortex's virtual markers)."""
    claim = header.get("NumMarkers", "")
    markers = int(claim) if claim.isdecimal() and len(claim) < 9 else 0
    width = 2 + 3 * markers
    if not (0 < markers < len(names) and len(cells) and np.isnan(cells[:, width:]).all()):
        return cells
    empty = len(names) - markers
    repairs.append(Repair(f"{empty} names beyond NumMarkers hold no data; left out", "line 4"))
    del names[markers:]
    return cells[:, :width]


def _timing(
    header: Header, cells: FloatArray, lines: list[bytes], rows: list[int], repairs: list[Repair]
) -> tuple[float, list[tuple[str, str]]]:
    """Return the frame time in seconds, and the details that the writer needs for times."""
    times, numbers = cells[:, 1], cells[:, 0]
    details = []
    rate = _rate(header, "DataRate") or _rate_of_times(times, repairs)
    frame_time = 1.0 / rate
    for key in ("CameraRate", "OrigDataRate"):
        other = f"{_rate(header, key) or rate:.12g}"
        if other != f"{rate:.12g}":
            details.append((key, other))
    if not rows:
        return frame_time, details

    first = int(numbers[0]) if 0 <= numbers[0] < 1e9 and numbers[0] % 1 == 0 else 1
    if first != 1:
        details.append(("first_frame", str(first)))
    odd = np.flatnonzero(numbers != first + np.arange(len(rows)))
    if len(odd):
        repairs.append(Repair("frame numbers do not count up by one", f"line {rows[odd[0]] + 1}"))
    # Times are printed with few decimals: allow for the rounding and a tenth of a frame.
    printed = (cell for row in rows for cell in lines[row].split(b"\t", 2)[1:2])
    decimals = max((len(cell.strip().partition(b".")[2]) for cell in printed), default=0)
    slack = 0.5 * 10.0 ** -min(decimals, 9) + 0.1 * frame_time
    start = float(times[0]) if abs(times[0]) < 1e12 else 0.0
    if abs(start - (first - 1) * frame_time) > slack:
        details.append(("start_time", f"{start:.6f}"))
    off = np.abs(times - start - np.arange(len(rows)) * frame_time)
    odd = np.flatnonzero(~(off <= slack))
    if len(odd):
        what = f"times do not follow the rate of {rate:g} frames per second; the rate is kept"
        repairs.append(Repair(what, f"line {rows[odd[0]] + 1}"))
    return frame_time, details


def _rate(header: Header, key: str) -> float | None:
    try:
        rate = float(header.get(key, ""))
    except ValueError:
        return None
    return rate if 1e-3 <= rate <= 1e6 else None


def _rate_of_times(times: FloatArray, repairs: list[Repair]) -> float:
    known = np.flatnonzero(np.abs(times) < 1e12)
    if len(known) > 1:
        span = float(times[known[-1]] - times[known[0]])
        rate = float(f"{(known[-1] - known[0]) / span:.6g}") if span > 0 else 0.0
        if 1e-3 <= rate <= 1e6:
            repairs.append(
                Repair(f"no DataRate; {rate:g} frames per second from the time column", "line 3")
            )
            return rate
    repairs.append(
        Repair(f"no DataRate and no times; {ASSUMED_RATE:g} frames per second assumed", "line 3")
    )
    return ASSUMED_RATE
