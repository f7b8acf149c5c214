"""Acclaim skeleton files (ASF), the rigs of AMC motions.

After Lander, "Working with motion capture file formats" (Game Developer, January 1998), and the
files of the CMU library. A bone has a rest direction and length in world axes and axes of its
own, C. Motion turns it by M about its own axes, so that its local rotation in world axes is
L = C M C^-1. Turns are applied in the order listed: ``XYZ`` and ``rx ry rz`` mean Rz Ry Rx.

A joint stands at the start of each bone, which is the tip of the parent bone; end sites stand
at the tips of the bones without children.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ..clip import FloatArray, Repair, Skeleton
from ..errors import FormatError, InputError, UnsupportedError
from ..geometry.rotations import from_euler
from .bvh_hierarchy import MAX_JOINTS
from .numerals import usable_number

_DOFS = ("tx", "ty", "tz", "rx", "ry", "rz")


@dataclass
class _Bone:
    name: str = ""
    direction: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    length: float = 0.0
    axis: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    axis_order: str = "XYZ"
    dofs: tuple[str, ...] = ()
    line: int = 0


@dataclass(frozen=True, eq=False)
class AsfRig:
    """What an ASF file says.

    ``skeleton``: lengths in file units, joint 0 is ``root`` and its offset the rest position.
    ``axes``: (joints, 3, 3) each joint's C. ``dofs``: per joint its values in the AMC, of
    ``tx`` … ``rz``. ``centimetres``: per file unit, None where not declared. ``degrees``:
    whether angles are degrees (radians otherwise).
    """

    skeleton: Skeleton
    axes: FloatArray
    dofs: tuple[tuple[str, ...], ...]
    centimetres: float | None
    degrees: bool
    repairs: tuple[Repair, ...]


def parse_asf(data: bytes, source: str = "") -> AsfRig:
    """Read the bytes of an ASF file. ``source`` names it in messages.

    ``length 0.45`` under ``:units`` declares a unit of 1/0.45 inch (CMU library, FAQ).
    Raises FormatError with the line, and UnsupportedError for bones that move or stretch.
    """
    reader = _Reader()
    try:
        for reader.line, raw in enumerate(data.splitlines(), 1):
            reader.take(raw.partition(b"#")[0].decode("latin-1").split())
        return reader.rig()
    except InputError as error:
        raise error.within(source) if source else error from None


class _Reader:
    """Gathers the sections' statements, one line at a time."""

    def __init__(self) -> None:
        self.line = 0
        self.section = ""
        self.units: dict[str, str] = {}
        self.root = _Bone("root")
        self.bones: dict[str, _Bone] = {"root": self.root}
        self.bone: _Bone | None = None
        self.children: dict[str, list[str]] = {}
        self.parents: dict[str, str] = {}

    def error(self, problem: str, kind: type[InputError] = FormatError) -> InputError:
        return kind(problem, place=f"line {self.line}")

    def take(self, words: list[str]) -> None:
        if words and words[0].startswith(":"):
            self.section, words = words[0][1:].lower(), words[1:]
        if not words:
            return
        key, values = words[0].lower(), words[1:]
        if self.section == "units" and values:
            self.units[key] = values[0].lower()
        elif self.section == "root":
            self.root_statement(key, values)
        elif self.section == "bonedata":
            self.bone_statement(key, values)
        elif self.section == "hierarchy" and key not in ("begin", "end"):
            self.attach(words[0], values)

    def root_statement(self, key: str, values: list[str]) -> None:
        if key == "order":
            self.root.dofs = self.dofs(values)
        elif key == "axis" and values:
            self.root.axis_order = self.order(values[0])
        elif key == "position":
            self.root.direction = self.vector(values)
        elif key == "orientation":
            self.root.axis = self.vector(values)

    def bone_statement(self, key: str, values: list[str]) -> None:
        if key == "begin":
            self.bone = _Bone(line=self.line)
        elif self.bone is None:
            raise self.error(f"{key[:40]!r} outside begin and end")
        elif key == "end":
            if not self.bone.name or self.bone.name in self.bones:
                raise self.error(f"a bone without a name of its own: {self.bone.name[:40]!r}")
            if len(self.bones) == MAX_JOINTS:
                raise self.error(f"there are more than {MAX_JOINTS} bones", UnsupportedError)
            self.bones[self.bone.name] = self.bone
            self.bone = None
        elif key == "name":
            self.bone.name = values[0] if values else ""
        elif key == "direction":
            self.bone.direction = self.vector(values)
        elif key == "length":
            self.bone.length = self.numbers(values, 1)[0]
        elif key == "axis":
            self.bone.axis = self.vector(values)
            self.bone.axis_order = self.order(values[3]) if len(values) > 3 else "XYZ"
        elif key == "dof":
            self.bone.dofs = self.dofs(values)
            if not set(self.bone.dofs) <= {"rx", "ry", "rz"}:
                raise self.error(f"bone {self.bone.name} does more than turn", UnsupportedError)

    def attach(self, parent: str, children: list[str]) -> None:
        for name in (parent, *children):
            if name not in self.bones:
                raise self.error(f"unknown bone {name[:40]!r} in the hierarchy")
        for child in children:
            if child in self.parents or child == "root":
                raise self.error(f"bone {child} has two parents")
            self.parents[child] = parent
        self.children.setdefault(parent, []).extend(children)

    def numbers(self, values: list[str], count: int) -> list[float]:
        found = [usable_number(value) for value in values[:count]]
        if len(found) < count or any(math.isnan(number) for number in found):
            raise self.error(f"{count} usable number(s) are missing")
        return found

    def vector(self, values: list[str]) -> list[float]:
        return self.numbers(values, 3)

    def order(self, value: str) -> str:
        if sorted(value.upper()) != ["X", "Y", "Z"]:
            raise self.error(f"{value[:40]!r} is no order of the axes")
        return value.upper()

    def dofs(self, values: list[str]) -> tuple[str, ...]:
        names = tuple(value.lower() for value in values)
        if "l" in names:
            raise self.error("a bone that stretches (dof l)", UnsupportedError)
        if not set(names) <= set(_DOFS) or len(set(names)) < len(names):
            raise self.error(f"{' '.join(values)[:40]!r} are not degrees of freedom")
        return names

    def rig(self) -> AsfRig:
        if len(self.bones) == 1 or not self.children.get("root"):
            problem = "no bones hang on the root" if len(self.bones) > 1 else "there are no bones"
            raise FormatError(f"{problem}: this is no ASF file, or it is cut short")
        for name, bone in self.bones.items():
            if name not in self.parents and bone is not self.root:
                raise FormatError(f"bone {name} hangs on nothing", place=f"line {bone.line}")
        names, waiting = [], ["root"]
        while waiting:
            names.append(waiting.pop())
            waiting += reversed(self.children.get(names[-1], []))
        if len(names) < len(self.bones):
            lost = next(name for name in self.bones if name not in set(names))
            raise FormatError(f"bone {lost} hangs on itself", place=f"line {self.bones[lost].line}")
        bones = [self.bones[name] for name in names]
        index = {name: joint for joint, name in enumerate(names)}
        parents = np.array([index[self.parents[n]] if n in self.parents else -1 for n in names])
        lengths = np.array([bone.length for bone in bones])
        tips = np.array([bone.direction for bone in bones]) * lengths[:, None]
        offsets = tips[parents]
        offsets[0] = self.root.direction
        leaves = np.array(
            [joint for joint, name in enumerate(names) if not self.children.get(name)]
        )
        skeleton = Skeleton(tuple(names), parents.astype(np.int64), offsets, leaves, tips[leaves])
        degrees = not self.units.get("angle", "deg").startswith("rad")
        axes = np.stack([_own_axes(bone, degrees) for bone in bones])
        dofs = tuple(bone.dofs for bone in bones)
        length = self.units.get("length")
        unit = usable_number(length) if length else math.nan
        repairs = []
        if not unit > 0:
            repairs.append(Repair(f"the length unit is {length or 'missing'}", ":units"))
        declared = 2.54 / unit if unit > 0 else None
        return AsfRig(skeleton, axes, dofs, declared, degrees, tuple(repairs))


def _own_axes(bone: _Bone, degrees: bool) -> FloatArray:
    scale = math.pi / 180.0 if degrees else 1.0
    order = bone.axis_order[::-1]  # the axis that turns first stands last in the product
    return from_euler(order, np.array([bone.axis["XYZ".index(letter)] for letter in order]) * scale)
