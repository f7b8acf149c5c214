"""What workers do for the learned codec: sketch, gather samples, encode with references."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..codec.blocks.leads import Track
from ..codec.blocks.mirrored import image_of
from ..codec.blocks.motionmodel import MotionModel, model_key
from ..codec.blocks.offered import Reference, reference_of
from ..codec.blocks.recall import Memory
from ..codec.errors import ArchiveError, MotifoldError
from ..codec.figure.rig import Family
from ..codec.formats.files import read_clip, source_bytes
from ..codec.geometry.limits import limits_of
from ..codec.learned.landmarks import Landmarks, landmarks_of
from ..codec.learned.samples import Sample
from ..codec.learned.sketch import Sketch, sketch_of
from ..codec.version2.leadfinding import Hint
from ..codec.version2.motionencode import MotionEncoder
from ..codec.version2.motionfile import MotionFile
from ..codec.version2.motiongoal import goal_of
from ..codec.version2.motionhead import Named
from .archive import Archive
from .durable import digest
from .indexreader import read_index
from .kept import Kept
from .layout import index_path
from .ledger import Failure
from .plan import Settings
from .shelf import Found
from .tasks import EncodedBatch, EncodedClip, Prepared, attempt, lost_failures
from .traits import Traits

DEEPEST_REFERENCE = 6  # levels below a clip that others may refer to
SAMPLE_FRAMES = 1500  # of a clip that a model is learned from
CACHED_BYTES = 96 << 20  # of decoded clips that others refer to, which a worker keeps


@dataclass(eq=False)
class Sketched:
    """The result of `sketch_batch`: what is known of clips by name, and of their mirror images."""

    clips: Traits[str] = field(default_factory=lambda: Traits({}, {}))
    images: Traits[str] = field(default_factory=lambda: Traits({}, {}))
    failures: list[Failure] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Assignment:
    """One clip to encode: what it is, and which clips it is predicted from.

    ``references``: (clip, scratch name) in ascending order; ``scratch`` and ``image``: under
    which names its own decoded motion and the mirror image of that are left for others, or None;
    ``hints``: where it may go as one of the references.
    """

    item: Prepared
    model: str
    references: tuple[tuple[Named, str], ...]
    scratch: str | None
    image: str | None = None
    hints: tuple[Hint, ...] = ()


def sketch_batch(
    batch: tuple[Prepared, ...], families: Mapping[str, Family], settings: Settings
) -> Sketched:
    """Read every clip and sketch it."""
    out = Sketched()
    for item in batch:

        def sketch(item: Prepared = item) -> list[tuple[Sketch, Landmarks]]:
            clip = read_clip(item.source.path, settings.units)
            family = families[item.rig.family_key]
            goal = goal_of(clip, item.rig, family, limits_of(clip, settings.bounds))
            shown = [(goal.path, goal.nodes)]
            if settings.references and "mirrors" not in settings.without:
                image = image_of((goal.path,), goal.nodes, item.rig, family)
                shown += [] if image is None else [(image[0][0], image[1])]
            return [
                (sketch_of(path, nodes, item.rig), landmarks_of(path, nodes, item.rig))
                for path, nodes in shown
            ]

        made = attempt(item.source.name, out.failures, sketch)
        for traits, (sketched, landmarks) in zip((out.clips, out.images), made or (), strict=False):
            traits.sketches[item.source.name] = sketched
            traits.landmarks[item.source.name] = landmarks
    return out


def sample_of(item: Prepared, family: Family, settings: Settings) -> Sample:
    """Return one clip to learn from."""
    clip = read_clip(item.source.path, settings.units)
    goal = goal_of(clip, item.rig, family, limits_of(clip, settings.bounds))
    path, yardstick = goal.run(0, SAMPLE_FRAMES)
    return Sample(path, path[:1], goal.nodes, yardstick)


@dataclass(eq=False)
class Recalled:
    """The result of `recall_batch`: sketches, landmarks and depths by clip number.

    ``ready``: what was left for the workers.
    """

    clips: dict[int, Sketch] = field(default_factory=dict)
    landmarks: dict[int, Landmarks] = field(default_factory=dict)
    depths: dict[int, int] = field(default_factory=dict)
    ready: list[Named] = field(default_factory=list)


def left_name(named: Named) -> str:
    """Return under which name a decoded clip, or its image, is left for the workers."""
    return f"{named.number}{'-image' * named.mirrored}.npz"


def recall_batch(
    wanted: tuple[Named, ...],
    archive: Archive,
    models: Mapping[str, MotionModel],
    scratch: str,
) -> Recalled:
    """Decode clips of earlier jobs that new ones may refer to, and leave them for the workers.

    ``models``: by key, those that the new clips are coded with. Clips that are too deep in the
    graph of references, damaged, or without the image that is wanted, are left out.
    """
    out = Recalled()
    rows = archive.numbered
    for named in wanted:
        number = named.number
        with suppress(MotifoldError):
            path = index_path(archive.path, rows[number].index)
            file, rig = read_index(path), archive.rig(rows[number].rig)
            if not isinstance(file, MotionFile):
                continue
            depth = archive.shelf.depth(file)
            if depth >= DEEPEST_REFERENCE:
                continue
            decoded = archive.shelf.states(Found(file, rig, path))
            if not decoded.states:
                continue  # no frames: nothing to refer to
            offered = decoded.states, decoded.nodes
            if named.mirrored:
                image = image_of(*offered, rig, archive.store.families[rig.family_key])
                if image is None:
                    continue
                offered = image
            made = reference_of(*offered, models[model_key(rig)])
            save_reference(Path(scratch) / left_name(named), made)
            out.ready.append(named)
            if named.mirrored:
                continue
            whole = np.concatenate(decoded.states)
            out.clips[number] = sketch_of(whole, decoded.nodes, rig)
            out.landmarks[number] = landmarks_of(whole, decoded.nodes, rig)
            out.depths[number] = depth
    return out


def encode_assigned(
    batch: tuple[Assignment, ...],
    encoders: Mapping[str, MotionEncoder],
    settings: Settings,
    scratch: str,
) -> EncodedBatch:
    """Encode every clip of a batch; each proves its own certificate."""
    out = EncodedBatch()
    for work in batch:

        def encode(work: Assignment = work) -> EncodedClip:
            item, encoder = work.item, encoders[work.model]
            if digest(source_bytes(item.source.path)) != item.digest:
                raise MotifoldError("changed while it was being archived", advice="Archive again")
            clip = read_clip(item.source.path, settings.units)
            limits = limits_of(clip, settings.bounds)
            references = [
                (named, _reference(Path(scratch) / name)) for named, name in work.references
            ]
            made = encoder.encode(clip, item.rig, item.rig_number, limits, references, work.hints)
            if work.scratch is not None:
                offered = reference_of(made.states, made.nodes, encoder.model)
                save_reference(Path(scratch) / work.scratch, offered)
            if work.image is not None:
                image = image_of(made.states, made.nodes, item.rig, encoder.family)
                if image is not None:
                    offered = reference_of(*image, encoder.model)
                    save_reference(Path(scratch) / work.image, offered)
            return EncodedClip(item.source.name, made.data, made.certificate, 0, 0)

        made = attempt(work.item.source.name, out.failures, encode)
        if made is not None:
            out.clips.append(made)
    return out


def save_reference(path: Path, reference: Reference) -> None:
    """Leave a decoded clip for other workers."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".part.npz")
    np.savez(
        partial,
        keys=reference.memory.keys,
        follows=reference.memory.follows,
        poses=reference.poses,
        state=reference.track.state,
        rows=reference.track.rows,
    )
    partial.replace(path)


_cache: Kept[Path, Reference] = Kept(CACHED_BYTES)


def _reference(path: Path) -> Reference:
    """Return what a worker left. Raises `ArchiveError`."""
    known = _cache.get(path)
    if known is not None:
        return known
    try:
        with np.load(path) as arrays:
            memory = Memory(arrays["keys"], arrays["follows"])
            track = Track(arrays["state"], arrays["rows"])
            reference = Reference(memory, arrays["poses"], track)
    except (OSError, ValueError, KeyError) as problem:
        raise ArchiveError(
            f"what another worker left cannot be read ({problem})",
            file=path,
            advice="All workers must see the archive folder under the same path",
        ) from problem
    return _cache.keep(path, reference, reference.size)


def lost_sketches(batch: Sequence[Prepared]) -> Sketched:
    """Return what stands for a batch whose worker died."""
    return Sketched(failures=lost_failures(item.source.name for item in batch))
