"""Clips back into files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from ..codec.clip import Clip, SkeletonClip
from ..codec.errors import DamagedError, MotifoldError, UsageError
from ..codec.figure.partial import cut_to_parts
from ..codec.formats.files import clip_bytes, default_format
from ..codec.version1.decode import Tier
from .archive import Archive
from .archived_clip import ArchivedClip
from .durable import write_whole
from .executors import Executor, map_batches
from .ledger import Failure

BATCH_CLIPS = 16


@dataclass(frozen=True)
class Excerpt:
    """What is wanted of each clip.

    ``parts``: names of body parts, which come with those above them; none means all. ``start``,
    ``stop``: seconds, None for the clip's own ends. Raises `UsageError`.
    """

    parts: tuple[str, ...] = ()
    start: float | None = None
    stop: float | None = None

    def __post_init__(self) -> None:
        if self.stop is not None and self.stop < (self.start or 0.0):
            raise UsageError(f"nothing lies between {self.start or 0.0:g} s and {self.stop:g} s")

    def of(self, clip: ArchivedClip, tier: Tier) -> Clip:
        """Return the excerpt of a clip. Raises `DamagedError` or `UsageError`."""
        first, last = 0, None
        if self.start is not None:
            first = round(self.start / clip.frame_time)
        if self.stop is not None:
            last = round(self.stop / clip.frame_time) + 1
        if first >= clip.frames and first > 0:
            raise UsageError(f"it ends after {clip.seconds:g} s", file=clip.name)
        found = clip.decode(tier, parts=self.parts or None, start=first, stop=last)
        return cut_to_parts(found, clip.rig, self.parts) if self.parts else found

    def format_for(self, clip: Clip) -> str:
        """Return the format of a file of the excerpt, if none is asked for."""
        return "npz" if self.parts and isinstance(clip, SkeletonClip) else default_format(clip)


WHOLE = Excerpt()


@dataclass
class Restored:
    """What was restored: names of clips with their files, bytes written, and failures."""

    files: dict[str, str] = field(default_factory=dict)
    bytes: int = 0
    failures: list[Failure] = field(default_factory=list)


def restore_clips(
    archive: Archive,
    names: Sequence[str],
    out: str | Path,
    *,
    engine: Executor,
    tier: Tier = "tolerance",
    format: str | None = None,
    excerpt: Excerpt = WHOLE,
    progress: Callable[[int, int], None] | None = None,
) -> Restored:
    """Write clips of an archive as motion files below the folder ``out``.

    A file gets the clip's name with the suffix of its format: ``format``, or the source's own
    where it can be written (BVH for ASF/AMC, TRC for C3D). One damaged clip does not stop the
    others; it is in the result's ``failures``. ``progress`` gets clips done and clips in all.
    ``excerpt``: what is wanted of each clip; a BVH file holds all joints or none. Raises
    `UsageError`.
    """
    if excerpt.parts and format == "bvh":
        raise UsageError("a BVH file cannot hold some body parts only", advice="Use npz")
    batches = [names[i : i + BATCH_CLIPS] for i in range(0, len(names), BATCH_CLIPS)]
    total = Restored()
    done = 0
    for batch, result in map_batches(
        engine, _restore_batch, batches, archive, str(out), tier, format, excerpt, lost=_lost
    ):
        total.files.update(result.files)
        total.bytes += result.bytes
        total.failures += result.failures
        done += len(batch)
        if progress:
            progress(done, len(names))
    return total


def _restore_batch(
    names: Sequence[str],
    archive: Archive,
    out: str,
    tier: Tier,
    format: str | None,
    excerpt: Excerpt,
) -> Restored:
    done = Restored()
    for name in names:
        try:
            clip = excerpt.of(archive[name], tier)
            chosen = format or excerpt.format_for(clip)
            path = _target(archive, name, Path(out), chosen)
            data = clip_bytes(clip, chosen)
            write_whole(path, data)
        except MotifoldError as problem:
            done.failures.append(Failure(name, str(problem)))
            continue
        done.files[name] = str(path)
        done.bytes += len(data)
    return done


def _target(archive: Archive, name: str, out: Path, format: str) -> Path:
    """Return where a clip goes; clips that would meet keep their suffix in the name."""
    inside = PurePosixPath(name)
    if inside.is_absolute() or ".." in inside.parts:
        raise DamagedError(f"the clip's name {name!r} leads out of the folder", file=archive.path)
    stem = str(inside.with_suffix(""))
    alone = len(archive.stems[stem]) == 1 and stem not in archive
    return out / f"{stem if alone else name}.{format}"


def _lost(names: Sequence[str]) -> Restored:
    return Restored(
        failures=[Failure(name, "the worker process died while it decoded this") for name in names]
    )
