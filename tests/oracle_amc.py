"""Reading ASF/AMC without the codec, straight from Lander's description of the format (1998).

A bone turns by M about axes of its own, C: in the rest pose's axes its local rotation is
C M C^-1. Turns apply in the order listed, about fixed axes (SciPy's lower-case letters). A
joint stands where its bone starts, at the tip of the parent's bone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from oracle import Floats, Motion
from scipy.spatial.transform import Rotation

INCH = 2.54


def read_amc(asf: Path, amc: Path) -> Motion:
    """Read a well-formed motion (degrees, 120 frames a second) in centimetres, depth first."""
    bones, children, unit = _read_asf(asf.read_text())
    frames = _read_frames(amc.read_text())
    names, parents = ["root"], [-1]
    _walk("root", children, names, parents)
    tips = [bones[name]["direction"] * bones[name].get("length", 0.0) * unit for name in names]
    tips[0] = np.zeros(3)  # the root is a point
    offsets = np.array([tips[parent] if parent >= 0 else np.zeros(3) for parent in parents])
    offsets[0] = bones["root"]["direction"] * unit
    translations = np.repeat(offsets[None], len(frames), axis=0)
    rotations = []
    for joint, name in enumerate(names):
        bone = bones[name]
        axes = Rotation.from_euler("xyz", bone["axis"], degrees=True)
        turn = Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (len(frames), 1)))
        if bone["dof"]:
            values = np.array([frame[name] for frame in frames])
            for dof, column in zip(bone["dof"], np.split(values, values.shape[1], 1), strict=True):
                if dof[0] == "t":
                    translations[:, joint, "xyz".index(dof[1])] += column[:, 0] * unit
                else:
                    turn = Rotation.from_euler(dof[1], column, degrees=True) * turn
        rotations.append(axes * turn * axes.inv())
    ends = [(joint, tips[joint]) for joint, name in enumerate(names) if not children.get(name)]
    return Motion(names, parents, offsets, ends, rotations, translations, 1 / 120)


def _read_asf(text: str) -> tuple[dict[str, Any], dict[str, list[str]], float]:
    """Return the bones by name, the children of each, and the length unit in centimetres."""
    root: dict[str, Any] = {"name": "root"}
    bones: dict[str, Any] = {"root": root}
    children: dict[str, list[str]] = {}
    section, bone, unit = "", root, 1.0
    for line in text.splitlines():
        word, *rest = line.partition("#")[0].split() or [""]
        if word.startswith(":"):
            section = word
        elif section == ":units" and word == "length":
            unit = INCH / float(rest[0])
        elif section == ":units" and word == "angle":
            assert rest[0].startswith("deg")
        elif section == ":root":
            if word == "order":
                root["dof"] = [dof.lower() for dof in rest]
            elif word == "position":
                root["direction"] = _vector(rest)
            elif word == "orientation":
                root["axis"] = _vector(rest)
        elif section == ":bonedata":
            if word == "begin":
                bone = {"dof": []}
            elif word == "name":
                bones[rest[0]] = bone
            elif word == "direction":
                bone["direction"] = _vector(rest)
            elif word == "axis":
                assert rest[3] == "XYZ"
                bone["axis"] = _vector(rest)
            elif word == "length":
                bone["length"] = float(rest[0])
            elif word == "dof":
                bone["dof"] = [dof.lower() for dof in rest]
        elif section == ":hierarchy" and word not in ("begin", "end", ""):
            children[word] = rest
    return bones, children, unit


def _vector(words: list[str]) -> Floats:
    return np.array([float(word) for word in words[:3]])


def _read_frames(text: str) -> list[dict[str, list[float]]]:
    frames: list[dict[str, list[float]]] = []
    for line in text.splitlines():
        word, *rest = line.partition("#")[0].split() or [""]
        if word.isdigit():
            frames.append({})
            assert int(word) == len(frames)
        elif word and not word.startswith(":"):
            frames[-1][word] = [float(number) for number in rest]
    return frames


def _walk(name: str, children: dict[str, list[str]], names: list[str], parents: list[int]) -> None:
    """Append the bones below ``name``, each before its children, with their parents' numbers."""
    number = len(names) - 1
    for child in children.get(name, []):
        names.append(child)
        parents.append(number)
        _walk(child, children, names, parents)
