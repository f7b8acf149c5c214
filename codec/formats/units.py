"""Length units of source files: named by the caller, declared by the file, or estimated.

A human is the yardstick of an estimate. The rest pose of many rigs is not a standing one (all
bones along one axis, a hip offset of metres), so its height means nothing; bone lengths do. The
longest path along the bones from one end effector to another (a toe and a fingertip, mostly) is
the same in every pose, and about `PATH_PER_STATURE` times the stature.
"""

from __future__ import annotations

import math
import re

import numpy as np

from ..clip import FloatArray, Repair, Skeleton
from ..errors import UsageError

CENTIMETRES = {"m": 100.0, "cm": 1.0, "mm": 0.1, "in": 2.54, "ft": 30.48}
"""Centimetres per unit."""

PATH_PER_STATURE = 1.4
"""Longest path between two end effectors over stature. Eight rigs of five exporters had 1.44 to
1.63 times the upright extent of their joints, which lacks the crown of the head."""

ACCLAIM_UNIT = 2.54 / 0.45
"""Centimetres per unit of the CMU library's ASF files, kept by its conversions to BVH."""

_SPELLINGS = {
    "metre": "m", "metres": "m", "meter": "m", "meters": "m",
    "centimetre": "cm", "centimetres": "cm", "centimeter": "cm", "centimeters": "cm",
    "millimetre": "mm", "millimetres": "mm", "millimeter": "mm", "millimeters": "mm",
    "inch": "in", "inches": "in", "foot": "ft", "feet": "ft",
}  # fmt: skip
_GUESSES = {name: CENTIMETRES[name] for name in ("cm", "m", "in", "mm")}
_LAST_GUESSES = {f"{ACCLAIM_UNIT:g} cm": ACCLAIM_UNIT}
_STATURE = 170.0
_PLAUSIBLE = (100.0, 250.0)


def parse_units(text: str) -> tuple[str, float]:
    """Return (name, centimetres per unit) of a unit such as ``mm``, ``inches`` or ``5.644 cm``.

    A number before the name multiplies it. Raises UsageError for anything else.
    """
    found = re.fullmatch(r"\s*([0-9.]+(?:[eE][-+]?[0-9]+)?)?\s*([a-zA-Z]+)\s*", text)
    name = _SPELLINGS.get(found[2].lower(), found[2].lower()) if found else ""
    try:
        scale = float(found[1]) if found and found[1] else 1.0
    except ValueError:
        scale = math.nan
    if name not in CENTIMETRES or not 0 < scale * CENTIMETRES[name] < 1e6:
        known = ", ".join(CENTIMETRES)
        raise UsageError(
            f"unknown length unit {text!r}",
            advice=f"Use one of {known}, or a multiple such as '5.644 cm'",
        )
    return (name if scale == 1.0 else f"{scale:g} {name}"), scale * CENTIMETRES[name]


def estimate_unit(skeleton: Skeleton) -> tuple[str, float, Repair]:
    """Return (name, centimetres per unit, repair) that fit a skeleton in file units best.

    Among metres, centimetres, inches and millimetres, the unit whose stature is nearest to
    170 cm in log-distance, if that stature lies in 100..250 cm; else the CMU library's unit, if
    its does; else centimetres. The repair tells what was assumed from what.
    """
    tall = stature(skeleton)
    seen = f"a skeleton about {tall:.4g} units tall"
    for guesses in (_GUESSES, _LAST_GUESSES) if tall > 0 else ():
        name = min(guesses, key=lambda unit: abs(math.log(tall * guesses[unit] / _STATURE)))
        if _PLAUSIBLE[0] <= tall * guesses[name] <= _PLAUSIBLE[1]:
            what = f"length unit estimated as {name} from {seen}"
            return name, guesses[name], Repair(f"{what}; --units overrides it")
    what = f"length unit assumed to be cm, {seen} is no human in any unit"
    return "cm", 1.0, Repair(f"{what}; --units overrides it")


def stature(skeleton: Skeleton) -> float:
    """Return the standing height that the bone lengths suggest, in the skeleton's unit.

    The longest path along the bones between two end effectors over `PATH_PER_STATURE`; for a
    single chain its length. The root's own offset does not count.
    """
    joints = skeleton.joints
    reach: FloatArray = np.zeros((joints, 2))  # the two longest ways down from each joint
    for carrier, offset in zip(skeleton.end_parents, skeleton.end_offsets, strict=True):
        _extend(reach[carrier], float(np.linalg.norm(offset)))
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    for joint in range(joints - 1, 0, -1):
        _extend(reach[skeleton.parents[joint]], float(lengths[joint] + reach[joint, 0]))
    forks = reach[reach[:, 1] > 0]
    if not len(forks):
        return float(reach[0, 0])
    return float(forks.sum(axis=1).max() / PATH_PER_STATURE)


def _extend(pair: FloatArray, length: float) -> None:
    if length > pair[0]:
        pair[1], pair[0] = pair[0], length
    elif length > pair[1]:
        pair[1] = length
