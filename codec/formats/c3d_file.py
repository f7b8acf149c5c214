"""C3D, the binary marker format of biomechanics (The C3D File Format User Guide, c3d.org).

The ``c3d`` library reads the header and the parameters, in the guide's three byte formats
(Intel, DEC, MIPS). The frames are read here, in one step: the library stops silently where a
file is cut off, and refuses files over analog scales that are of no concern here. A C3D clip is
restored as TRC, which `format_trc` writes.
"""

from __future__ import annotations

import io
import math
import re
import struct
import threading
import warnings
from typing import Any, TypeAlias

import numpy as np

from ..clip import FloatArray, Layout, MarkerClip, Repair
from ..errors import FormatError, InputError, UnsupportedError
from .trc import FARTHEST, marker_unit

Parameters: TypeAlias = dict[str, tuple[list[int], bytes]]  # name: (dimensions, bytes)

# What the library raises on bytes that are not what they claim: it checks by assertion, and
# otherwise trusts sizes, indices and types.
_LIBRARY_ERRORS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    NameError,
    TypeError,
    ValueError,
    struct.error,
)
_NOT_POSITIONS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS")
_ADVICE = "Restore the file from a copy"
_warnings_lock = threading.Lock()  # warnings.catch_warnings is not safe between threads


def parse_c3d(data: bytes, source: str = "", units: str | None = None) -> MarkerClip:
    """Return the clip of the points in a C3D file's bytes; positions in centimetres, gaps NaN.

    ``source`` names the file in messages; ``units`` overrides ``POINT:UNITS``. A point is a gap
    where its residual is negative or a coordinate is NaN. Points that Vicon's ``POINT:ANGLES``,
    ``FORCES`` … lists name are no positions and are left out, like analog channels, residuals
    and all other parameters; repairs say so. Frames that the header claims and the file does not
    hold are not made up.

    Raises FormatError for damaged files, UnsupportedError if no point is a position, and
    UsageError if ``units`` is unknown.
    """
    try:
        return _parse(data, units)
    except InputError as error:
        raise (error.within(source) if source else error) from error.__cause__


def _parse(data: bytes, units: str | None) -> MarkerClip:
    repairs: list[Repair] = []
    with _warnings_lock, warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            reader = _lenient_reader(data)
            point = _parameters(reader, "POINT")
            rate, scale = np.float32(reader.point_rate), float(reader.point_scale)
            points = int(reader.point_used)
            first, claimed = _frame_range(reader)
            groups = sorted(str(group.name) for group in reader.group_values())
        except _LIBRARY_ERRORS as error:
            reason = str(error)[:200] or type(error).__name__
            problem = f"not a readable C3D file (the c3d library says: {reason})"
            raise FormatError(problem, place="header and parameters", advice=_ADVICE) from error

    _check_header(reader.header, points, float(rate), scale, repairs)
    names = _names(point, points, repairs)
    kept = _positional(point, names, repairs)
    declared = _text(point["UNITS"][1]) if "UNITS" in point else ""
    unit, centimetres, unit_source = marker_unit(declared, units, "POINT:UNITS", repairs)
    frames = _frames(data, reader, points, claimed, repairs)
    positions = _positions(frames[:, kept], 1.0 if scale < 0 else scale) * centimetres
    far = np.abs(positions) > FARTHEST
    if np.any(far):
        frame, marker, _ = np.argwhere(far)[0]
        place = f"frame {first + frame}, marker {names[kept[marker]]}"
        raise FormatError("infinite or beyond 100 km", place=place, advice=_ADVICE)

    channels = reader.header.analog_count // max(1, reader.header.analog_per_frame)
    others = ", ".join(name for name in groups if name not in ("POINT", "TRIAL", "ANALOG"))
    what = f"{channels} analog channels, residuals" if channels else "residuals"
    repairs.append(Repair(f"{what} and other groups ({others or 'none'}) are not kept"))
    return MarkerClip(
        tuple(names[marker] for marker in kept),
        1.0 / float(str(rate)),  # the shortest decimal that stands for the 32-bit rate
        positions,
        Layout(
            "c3d",
            unit,
            unit_source,
            centimetres,
            details=(("first_frame", str(first)),) if first != 1 else (),
        ),
        tuple(repairs),
    )


def _lenient_reader(data: bytes) -> Any:
    """Return the library's reader, without its refusal of small contradictions.

    It refuses, for example, a header whose rate differs from POINT:RATE in the last digit;
    `_check_header` sees to the contradictions that matter.
    """
    import c3d

    lenient = type("LenientReader", (c3d.Reader,), {"_check_metadata": lambda self: None})
    return lenient(io.BytesIO(data))


def _parameters(reader: Any, group: str) -> Parameters:
    found = reader.get(group)
    if found is None:
        return {}
    return {name: (each.dimensions, bytes(each.bytes)) for name, each in found.param_items()}


def _frame_range(reader: Any) -> tuple[int, int]:
    """Return the first frame's number and the number of frames that the file claims.

    Frame numbers beyond the header's 16 bits are in TRIAL:ACTUAL_START_FIELD and
    ACTUAL_END_FIELD, each two 16-bit words, low word first; some files have only their number,
    as a float, in POINT:LONG_FRAMES.
    """
    first, last = reader.header.first_frame, reader.header.last_frame
    if last == 65535:
        words = "<HH" if reader.proc_type != "MIPS" else ">HH"
        trial, long = _parameters(reader, "TRIAL"), reader.get("POINT:LONG_FRAMES")
        if "ACTUAL_START_FIELD" in trial and "ACTUAL_END_FIELD" in trial:
            low, high = struct.unpack_from(words, trial["ACTUAL_START_FIELD"][1])
            first = low + 65536 * high
            low, high = struct.unpack_from(words, trial["ACTUAL_END_FIELD"][1])
            last = low + 65536 * high
        elif long is not None:
            last = first + int(long.float_value) - 1
    return first, max(0, last - first + 1)


def _check_header(
    header: Any, points: int, rate: float, scale: float, repairs: list[Repair]
) -> None:
    problem = ""
    if header.point_count != points:
        problem = f"the header counts {header.point_count} points, POINT:USED {points}"
    elif not 1e-3 <= rate <= 1e6:
        problem = f"POINT:RATE is {rate:g} frames per second"
    elif not 0 < abs(scale) < 1e30:
        problem = f"POINT:SCALE is {scale:g}"
    elif header.data_block < 2:
        problem = f"the frames cannot start at block {header.data_block}"
    if problem:
        raise FormatError(problem, place="header and parameters", advice=_ADVICE)
    pairs = (("RATE", header.frame_rate, rate), ("SCALE", header.scale_factor, scale))
    for name, claim, value in pairs:
        if not math.isclose(claim, value, rel_tol=1e-6):
            what = f"the header says {claim:g}, POINT:{name} {value:g}; the latter is used"
            repairs.append(Repair(what, "header"))


def _labels(point: Parameters, base: str) -> list[str]:
    """Return the texts of a list of labels and of its continuations (``LABELS2`` …)."""
    labels = []
    for key in (base, *(f"{base}{number}" for number in range(2, 256))):
        if key not in point:
            break
        dimensions, text = point[key]
        width = dimensions[0] if dimensions else 0
        if width:  # as many as the bytes hold, whatever the dimensions claim
            count = min(len(text) // width, math.prod(dimensions[1:]))
            labels += [_text(text[width * i : width * (i + 1)]) for i in range(count)]
    return labels


def _text(raw: bytes) -> str:
    try:
        text = raw.decode()
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return text.strip(" \t\r\n\0")


def _names(point: Parameters, points: int, repairs: list[Repair]) -> list[str]:
    labels = _labels(point, "LABELS")[:points]
    labels += [""] * (points - len(labels))
    names = [re.sub(r"[\0-\x1f\x7f]+", " ", label).strip() for label in labels]
    if names != labels:
        repairs.append(Repair("control characters in marker names became blanks", "POINT:LABELS"))
    if not all(names):
        what = f"{names.count('')} markers without a name are called M and a number"
        repairs.append(Repair(what, "POINT:LABELS"))
    return [name or f"M{number:03d}" for number, name in enumerate(names, 1)]


def _positional(point: Parameters, names: list[str], repairs: list[Repair]) -> list[int]:
    """Return the indices of the points that are positions, not outputs of a body model."""
    listed = {name: key for key in _NOT_POSITIONS for name in _labels(point, key) if name}
    kept = [marker for marker, name in enumerate(names) if name not in listed]
    outputs = [listed[name] for name in names if name in listed]
    if outputs:
        kinds = ", ".join(f"{outputs.count(key)} {key.lower()}" for key in dict.fromkeys(outputs))
        what = f"{len(outputs)} model outputs are no lengths and are left out ({kinds})"
        repairs.append(Repair(what, "POINT:LABELS"))
    if not kept:
        raise UnsupportedError("holds no marker positions", advice="Leave this file out")
    return kept


def _frames(
    data: bytes, reader: Any, points: int, claimed: int, repairs: list[Repair]
) -> FloatArray:
    """Return (frames, points, 4) as stored: three coordinates and the residual's word.

    A frame is four words per point, then its analog samples; words are 32-bit floats where
    POINT:SCALE is negative, otherwise 16-bit integers. Only what the file holds is read.
    """
    from c3d.c3d import DEC_to_IEEE_BYTES

    real = reader.point_scale < 0
    word = 4 if real else 2
    start = 512 * (reader.header.data_block - 1)
    size = word * (4 * points + reader.header.analog_count)
    held = max(0, len(data) - start) // size
    if held < claimed:
        what = f"the header claims {claimed} frames, the file holds {held}; those are kept"
        repairs.append(Repair(what, f"byte {len(data)}"))
    frames = min(claimed, held)
    rest = len(data) - start - frames * size
    if rest >= 512 and frames == claimed:  # less is the padding of the last block
        place = f"byte {start + frames * size}"
        repairs.append(Repair(f"{rest} bytes after the last frame are not read", place))
    stored = np.frombuffer(data, np.uint8, frames * size, min(start, len(data)))
    raw = np.ascontiguousarray(stored.reshape(frames, size)[:, : 4 * points * word])
    if real and reader.proc_type == "DEC":
        numbers = DEC_to_IEEE_BYTES(raw.reshape(-1))
    else:
        numbers = raw.view((">" if reader.proc_type == "MIPS" else "<") + ("f4" if real else "i2"))
    with np.errstate(invalid="ignore"):  # signalling NaNs
        return np.asarray(numbers, np.float64).reshape(frames, points, 4)


def _positions(frames: FloatArray, scale: float) -> FloatArray:
    """Return positions (frames, points, 3), NaN where the residual says invalid.

    The residual's word is cut to an integer, of which -1 means invalid.
    """
    positions = frames[:, :, :3] * scale
    gap = ~(frames[:, :, 3] > -1.0) | np.isnan(positions).any(axis=2)
    positions[gap] = np.nan
    return positions
