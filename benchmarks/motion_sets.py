"""The real motion that peers were measured on, and links to the part of it that is wanted."""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class MotionSet:
    """A set of clips: its ``folder`` in the data, its files' ``suffix``, its peers' ``figures``."""

    name: str
    title: str
    folder: str
    suffix: str
    figures: str


SETS = {
    "bandai": MotionSet("bandai", "Bandai clips", "bandai", ".bvh", "acl_bandai.csv"),
    "cmu": MotionSet("cmu", "CMU trials", "cmu_amc", ".amc", "acl_cmu.csv"),
}


def clip_files(wanted: MotionSet, data: Path) -> dict[str, Path]:
    """Return the files of a set by stem, in the stems' order."""
    folder = data / wanted.folder
    found = sorted(folder.rglob(f"*{wanted.suffix}"), key=lambda path: path.stem)
    if not found:
        raise SystemExit(f"no {wanted.suffix} files in {folder}: unpack the motion data there")
    return {path.stem: path for path in found}


def chosen(files: Mapping[str, Path], sample: int, seed: int) -> dict[str, Path]:
    """Return ``sample`` of the files at random (0: all), in the stems' order."""
    stems = list(files)
    if sample:
        stems = sorted(random.Random(seed).sample(stems, min(sample, len(stems))))
    return {stem: files[stem] for stem in stems}


def link_library(files: Mapping[str, Path], folder: Path) -> dict[str, Path]:
    """Make a flat library of links, skeleton files with them; return clip name to source."""
    folder.mkdir(parents=True)
    for path in files.values():
        skeletons = path.parent.glob("*.asf") if path.suffix == ".amc" else ()
        for file in (path, *skeletons):
            link = folder / file.name
            if not link.is_symlink():
                link.symlink_to(file.resolve())
    return {path.name: folder / path.name for path in files.values()}
