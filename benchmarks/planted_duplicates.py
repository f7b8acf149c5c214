"""Duplicates planted among real clips, and what ``motifold duplicates`` finds of them.

Clips of DATA/bandai are linked into OUT/library, and copies of 24 of them planted, four of each
kind: renamed, the middle half, at 60 instead of 120 frames a second, elsewhere and facing another
way, mirrored, and with noise of a millimetre. Retakes are clips whose names have the same content
and style.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
from motion_sets import SETS, clip_files
from scipy.spatial.transform import Rotation, Slerp

from motifold.catalog.catalogfolder import Catalog
from motifold.catalog.duplicates import Pair, find_duplicates
from motifold.catalog.indexing import update_catalog
from motifold.codec.clip import SkeletonClip
from motifold.codec.figure.bodyparts import body_parts
from motifold.codec.figure.mirror import SIGNS, Mirror
from motifold.codec.figure.rig import bends_of, bone_means, found_family, rig_of
from motifold.codec.formats.files import clip_bytes, read_clip
from motifold.codec.geometry.kinematics import local_rotations, world_rotations
from motifold.codec.patterns.signals import relative_rotations
from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import SerialExecutor
from motifold.pipeline.plan import Settings
from motifold.pipeline.run import archive_library

PLANTED = "renamed", "cropped", "resampled", "moved", "mirrored", "noise"
OF_EACH = 4
FASTER = 4  # Bandai's 30 frames a second become 120
LABELS = re.compile(r"(?P<set>dataset-\d)_(?P<content>.+)_(?P<style>[^_]+)_\d+\.bvh$")


def cropped(clip: SkeletonClip) -> SkeletonClip:
    """Return the middle half of a clip."""
    return clip.slice(clip.frames // 4, clip.frames // 4 + clip.frames // 2)


def faster(clip: SkeletonClip) -> SkeletonClip:
    """Return a clip with three frames put between every two, on the shortest way."""
    frames = np.arange(clip.frames)
    times = np.arange((clip.frames - 1) * FASTER + 1) / FASTER
    rotations = np.empty((len(times), *clip.rotations.shape[1:]))
    translations = np.empty((len(times), *clip.translations.shape[1:]))
    for joint in range(clip.skeleton.joints):
        turns = Rotation.from_matrix(clip.rotations[:, joint])
        rotations[:, joint] = Slerp(frames, turns)(times).as_matrix()
        for axis in range(3):
            translations[:, joint, axis] = np.interp(
                times, frames, clip.translations[:, joint, axis]
            )
    time = clip.frame_time / FASTER
    return replace(clip, rotations=rotations, translations=translations, frame_time=time)


def halved(clip: SkeletonClip) -> SkeletonClip:
    """Return every second frame of a clip."""
    return replace(
        clip,
        rotations=clip.rotations[::2],
        translations=clip.translations[::2],
        frame_time=2 * clip.frame_time,
    )


def moved(clip: SkeletonClip) -> SkeletonClip:
    """Return a clip three metres away, turned by two radians."""
    turn = Rotation.from_rotvec([0.0, 2.0, 0.0]).as_matrix()
    rotations, translations = clip.rotations.copy(), clip.translations.copy()
    rotations[:, 0] = turn @ rotations[:, 0]
    translations[:, 0] = translations[:, 0] @ turn.T + np.array([300.0, 0.0, -50.0])
    return replace(clip, rotations=rotations, translations=translations)


def mirrored(clip: SkeletonClip, mirror: Mirror) -> SkeletonClip:
    """Return the mirror image of a clip on the same bones, as tools make it."""
    partner, axes = (np.array(each) for each in zip(*mirror, strict=True))
    world = world_rotations(clip.skeleton, clip.rotations)
    glass = np.array([-1.0, 1.0, 1.0])
    turned = np.diag(glass) @ world[:, partner] * SIGNS[axes][:, None]
    translations = clip.translations.copy()
    for joint in np.flatnonzero(np.ptp(clip.translations, axis=0).max(axis=1) > 0.0).tolist():
        above = int(clip.skeleton.parents[joint])
        signs = glass if above < 0 else SIGNS[axes[above]]
        translations[:, joint] = clip.translations[:, partner[joint]] * signs
    rotations = local_rotations(clip.skeleton, turned)
    return replace(clip, rotations=rotations, translations=translations)


def mirror_of(files: list[Path]) -> Mirror:
    """Return how the figure of some clips looks in a mirror."""
    clips = [clip for clip in map(read_clip, files) if isinstance(clip, SkeletonClip)]
    usual = np.zeros((clips[0].skeleton.joints, 3, 3))
    for clip in clips:
        rig = rig_of(clip, body_parts(clip.skeleton))
        world = world_rotations(clip.skeleton, clip.rotations)
        for part in rig.parts:
            usual[list(part.joints)] += relative_rotations(rig.parts, part, world).mean(axis=0)
    return found_family(rig, usual, bone_means(clip), bends_of(clip.rotations), 20.0).mirror


def noisy(clip: SkeletonClip) -> SkeletonClip:
    """Return a clip with noise of about a millimetre on every joint."""
    rng = np.random.default_rng(clip.frames)
    turns = Rotation.from_rotvec(0.0025 * rng.normal(size=(clip.rotations.size // 9, 3)))
    rotations = clip.rotations @ turns.as_matrix().reshape(clip.rotations.shape)
    translations = clip.translations.copy()
    translations[:, 1] += 0.1 * rng.normal(size=translations[:, 1].shape)
    return replace(clip, rotations=rotations, translations=translations)


Way: TypeAlias = Callable[[SkeletonClip], SkeletonClip]
KINDS: dict[str, Way] = {
    "cropped": cropped,
    "resampled": halved,
    "moved": moved,
    "noise": noisy,
}


def plant(files: list[Path], library: Path) -> dict[frozenset[str], str]:
    """Link files into a library and plant copies; return the planted pairs, with their kinds."""
    library.mkdir(parents=True)
    for path in files:
        (library / path.name).symlink_to(path)
    read = ((path, read_clip(path)) for path in files)
    some = ((path, clip) for path, clip in read if 3.0 < clip.frames * clip.frame_time < 12.0)
    planted = {}
    mirror = mirror_of(files[:20])
    ways: dict[str, Way] = {**KINDS, "mirrored": partial(mirrored, mirror=mirror)}
    for kind in PLANTED:
        for _ in range(OF_EACH):
            path, clip = next(some)
            copy = library / f"planted_{kind}_{path.name}"
            planted[frozenset((path.name, copy.name))] = kind
            if kind == "renamed":
                shutil.copy(path, copy)
                continue
            assert isinstance(clip, SkeletonClip)
            if kind == "resampled":
                clip = faster(clip)
                (library / path.name).unlink()
                (library / path.name).write_bytes(clip_bytes(clip, "bvh"))
            copy.write_bytes(clip_bytes(ways[kind](clip), "bvh"))
    return planted


def labels(name: str) -> tuple[str, ...]:
    """Return what is equal in the names of retakes."""
    match = LABELS.search(name)
    return match.group("set", "content", "style") if match else (name,)


def retake_figures(found: list[Pair], names: list[str]) -> dict[str, float]:
    """Return how many retakes among ``names`` are right, and how many clips have one told."""
    known = set(names)
    pairs = [pair for pair in found if pair.kind == "retake" and {pair.clip, pair.other} <= known]
    right = [pair for pair in pairs if labels(pair.clip) == labels(pair.other)]
    groups = [labels(name) for name in names]
    having = {name for name, group in zip(names, groups, strict=True) if groups.count(group) > 1}
    told = {name for pair in right for name in (pair.clip, pair.other)} & having
    return {
        "told": len(pairs),
        "right": len(right),
        "precision": len(right) / max(len(pairs), 1),
        "clips_with_a_retake": len(having),
        "recall_of_clips": len(told) / max(len(having), 1),
    }


def cost_share(archive: Archive, pair: frozenset[str]) -> float:
    """Return how many bytes a frame the cheaper one of two clips takes, over the dearer one's."""
    clips = [archive[name] for name in pair]
    least, most = sorted(clip.path.stat().st_size / clip.frames for clip in clips)
    return least / most


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, help="the folder with bandai/")
    parser.add_argument("out", type=Path, help="an empty folder")
    parser.add_argument("--clips", type=int, default=500)
    parser.add_argument("--tolerance", type=float, default=0.1, help="centimetres")
    parser.add_argument("--seed", type=int, default=3)
    options = parser.parse_args()
    files = list(clip_files(SETS["bandai"], options.data).values())
    random.Random(options.seed).shuffle(files)
    library, folder = options.out / "library", options.out / "archive"
    planted = plant([path.resolve() for path in files[: options.clips]], library)
    archive_library(library, folder, Settings(tolerance=options.tolerance), workers=0)
    update_catalog(folder, engine=SerialExecutor())
    with Archive(folder) as archive:
        found = find_duplicates(archive, Catalog(folder, many=True))
        names = [name for name in archive if not name.startswith("planted")]
        shares = {pair: cost_share(archive, pair) for pair in planted}
    told = {frozenset((pair.clip, pair.other)): pair for pair in found if pair.kind != "retake"}
    record = {
        "clips": options.clips,
        "planted": {
            kind: {
                "planted": OF_EACH,
                "found": sum(pair in told for pair, how in planted.items() if how == kind),
                "called": sorted(
                    {
                        told[pair].kind
                        for pair, how in planted.items()
                        if how == kind and pair in told
                    }
                ),
            }
            for kind in PLANTED
        },
        "bytes_a_frame_of_the_cheaper_one": {
            kind: sorted(round(shares[pair], 3) for pair, how in planted.items() if how == kind)
            for kind in PLANTED[1:]
        },
        "others_told": [
            [pair.kind, pair.clip, pair.other, pair.distance]
            for key, pair in told.items()
            if key not in planted
        ],
        "retakes": retake_figures(found, names),
    }
    print(json.dumps(record, indent=2))


if __name__ == "__main__":
    main()
