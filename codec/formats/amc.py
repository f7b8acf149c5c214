"""Acclaim motion files (AMC), read with the ASF file of their rig; see `asf` for the geometry."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

import numpy as np

from ..clip import FloatArray, Layout, Repair, SkeletonClip, UnitSource
from ..errors import FormatError, InputError
from ..geometry.rotations import from_euler
from .asf import AsfRig, parse_asf
from .channels import POSITIONS, check_size
from .numerals import LARGEST, cut_short, usable_number
from .units import estimate_unit, parse_units

__all__ = ["AsfRig", "parse_amc", "parse_asf"]

DEFAULT_RATE = 120.0  # frames a second, of nearly all of the CMU library
_HIGHEST_RATE = 1e6
_ROTATIONS = ("Zrotation", "Yrotation", "Xrotation")
_COMMENT = re.compile(rb"#[^\r\n]*")
_NO_NUMBER = " is no usable number"
_LONGEST_FRAME_NUMBER = 15  # digits, so that a frame number is exact as a float


@dataclass(frozen=True)
class _Motion:
    """``values``: (frames, values of all joints), in the order of the rig's joints."""

    numbers: list[int]
    values: FloatArray
    repairs: list[Repair]


def parse_amc(
    data: bytes,
    asf: bytes | AsfRig,
    source: str = "",
    asf_source: str = "",
    units: str | None = None,
) -> SkeletonClip:
    """Read the bytes of an AMC file on the rig of an ASF file (its bytes, or parsed).

    ``source`` and ``asf_source`` name the files in messages; ``units`` overrides the length
    unit. Raises FormatError with frame and line, UnsupportedError as `parse_asf` does,
    UsageError for unknown ``units``.
    """
    given = parse_units(units) if units else None
    rig = parse_asf(asf, asf_source) if isinstance(asf, bytes) else asf
    try:
        return _parse(data, rig, given)
    except InputError as error:
        raise error.within(source) if source else error from None


def _parse(data: bytes, rig: AsfRig, given: tuple[str, float] | None) -> SkeletonClip:
    lines = _COMMENT.sub(b"", data).splitlines()
    fields, first = _head(lines)
    motion = _repeating_frames(lines[first:], rig) or _uneven_frames(lines, first, rig)
    repairs = [*rig.repairs, *motion.repairs]
    values = _in_order(motion, repairs)
    check_size(len(values), rig.skeleton.joints, values.size)
    degrees = b":DEGREES" in fields or (rig.degrees and b":RADIANS" not in fields)
    translations, rotations = _local_motion(values, rig, math.pi / 180.0 if degrees else 1.0)
    unit_source: UnitSource
    if given:
        (unit, centimetres), unit_source = given, "given"
    elif rig.centimetres:
        unit, centimetres, unit_source = f"{rig.centimetres:g} cm", rig.centimetres, "declared"
    else:
        unit, centimetres, repair = estimate_unit(rig.skeleton)
        unit_source = "estimated"
        repairs.append(repair)
    rate = usable_number(fields.get(b":SAMPLES-PER-SECOND", b""))
    if not 0 < rate <= _HIGHEST_RATE:
        rate = DEFAULT_RATE
        repairs.append(Repair("AMC files tell no frame time: 1/120 s assumed"))
    channels = ((*POSITIONS, *_ROTATIONS), *[_ROTATIONS] * (rig.skeleton.joints - 1))
    dofs = ";".join(" ".join(names) for names in rig.dofs)
    return SkeletonClip(
        replace(
            rig.skeleton,
            offsets=rig.skeleton.offsets * centimetres,
            end_offsets=rig.skeleton.end_offsets * centimetres,
        ),
        1.0 / rate,
        rotations,
        translations * centimetres,
        Layout("amc", unit, unit_source, centimetres, channels, (("dofs", dofs),)),
        tuple(repairs),
    )


def _frame_number(words: list[bytes]) -> bool:
    return len(words) == 1 and words[0].isdigit() and len(words[0]) <= _LONGEST_FRAME_NUMBER


def _head(lines: list[bytes]) -> tuple[dict[bytes, bytes], int]:
    """Return the statements before the first frame, and that frame's index in the lines."""
    fields: dict[bytes, bytes] = {}
    for number, line in enumerate(lines):
        words = line.split()
        if _frame_number(words):
            return fields, number
        if words and not words[0].startswith(b":"):
            shown = words[0][:40].decode("latin-1")
            problem = f"{shown!r} where a frame's number should be"
            raise FormatError(problem, place=f"line {number + 1}")
        if words:
            fields[words[0].upper()] = words[1] if len(words) > 1 else b""
    if not fields:
        raise FormatError("there are no frames: this is no AMC file", place="line 1")
    return fields, len(lines)


def _repeating_frames(lines: list[bytes], rig: AsfRig) -> _Motion | None:
    """Read frames that all list the same bones in the same order; None where they do not.

    Works on columns of words, an order of magnitude faster than line by line.
    """
    words = b" ".join(lines).split()
    joints = {name.encode("latin-1"): j for j, name in enumerate(rig.skeleton.names)}
    starts = np.cumsum([0, *map(len, rig.dofs)])
    named: dict[int, int] = {}  # column of a bone's name: joint
    width = 1
    while width < len(words) and words[width] in joints:
        named[width] = joints[words[width]]
        width += 1 + len(rig.dofs[named[width]])
    frames, left = divmod(len(words), width)
    moving = {joint for joint, dofs in enumerate(rig.dofs) if dofs}
    if left or not moving <= set(named.values()) or len(set(named.values())) < len(named):
        return None
    values = np.empty((frames, int(starts[-1])))
    if not all(_frame_number([word]) for word in words[::width]):
        return None
    try:
        for column, joint in named.items():
            if words[column::width].count(words[column]) != frames:
                return None
            for dof in range(len(rig.dofs[joint])):
                column_words = words[column + 1 + dof :: width]
                values[:, starts[joint] + dof] = np.array(column_words, dtype=np.float64)
    except ValueError:
        return None
    if not (np.abs(values) < LARGEST).all():
        return None
    return _Motion(list(map(int, words[::width])), values, [])


def _uneven_frames(lines: list[bytes], first: int, rig: AsfRig) -> _Motion:
    """Read frames line by line, and say what is wrong with them; `_repeating_frames` could not.

    Drops an incomplete last frame. ``first`` is the index of the first frame's line.
    """
    joints = {name.encode("latin-1"): j for j, name in enumerate(rig.skeleton.names)}
    moving = [joint for joint, dofs in enumerate(rig.dofs) if dofs]
    last = max((i for i, line in enumerate(lines) if line.strip()), default=-1)
    numbers: list[int] = []
    places: list[int] = []
    poses: list[dict[int, list[float]]] = []
    cut = ""
    for i in range(first, last + 1):
        words = lines[i].split()
        if _frame_number(words):
            numbers.append(int(words[0]))
            places.append(i + 1)
            poses.append({})
        elif words:
            problem = _take_bone(words, poses[-1], joints, rig)
            whole = i < last or (problem.endswith(_NO_NUMBER) and not cut_short(words[-1]))
            if problem and whole:
                raise FormatError(f"frame {numbers[-1]}: {problem}", place=f"line {i + 1}")
            cut = problem
    repairs: list[Repair] = []
    for k, pose in enumerate(poses):
        missing = next((rig.skeleton.names[j] for j in moving if j not in pose), "")
        if missing and k < len(poses) - 1:
            problem = f"frame {numbers[k]} lacks {missing}"
            raise FormatError(problem, place=f"line {places[k]}")
        if missing or (cut and k == len(poses) - 1):
            what = f"the last frame, {numbers[k]}, is cut short and left out"
            repairs.append(Repair(what, f"line {places[k]}"))
            del numbers[k], poses[k]
    rows = [[value for joint in moving for value in pose[joint]] for pose in poses]
    width = sum(map(len, rig.dofs))
    return _Motion(numbers, np.array(rows, np.float64).reshape(len(rows), width), repairs)


def _take_bone(
    words: list[bytes], pose: dict[int, list[float]], joints: dict[bytes, int], rig: AsfRig
) -> str:
    """Put one line's values into the pose; return what is wrong with the line, if anything."""
    name = words[0][:40].decode("latin-1")
    if words[0] not in joints:
        return f"unknown bone {name!r}"
    joint = joints[words[0]]
    if joint in pose:
        return f"bone {name} twice"
    dofs = rig.dofs[joint]
    if len(words) - 1 != len(dofs):
        return f"{len(words) - 1} values for the {len(dofs)} of bone {name}"
    values = [usable_number(word) for word in words[1:]]
    for dof, word, value in zip(dofs, words[1:], values, strict=True):
        if math.isnan(value):
            return f"{word[:40].decode('latin-1')!r} for {name} {dof}{_NO_NUMBER}"
    pose[joint] = values
    return ""


def _in_order(motion: _Motion, repairs: list[Repair]) -> FloatArray:
    """Return the values in the order of the frame numbers, where they tell one."""
    numbers = np.array(motion.numbers, dtype=np.int64)
    order = np.argsort(numbers, kind="stable")
    steps = np.diff(numbers[order])
    if (steps == 0).any():
        repairs.append(Repair("frame numbers repeat: the order of the file is kept"))
        return motion.values
    if (steps > 1).any():
        gap = int(numbers[order][np.argmax(steps > 1)])
        repairs.append(Repair("frames are missing here; the others are joined", f"frame {gap}"))
    if (np.diff(order) < 0).any():
        repairs.append(Repair("frames are out of order: sorted by their numbers"))
        return motion.values[order]
    return motion.values


def _local_motion(values: FloatArray, rig: AsfRig, radians: float) -> tuple[FloatArray, FloatArray]:
    """Return local translations, file units, and rotations of L = C M C^-1."""
    frames, joints = len(values), rig.skeleton.joints
    translations = np.empty((frames, joints, 3))
    translations[:] = rig.skeleton.offsets
    rotations = np.empty((frames, joints, 3, 3))
    groups: dict[str, tuple[list[int], list[list[int]]]] = {}
    start = 0
    for joint, dofs in enumerate(rig.dofs):
        turns = [(dof[1].upper(), start + i) for i, dof in enumerate(dofs) if dof[0] == "r"]
        turns.reverse()  # the axis that turns first stands last in the product
        members, columns = groups.setdefault("".join(axis for axis, _ in turns), ([], []))
        members.append(joint)
        columns.append([column for _, column in turns])
        for i, dof in enumerate(dofs):
            if dof[0] == "t":
                translations[:, joint, "xyz".index(dof[1])] += values[:, start + i]
        start += len(dofs)
    for order, (members, columns) in groups.items():
        turned = from_euler(order, values[:, np.array(columns, np.int64)] * radians)
        axes = rig.axes[members]
        rotations[:, members] = axes @ turned @ np.swapaxes(axes, -1, -2) if order else turned
    return translations, rotations
