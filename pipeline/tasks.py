"""What workers do: pure functions from a batch of source files to small results.

A file that cannot be used becomes a `Failure` in the batch's result; it never raises, so that
one bad file never stops a job.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from ..codec.clip import Clip, FloatArray, Layout, MarkerClip, Repair, SkeletonClip
from ..codec.errors import MotifoldError
from ..codec.figure.bodyparts import BodyPart, PartsFile, body_parts
from ..codec.figure.bodysize import head_diagonal, marker_head_diagonal
from ..codec.figure.markerparts import marker_parts
from ..codec.figure.rig import Family, Rig, bends_of, bone_means, rig_of
from ..codec.formats.channels import rotation_order
from ..codec.formats.files import read_clip, source_bytes
from ..codec.geometry.kinematics import world_rotations
from ..codec.geometry.metrics import Errors
from ..codec.patterns.segments import SegmentRules, clip_segments
from ..codec.patterns.signals import relative_rotations
from ..codec.version1.encode import Encoder
from .clustering import Representatives, within_clip
from .discover import Source
from .durable import digest, is_named
from .ledger import Failure

Made = TypeVar("Made")


@dataclass(frozen=True)
class Survey:
    """What a first look at one clip says. ``rig_key`` names a rig of the batch's `Surveyed`."""

    name: str
    source: str
    source_bytes: int
    frames: int
    numbers: int
    rig_key: str
    repairs: tuple[Repair, ...]


@dataclass(eq=False)
class FamilySketch:
    """What a batch says about a rig family: enough for its first clip to found it.

    ``usual``: (joints, 3, 3) summed mean orientations relative to the parent parts'
    references; ``bones``: (joints, 3) mean translations of its first clip, centimetres;
    ``bends``: (joints, 3, 3) summed, as by `rig.bends_of`.
    """

    rig: Rig
    usual: FloatArray
    bones: FloatArray
    bends: FloatArray
    head_diagonal: float


@dataclass(eq=False)
class Surveyed:
    """The result of `survey_batch`."""

    clips: list[Survey] = field(default_factory=list)
    rigs: dict[str, Rig] = field(default_factory=dict)
    families: dict[str, FamilySketch] = field(default_factory=dict)
    unchanged: int = 0
    failures: list[Failure] = field(default_factory=list)


@dataclass(eq=False)
class Segmented:
    """The result of `segment_batch`: per clip name, per part, its representatives (or None)."""

    clips: dict[str, list[Representatives | None]] = field(default_factory=dict)
    failures: list[Failure] = field(default_factory=list)


@dataclass(frozen=True)
class EncodedClip:
    """One encoded clip: index-file bytes, certificate, and segments with and without pattern."""

    name: str
    data: bytes
    certificate: Errors
    segments: int
    matched: int


@dataclass(eq=False)
class EncodedBatch:
    """The result of `encode_batch`."""

    clips: list[EncodedClip] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Prepared:
    """One clip to work on: its source, its rig's number, and its rig."""

    source: Source
    rig_number: int
    rig: Rig
    digest: str


def survey_batch(
    batch: tuple[Source, ...],
    units: str | None,
    overrides: PartsFile | None,
    known: Mapping[str, str],
) -> Surveyed:
    """Read every clip of a batch once: rigs, families, digests, repairs.

    ``known``: clip name to source digest of what is archived; such clips are not parsed.
    """
    out = Surveyed()
    for source in batch:

        def survey(source: Source = source) -> None:
            _survey(source, units, overrides, known, out)

        attempt(source.name, out.failures, survey)
    return out


def _survey(
    source: Source,
    units: str | None,
    overrides: PartsFile | None,
    known: Mapping[str, str],
    out: Surveyed,
) -> None:
    data = source_bytes(source.path)
    if source.name in known and is_named(data, known[source.name]):
        out.unchanged += 1
        return
    clip = read_clip(source.path, units)
    parts = _parts(clip, overrides)
    rig = rig_of(clip, parts)
    family_key = rig.family_key
    if isinstance(clip, MarkerClip):
        usual, bones = np.zeros((0, 3, 3)), np.zeros((0, 3))
        bends = usual
        numbers = int(clip.seen.sum()) * 3
    else:
        usual, bones = _mean_orientations(clip, parts), bone_means(clip)
        bends = bends_of(clip.rotations)
        numbers = _varying_numbers(clip)
    if family_key in out.families:
        out.families[family_key].usual += usual
        out.families[family_key].bends += bends
    else:
        size = (
            marker_head_diagonal(clip.names, clip.positions)
            if isinstance(clip, MarkerClip)
            else head_diagonal(clip.skeleton)
        )
        out.families[family_key] = FamilySketch(rig, usual, bones, bends, size)
    out.rigs.setdefault(rig.key, rig)
    out.clips.append(
        Survey(source.name, digest(data), len(data), clip.frames, numbers, rig.key, clip.repairs)
    )


def segment_batch(
    batch: tuple[Prepared, ...],
    families: dict[str, Family],
    radii: dict[str, float],
    rules: SegmentRules,
    units: str | None,
) -> Segmented:
    """Read every clip again, cut it, and cluster its segments within the clip (step one)."""
    out = Segmented()
    for item in batch:
        family = families[item.rig.family_key]
        radius = radii[family.key]

        def step_one(
            item: Prepared = item, family: Family = family, radius: float = radius
        ) -> list[Representatives | None]:
            clip = read_clip(item.source.path, units)
            return [
                None if part is None else within_clip(part.points, radius)
                for part in clip_segments(clip, family, rules)
            ]

        made = attempt(item.source.name, out.failures, step_one)
        if made is not None:
            out.clips[item.source.name] = made
    return out


def encode_batch(
    batch: tuple[Prepared, ...], encoders: dict[str, Encoder], units: str | None
) -> EncodedBatch:
    """Read every clip a last time and encode it; each proves its own certificate."""
    out = EncodedBatch()
    for item in batch:

        def encode(item: Prepared = item) -> EncodedClip:
            encoder = encoders[item.rig.family_key]
            if digest(source_bytes(item.source.path)) != item.digest:
                raise MotifoldError("changed while it was being archived", advice="Archive again")
            clip = read_clip(item.source.path, units)
            encoded = encoder.encode(clip, item.rig, item.rig_number)
            used = encoded.used_patterns
            return EncodedClip(
                item.source.name,
                encoded.data,
                encoded.certificate,
                sum(len(part) for part in used),
                sum(int((part >= 0).sum()) for part in used),
            )

        made = attempt(item.source.name, out.failures, encode)
        if made is not None:
            out.clips.append(made)
    return out


def attempt(name: str, failures: list[Failure], work: Callable[[], Made]) -> Made | None:
    """Return ``work()``, or None with a `Failure` noted, whatever goes wrong with one clip."""
    try:
        return work()
    except MotifoldError as problem:
        failures.append(Failure(name, _reason(problem)))
    except Exception as problem:  # noqa: BLE001 - a bug of ours must not cost the other clips
        failures.append(Failure(name, f"internal error, {type(problem).__name__}: {problem}"))
    return None


def lost_failures(names: Iterable[str]) -> list[Failure]:
    """Return the failures of clips whose worker died on them."""
    reason = "the worker process died on this file twice; is it too large for the memory?"
    return [Failure(name, reason) for name in names]


def _reason(problem: MotifoldError) -> str:
    """Return an error's text without the folder, which differs from machine to machine."""
    where = ", ".join(
        part for part in (Path(problem.file).name if problem.file else None, problem.place) if part
    )
    text = f"{where}: {problem.problem}" if where else problem.problem
    text = f"{text}. {problem.advice}" if problem.advice else text
    return text.replace(str(Path(problem.file).parent), "its folder") if problem.file else text


def _parts(clip: Clip, overrides: PartsFile | None) -> tuple[BodyPart, ...]:
    if isinstance(clip, MarkerClip):
        return marker_parts(clip.names, clip.positions)
    return body_parts(clip.skeleton, overrides)


def _mean_orientations(clip: SkeletonClip, parts: tuple[BodyPart, ...]) -> FloatArray:
    """Return each joint's mean orientation (joints, 3, 3) relative to its parent part."""
    world = world_rotations(clip.skeleton, clip.rotations)
    out = np.zeros((clip.skeleton.joints, 3, 3))
    if clip.frames:
        for part in parts:
            out[list(part.joints)] = relative_rotations(parts, part, world).mean(axis=0)
    return out


def _varying_numbers(clip: SkeletonClip) -> int:
    """Return how many numbers of the source file lie in channels of joints that move."""
    if not clip.frames:
        return 0
    turning = np.abs(clip.rotations - clip.rotations[:1]).max(axis=(0, 2, 3)) > 1e-9
    sliding = np.ptp(clip.translations, axis=0).max(axis=1) > 0.02
    count = 0
    for joint, (turns, slides) in enumerate(_channel_counts(clip.layout)):
        count += turns * bool(turning[joint]) + slides * bool(sliding[joint])
    return count * clip.frames


def _channel_counts(layout: Layout) -> list[tuple[int, int]]:
    """Return how many numbers of rotation and of translation each joint has in the source."""
    if dofs := layout.detail("dofs"):  # AMC: channels are those of the BVH that it comes back as
        return [(part.count("r"), part.count("t")) for part in dofs.split(";")]
    turns = [len(rotation_order(names)) for names in layout.channels]
    return [(own, len(names) - own) for own, names in zip(turns, layout.channels, strict=True)]
