"""Which body part each joint of a skeleton belongs to, from its name and its place in the tree."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..clip import FloatArray, Skeleton
from .jointnames import Role, Side, read_name
from .jointshape import roles_from_shape

# The part that a role belongs to, less the side; the two open roles are settled by `_settle`.
_PARTS: dict[str, str] = {
    "spine": "spine",
    "head": "head",
    "face": "face",
    "shoulder": "shoulder",
    "upper_arm": "arm",
    "forearm": "arm",
    "hand": "hand",
    "fingers": "fingers",
    "hip": "hip",
    "thigh": "leg",
    "shin": "leg",
    "foot": "foot",
}
SIDED = frozenset(("shoulder", "arm", "hand", "fingers", "hip", "leg", "foot"))
_LEG: frozenset[str] = frozenset(("hip?", "thigh", "shin", "foot"))
_LIMB = _LEG | {"shoulder", "shoulder?", "upper_arm", "forearm", "hand"}


def bare_part(label: str) -> str:
    """Return a part's name without its side: ``arm`` for ``left_arm``."""
    return label.removeprefix("left_").removeprefix("right_")


def label_joints(skeleton: Skeleton) -> list[str]:
    """Return the name of the body part of every joint (see `bodyparts.body_parts`).

    The path from the skeleton's root to the pelvis is ``root``. A joint whose name says
    nothing belongs to its parent's part when it leads to joints that do say something, and
    with all that hangs on it to ``other_<name>`` when it does not. Where no name speaks of a
    limb, all roles come from the shape of the tree.
    """
    read = [read_name(name) for name in skeleton.names]
    if not any(role in _LIMB for _, role in read):
        read = roles_from_shape(skeleton) or read
    parents = [int(parent) for parent in skeleton.parents]
    below = _roles_below(parents, [role for _, role in read])
    pelvis = _pelvis(skeleton, parents, [role for _, role in read], below)
    parts = [
        _settle(role, below[joint], read[parents[joint]][1]) for joint, (_, role) in enumerate(read)
    ]
    leads_to = _first_known(parents, parts)
    across = _rest_positions(skeleton)[:, 0]

    labels = [""] * skeleton.joints
    joint = pelvis
    while joint >= 0:
        labels[joint] = "root"
        joint = parents[joint]

    def label(joint: int, above: str) -> str:
        part = parts[joint]
        if part not in SIDED:
            return part
        side: Side = read[joint][0]
        if not side and bare_part(above) in SIDED:
            side = "left" if above.startswith("left_") else "right"
        if not side and abs(across[joint]) > 1e-6:  # +X is the actor's left in a rest pose
            side = "left" if across[joint] > 0 else "right"
        return f"{side}_{part}" if side else part

    for joint, name in enumerate(skeleton.names):
        if labels[joint]:
            continue
        above = labels[parents[joint]]
        if bare_part(above) in ("fingers", "face") or above.startswith("other_"):
            labels[joint] = above
        elif parts[joint]:
            labels[joint] = label(joint, above) if parts[joint] != "other" else f"other_{name}"
        elif leads_to[joint] < 0:
            labels[joint] = f"other_{name}"
        else:
            labels[joint] = label(leads_to[joint], above) if above == "root" else above
    return labels


def _settle(role: str, below: frozenset[str], above: Role) -> str:
    """Return the part of a role, given those of the joints below and of the joint above."""
    if role == "shoulder?" and above == "shoulder":
        role = "upper_arm"
    elif role == "shoulder?":
        alone = not below & {"forearm", "hand"}
        role = "shoulder" if alone or below & {"shoulder?", "upper_arm"} else "upper_arm"
    elif role == "hip?":
        alone = not below & {"shin", "foot"}
        role = "hip" if alone or below & {"hip?", "thigh"} else "thigh"
    return "other" if role == "other" else _PARTS.get(role, "")


def _roles_below(parents: Sequence[int], roles: Sequence[Role]) -> list[frozenset[str]]:
    below: list[set[str]] = [set() for _ in roles]
    for joint in range(len(roles) - 1, 0, -1):
        below[parents[joint]] |= below[joint] | {roles[joint]}
    return [frozenset(found) for found in below]


def _first_known(parents: Sequence[int], parts: Sequence[str]) -> list[int]:
    """Return, per joint, the first joint at or below it that has a part; -1 without one."""
    first = [joint if part and part != "other" else -1 for joint, part in enumerate(parts)]
    for joint in range(len(parts) - 1, 0, -1):
        parent = parents[joint]
        if first[joint] >= 0 and not parts[parent]:
            known = first[parent]
            first[parent] = first[joint] if known < 0 else min(known, first[joint])
    return first


def _pelvis(
    skeleton: Skeleton,
    parents: Sequence[int],
    roles: Sequence[Role],
    below: Sequence[frozenset[str]],
) -> int:
    """Return the pelvis: the deepest joint named so, or else the joint where the legs meet."""
    depth = [0] * len(parents)
    for joint in range(1, len(parents)):
        depth[joint] = depth[parents[joint]] + 1
    named = [joint for joint, role in enumerate(roles) if role == "root"]
    for carried in (_LEG, {"spine"}):
        carriers = [joint for joint in named if below[joint] & carried]
        if carriers:
            return max(carriers, key=lambda joint: depth[joint])

    legs = [int(role in _LEG) for role in roles]
    total = sum(legs)
    for joint in range(len(parents) - 1, 0, -1):
        legs[parents[joint]] += legs[joint]
    if total:
        meeting = max(
            (joint for joint, count in enumerate(legs) if count == total),
            key=lambda joint: depth[joint],
        )
        while meeting > 0 and roles[meeting] in _LEG:
            meeting = parents[meeting]
        return meeting
    forks = [joint for joint, children in enumerate(skeleton.children()) if len(children) > 2]
    return forks[0] if forks else 0


def _rest_positions(skeleton: Skeleton) -> FloatArray:
    out = np.array(skeleton.offsets, dtype=np.float64)
    for joint in range(1, skeleton.joints):
        out[joint] += out[skeleton.parents[joint]]
    return out
