"""The body parts of a skeleton (Gu et al. 2009, Section 3.1, Figure 4, applied to joints)."""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..clip import Skeleton
from ..errors import UsageError
from .jointroles import bare_part, label_joints


@dataclass(frozen=True)
class BodyPart:
    """One part of the body: a set of joints (or markers) and its place in the hierarchy."""

    name: str  # "root", "left_arm" …
    joints: tuple[int, ...]  # indices of the joints (or markers) of the part, ascending
    parent: int  # index of the parent part in the tuple of parts; -1 for the root part
    reference: int  # the joint (or marker) of this part that child parts are relative to


@dataclass(frozen=True)
class PartEntry:
    """What a parts file says of one part; None where it leaves the choice to motifold."""

    name: str
    joints: tuple[str, ...]
    parent: str | None
    reference: str | None


@dataclass(frozen=True)
class PartsFile:
    """A person's corrections of the automatic body parts (see `load_parts`)."""

    file: str
    parts: tuple[PartEntry, ...]

    def error(self, part: str, problem: str, advice: str) -> UsageError:
        """Return the error that names this file and one of its parts."""
        return UsageError(problem, file=self.file, place=f"[parts.{part}]", advice=advice)


# Where a part belongs in the body, whatever joint its first one hangs on: a Biped's clavicles
# hang on the neck and its thighs on the spine. Other parts go where the skeleton has them.
_ABOVE = {
    "spine": ("root",),
    "head": ("spine", "root"),
    "shoulder": ("spine", "root"),
    "arm": ("shoulder", "spine", "root"),
    "hand": ("arm", "shoulder", "spine", "root"),
    "hip": ("root",),
    "leg": ("hip", "root"),
    "foot": ("leg", "hip", "root"),
}


def body_parts(skeleton: Skeleton, overrides: PartsFile | None = None) -> tuple[BodyPart, ...]:
    """Return the body parts of a skeleton, a parent before its children, the root part first.

    The parts are those of Gu et al. 2009, Figure 4: ``root`` (from the skeleton's root to the
    pelvis), ``spine``, ``head`` (with the neck), and with ``left_`` or ``right_`` in front
    ``shoulder`` (clavicle), ``arm``, ``hand``, ``hip``, ``leg``, ``foot``; also ``fingers``
    (a part per hand), ``face``, and ``other_<joint>`` for a subtree that nothing is known of.
    Every joint is in exactly one part. A part that the skeleton lacks is left out, its
    children hang on the next part above. The reference is the joint that carries the most of
    the child parts, or the last joint for a part without children; for the root it is the
    pelvis. Joints are known by their names, or by the shape of the tree where no name tells
    of a limb (see `jointnames`, `jointroles`, `jointshape`).

    Raises `UsageError` when ``overrides`` does not fit the skeleton.
    """
    labels = label_joints(skeleton)
    entries = {entry.name: entry for entry in overrides.parts} if overrides else {}
    if overrides:
        _relabel(skeleton, labels, overrides)
    members: dict[str, list[int]] = {}
    for joint, label in enumerate(labels):
        members.setdefault(label, []).append(joint)
    if overrides:
        _check_names(skeleton, members, overrides)

    parents = [int(parent) for parent in skeleton.parents]
    carriers = {name: _carriers(name, members[name], parents, labels) for name in members}
    above = {name: labels[joints[0]] if joints else "" for name, joints in carriers.items()}
    above |= {name: entry.parent for name, entry in entries.items() if entry.parent}
    children: dict[str, list[str]] = {name: [] for name in ("", *members)}
    for name, parent in above.items():
        children[parent].append(name)
    order = _parents_first(children)
    if overrides and len(order) < len(members):
        lost = [name for name in members if name not in order]
        raise overrides.error(
            next(name for name in entries if name in lost),
            "its parents lead back to itself",
            f"Give one of {', '.join(lost)} a parent nearer to the root",
        )

    place = {name: index for index, name in enumerate(order)} | {"": -1}
    parts = []
    for name in order:
        joints = members[name]
        asked = entries[name].reference if name in entries else None
        if asked is not None:
            reference = next(joint for joint in joints if skeleton.names[joint] == asked)
        else:
            reference = _reference(name, joints, children[name], carriers)
        parts.append(BodyPart(name, tuple(joints), place[above[name]], reference))
    return tuple(parts)


def _carriers(
    name: str, joints: Sequence[int], parents: Sequence[int], labels: Sequence[str]
) -> list[int]:
    """Return the joints of other parts that a part's joints hang on; none for the root."""
    allowed = _ABOVE.get(bare_part(name))
    found: list[int] = []
    for joint in joints:
        carrier = parents[joint]
        if carrier < 0 or labels[carrier] == name:
            continue
        while allowed and carrier > 0 and not found:  # the first joint decides
            part = bare_part(labels[carrier])
            if part in allowed or part not in _ABOVE:  # a person's own parts may carry anything
                break
            carrier = parents[carrier]
        found.append(carrier)
    return found


def _parents_first(children: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the names of the parts that hang on the root part, a parent before its children."""
    order: list[str] = []
    waiting = list(children[""])
    while waiting:
        name = waiting.pop()
        order.append(name)
        waiting += reversed(children[name])
    return order


def _reference(
    name: str,
    joints: Sequence[int],
    children: Sequence[str],
    carriers: Mapping[str, Sequence[int]],
) -> int:
    """Return the joint that carries the most children; props and the like count only alone."""
    body = [child for child in children if not child.startswith("other_")] or children
    carried = Counter(carrier for child in body for carrier in set(carriers[child]))
    if name == "root" or not carried:
        return joints[-1]
    return max(joints, key=lambda joint: (carried[joint], joint))


def _relabel(skeleton: Skeleton, labels: list[str], overrides: PartsFile) -> None:
    """Give the joints that the file names the parts that it names."""
    named: dict[str, list[int]] = {}
    for joint, joint_name in enumerate(skeleton.names):
        named.setdefault(joint_name, []).append(joint)
    for entry in overrides.parts:
        for joint_name in entry.joints:
            if joint_name not in named:
                raise overrides.error(
                    entry.name,
                    f"the skeleton has no joint {joint_name!r}",
                    "Its joints: " + _listing(skeleton.names),
                )
            for joint in named[joint_name]:
                labels[joint] = entry.name
    if labels[0] != "root":
        raise overrides.error(
            labels[0],
            f"the skeleton's root joint {skeleton.names[0]!r} must stay in the part 'root'",
            "Take it out of this part",
        )


def _check_names(
    skeleton: Skeleton, members: Mapping[str, Sequence[int]], overrides: PartsFile
) -> None:
    """Raise `UsageError` unless every part, parent and reference that the file names exists."""
    for entry in overrides.parts:
        if entry.name not in members:
            raise overrides.error(
                entry.name, "no joint belongs to this part", "Name its joints with joints = [...]"
            )
        if entry.parent is not None and entry.parent not in members:
            raise overrides.error(
                entry.name,
                f"there is no part {entry.parent!r} to be its parent",
                "The parts: " + _listing(members),
            )
        own = [skeleton.names[joint] for joint in members[entry.name]]
        if entry.reference is not None and entry.reference not in own:
            raise overrides.error(
                entry.name,
                f"its reference {entry.reference!r} is not one of its joints",
                "Its joints: " + _listing(own),
            )


def _listing(names: Iterable[str]) -> str:
    known = list(names)
    return ", ".join(known[:60]) + (" …" if len(known) > 60 else "")


def load_parts(path: str | Path) -> PartsFile:
    """Return the corrections of the automatic body parts that a small TOML file holds.

    ::

        [parts.left_arm]
        joints = ["LeftArm", "LeftForeArm"]   # moved into this part; the others stay
        parent = "left_shoulder"              # default: as the skeleton has it
        reference = "LeftForeArm"             # default: the joint that carries most children

    All three keys may be left out. A name in front of which nothing stands yet makes a new
    part. A part that loses all its joints is gone, and its children hang on the next above.

    Raises `UsageError` when the file cannot be read or breaks this form, and when a joint is
    in two parts; what depends on the skeleton (unknown joints and parents, cycles, a root joint
    outside ``root``) is raised by `body_parts`.
    """
    file = str(path)
    try:
        tables = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:  # TOML and UTF-8 errors are both ValueErrors
        raise UsageError(
            f"cannot read the parts file: {error}", file=file, advice="Mend it or name another"
        ) from error
    parts = tables.pop("parts", None)
    if tables or not isinstance(parts, dict):
        raise UsageError(
            "a parts file holds tables [parts.NAME] and nothing else",
            file=file,
            place=", ".join(tables) or None,
            advice="See motifold.codec.bodyparts.load_parts for the form",
        )
    found = PartsFile(file, tuple(_entry(file, name, table) for name, table in parts.items()))
    owner: dict[str, str] = {}
    for entry in found.parts:
        for joint in entry.joints:
            if owner.setdefault(joint, entry.name) != entry.name:
                raise found.error(
                    entry.name,
                    f"joint {joint!r} is in {owner[joint]!r} already",
                    "Leave it in one of the two",
                )
    return found


def _entry(file: str, name: str, table: object) -> PartEntry:
    keys: dict[str, Any] = table if isinstance(table, dict) else {"": table}
    joints = keys.get("joints", [])
    texts = [keys[key] for key in ("parent", "reference") if key in keys]
    listed = isinstance(joints, list) and all(isinstance(joint, str) for joint in joints)
    if not (listed and all(isinstance(text, str) for text in texts)) or keys.keys() - _KEYS:
        raise UsageError(
            "a part has joints (a list of names), parent and reference (names)",
            file=file,
            place=f"[parts.{name}]",
            advice="See motifold.codec.bodyparts.load_parts for the form",
        )
    if name == "root" and "parent" in keys:
        raise UsageError(
            "the root part has no parent",
            file=file,
            place="[parts.root]",
            advice="Take the line out",
        )
    return PartEntry(name, tuple(joints), keys.get("parent"), keys.get("reference"))


_KEYS = {"joints", "parent", "reference"}
