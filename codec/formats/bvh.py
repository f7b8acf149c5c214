"""Biovision hierarchy (BVH) files.

The format has no standard; this follows Meredith and Maddock, "Motion capture file formats
explained" (2001), and what exporters do. See `channels` for what the numbers mean. No unit of
length is declared in a BVH file: it is given by the caller, or estimated.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import replace

import numpy as np

from ..clip import FloatArray, Layout, Repair, Skeleton, SkeletonClip, UnitSource
from ..errors import FormatError, InputError
from .bvh_hierarchy import (
    LINE_END,
    Hierarchy,
    build_hierarchy,
    depth_first,
    parse_hierarchy,
)
from .channels import POSITIONS, check_size, fold, unfold
from .numerals import LARGEST, cut_short, usable_number
from .units import estimate_unit, parse_units

DEFAULT_FRAME_TIME = 1.0 / 30.0
_SHORTEST_FRAME_TIME = 1e-6  # seconds: below it the text is damage, and rates overflow
_DEFAULT_ROTATIONS = ("Zrotation", "Xrotation", "Yrotation")
_FIELD = re.compile(r"\s*(frame[ \t]*time|frames)[ \t]*:?([^\r\n]*)", re.IGNORECASE | re.ASCII)
_TRAILING_ZEROS = re.compile(r"\.?0+(?=[ \n])")
_WRITTEN_AT_ONCE = 1024  # frames; bounds the memory of the writer


def parse_bvh(data: bytes, source: str = "", units: str | None = None) -> SkeletonClip:
    """Read the bytes of a BVH file.

    ``source`` names the file in messages; ``units`` overrides the estimated length unit. The
    layout's details are ``header`` (the text to the end of the word MOTION, one character per
    byte), ``frame_time`` (as written) and ``newline``.

    Raises FormatError with the line, UnsupportedError for several roots, too many joints or
    rotation channels that are no Euler angles, UsageError for unknown ``units``.
    """
    given = parse_units(units) if units else None
    try:
        return _parse(data, given)
    except InputError as error:
        raise error.within(source) if source else error from None


def _parse(data: bytes, given: tuple[str, float] | None) -> SkeletonClip:
    text = data.decode("latin-1")
    rig = parse_hierarchy(text)
    skeleton = rig.skeleton()
    repairs = _repeated_names(rig.names)
    fields, start = _motion_fields(text, rig.stop)
    frame_time_text = _frame_time(fields.get("frame time"), repairs)
    values = _motion_numbers(data, start, rig, repairs)
    _check_frame_count(fields.get("frames"), len(values), repairs)
    check_size(len(values), skeleton.joints, values.size)
    translations, rotations = unfold(values, rig.channels, skeleton.offsets)
    unit, centimetres, unit_source = _unit(given, skeleton, translations, repairs)
    newline = LINE_END.search(text, rig.stop)
    layout = Layout(
        "bvh",
        unit,
        unit_source,
        centimetres,
        tuple(rig.channels),
        (
            ("header", text[: rig.stop]),
            ("frame_time", frame_time_text),
            ("newline", newline[0] if newline else "\n"),
        ),
    )
    translations *= centimetres
    scaled = replace(
        skeleton,
        offsets=skeleton.offsets * centimetres,
        end_offsets=skeleton.end_offsets * centimetres,
    )
    frame_time = float(frame_time_text)
    return SkeletonClip(scaled, frame_time, rotations, translations, layout, tuple(repairs))


def _repeated_names(names: list[str]) -> list[Repair]:
    return [
        Repair(f"the name stands for {count} joints, told apart by their place", f"joint {name}")
        for name, count in Counter(names).items()
        if count > 1
    ]


def _motion_fields(text: str, position: int) -> tuple[dict[str, str], int]:
    """Return the texts of "frames" and "frame time", and where the numbers start."""
    fields: dict[str, str] = {}
    while found := _FIELD.match(text, position):
        key = "frames" if found[1].lower() == "frames" else "frame time"
        if key in fields:
            break
        fields[key] = found[2].strip()
        position = found.end()
    return fields, position


def _frame_time(text: str | None, repairs: list[Repair]) -> str:
    """Return the frame time as written, in seconds, or the assumed one."""
    seconds = math.nan if text is None else usable_number(text)
    if text is not None and seconds > _SHORTEST_FRAME_TIME:
        return text
    problem = "there is no Frame Time" if text is None else f"Frame Time is {text[:40]!r}"
    repairs.append(Repair(f"{problem}: 1/30 s assumed", "Frame Time"))
    return repr(DEFAULT_FRAME_TIME)


def _check_frame_count(text: str | None, frames: int, repairs: list[Repair]) -> None:
    if text is None:
        repairs.append(Repair(f"there is no Frames line: the file holds {frames}", "Frames"))
    elif text != str(frames) and usable_number(text) != frames:
        repairs.append(Repair(f"Frames is {text[:40]!r}: the file holds {frames}", "Frames"))


def _unit(
    given: tuple[str, float] | None,
    skeleton: Skeleton,
    translations: FloatArray,
    repairs: list[Repair],
) -> tuple[str, float, UnitSource]:
    if given:
        return *given, "given"
    if not skeleton.offsets.any() and len(translations):  # position channels hold the bones
        skeleton = replace(skeleton, offsets=translations[0])
    unit, centimetres, repair = estimate_unit(skeleton)
    repairs.append(repair)
    return unit, centimetres, "estimated"


def _motion_numbers(data: bytes, start: int, rig: Hierarchy, repairs: list[Repair]) -> FloatArray:
    """Return the motion's numbers, (frames, channels); frames are counted, never believed."""
    width = sum(map(len, rig.channels))
    lines = data[start:].splitlines()
    first = 1 + len(LINE_END.findall(data[:start].decode("latin-1")))
    values = _load(lines)
    if values is None or values.shape[1] != width:  # lines of uneven length, or no numbers
        values = _load(_one_line_per_frame(lines, first, width, repairs))
    if values is None or not (np.abs(values) < LARGEST).all():
        raise _unusable_number(lines, first, rig)
    return values.reshape(len(values), width)


def _load(lines: list[bytes]) -> FloatArray | None:
    if not any(line.strip() for line in lines):
        return np.empty((0, 0))
    try:
        return np.loadtxt(lines, comments=None, ndmin=2)
    except ValueError:
        return None


def _one_line_per_frame(
    lines: list[bytes], first: int, width: int, repairs: list[Repair]
) -> list[bytes]:
    """Return the numbers with one frame a line, without an incomplete frame at the end.

    Only for frames that start or end lines: elsewhere a missing number would shift all that
    follows. Raises FormatError at the first line that does not fit.
    """
    counts = np.array([len(line.split()) for line in lines], dtype=np.int64)
    if not counts.any():
        return []
    last = int(np.flatnonzero(counts)[-1])
    if cut_short(lines[last].split()[-1]):
        counts[last] -= 1
    ends = counts.cumsum()
    frames = int(ends[-1]) // width if width else 0
    wrapped = np.isin(np.arange(1, frames + 1) * width, ends).all()
    joined = width > 0 and not (ends % width).any()
    if not width or not (wrapped or joined):
        odd = int(np.flatnonzero((counts != width) & (counts > 0))[0])
        problem = f"{counts[odd]} numbers where the channels need {width}"
        raise FormatError(problem, place=f"line {first + odd}")
    if left := int(ends[-1]) % width:
        what = f"the last frame has {left} of {width} numbers and is left out"
        repairs.append(Repair(what, f"line {first + last}"))
    if not np.isin(counts[:last], (0, width)).all() or counts[last] > width:
        repairs.append(Repair("frames do not stand one on a line: split by the channel count"))
    tokens = b" ".join(lines).split()
    return [b" ".join(tokens[i : i + width]) for i in range(0, frames * width, width)]


def _unusable_number(lines: list[bytes], first: int, rig: Hierarchy) -> FormatError:
    """Return the error that names the first number that is none."""
    columns = [
        f"{rig.names[joint]} {name}" for joint, names in enumerate(rig.channels) for name in names
    ]
    column = 0
    for number, line in enumerate(lines, first):
        for token in line.split():
            if math.isnan(usable_number(token)):
                shown = token[:40].decode("latin-1")
                problem = f"{shown!r} for {columns[column % len(columns)]} is no usable number"
                comma = "Write decimal points, not commas" if b"," in token else None
                return FormatError(problem, place=f"line {number}", advice=comma)
            column += 1
    return FormatError("the motion holds bytes that are no numbers", place=f"line {first}")


def format_bvh(clip: SkeletonClip) -> bytes:
    """Write a clip as a BVH file.

    A clip that was read from a BVH file gets its own header, frame-time text, newlines and
    units back; any other gets a new header in centimetres. Angles are degrees in (-180, 180];
    numbers have up to 6 decimals, lengths more where the unit is large (1e-6 cm).
    """
    own = clip.layout.format == "bvh"
    skeleton, channels = clip.skeleton, clip.layout.channels or _default_channels(clip)
    centimetres = clip.layout.centimetres if own else 1.0
    header, order = clip.layout.detail("header") if own else "", list(range(skeleton.joints))
    if not header:
        header, order = build_hierarchy(skeleton, channels, centimetres), depth_first(skeleton)
        channels = tuple(channels[joint] for joint in order)
    newline = clip.layout.detail("newline", "\n")
    seconds = clip.layout.detail("frame_time")
    if usable_number(seconds) != clip.frame_time:
        seconds = repr(clip.frame_time)
    top = ["", f"Frames: {clip.frames}", f"Frame Time: {seconds}", ""]
    parts = [header.encode("latin-1"), newline.join(top).encode("latin-1")]
    names = [name for names in channels for name in names]
    lengths = np.array([name in POSITIONS for name in names], dtype=bool)
    decimals = np.where(lengths, max(6, 6 + math.ceil(math.log10(centimetres))), 6)
    row = " ".join(f"%.{places}f" for places in decimals) + "\n"
    vanishing = 0.5 * 10.0**-decimals
    for start in range(0, clip.frames, _WRITTEN_AT_ONCE):
        piece = clip.slice(start, start + _WRITTEN_AT_ONCE)
        translations = piece.translations[:, order] / centimetres
        values = fold(translations, piece.rotations[:, order], channels)
        values[~lengths & (values <= vanishing - 180.0)] += 360.0
        values[np.abs(values) <= vanishing] = 0.0  # no "-0"
        text = _TRAILING_ZEROS.sub("", "".join([row % tuple(v) for v in values.tolist()]))
        parts.append(text.replace("\n", newline).encode("ascii"))
    return b"".join(parts)


def _default_channels(clip: SkeletonClip) -> tuple[tuple[str, ...], ...]:
    return tuple(
        _DEFAULT_ROTATIONS if parent >= 0 else (*POSITIONS, *_DEFAULT_ROTATIONS)
        for parent in clip.skeleton.parents
    )
