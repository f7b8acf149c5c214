"""What a job keeps of its clips for later ones: sketches, landmarks, and depths.

By these a new clip finds those that it is like, and those that it is a copy of, among all that
are archived, without decoding any. They are derived from the clips and stand beside the archive:
whoever deletes them gets larger files for new clips, and loses nothing.
"""

from __future__ import annotations

import hashlib
import io
import lzma
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from ..codec.clip import FloatArray, IntArray
from ..codec.errors import DamagedError
from ..codec.learned.landmarks import NUMBERS, Landmarks
from ..codec.learned.sketch import SKETCH_NUMBERS, Sketch
from .archive import Archive
from .durable import digest, write_whole
from .layout import traits_path

POSE_UNITS = 2.0  # of a centimetre: landmarks are compared to some
DIGITS = 16  # of the digest that a file begins with
_LEVELS = 127.0
_XZ = b"\xfd7zXZ"

Key = TypeVar("Key", str, int)


class Trait(NamedTuple):
    """What is kept of one clip; ``depth``: levels of clips that are decoded before it."""

    sketch: Sketch
    landmarks: Landmarks
    depth: int


class Traits(NamedTuple, Generic[Key]):
    """Sketches and landmarks of some clips."""

    sketches: dict[Key, Sketch]
    landmarks: dict[Key, Landmarks]


def write_traits(
    archive: Path, generation: int, names: Iterable[str], traits: Sequence[Trait]
) -> None:
    """Keep what is known of a job's clips, in the order of their rows."""
    sketches = _joined([trait.sketch for trait in traits], SKETCH_NUMBERS)
    largest = float(np.abs(sketches).max(initial=1.0))
    # finer where numbers are small, which most are
    roots = np.sign(sketches) * np.sqrt(np.abs(sketches) / largest)
    data = io.BytesIO()
    np.savez(
        data,
        names=np.frombuffer(_digest(names), np.uint8),
        largest=np.float64(largest),
        sketches=np.rint(_LEVELS * roots).astype(np.int8),
        moments=np.array([len(trait.sketch) for trait in traits], np.uint32),
        poses=_in_units(_joined([trait.landmarks.poses for trait in traits], NUMBERS)),
        frames=np.concatenate(
            [np.zeros(0, np.uint32), *(trait.landmarks.frames for trait in traits)]
        ).astype(np.uint32),
        landmarks=np.array([len(trait.landmarks.frames) for trait in traits], np.uint32),
        lengths=np.array([trait.landmarks.length for trait in traits], np.uint32),
        depths=np.array([trait.depth for trait in traits], np.uint8),
    )
    # a quarter smaller than with zip's deflate
    whole = lzma.compress(data.getvalue())
    write_whole(traits_path(archive, generation), digest(whole).encode() + whole)


def read_traits(archive: Archive) -> dict[int, Trait]:
    """Return what was kept of an archive's clips, by their numbers; of some jobs it may be lost."""
    found: dict[int, Trait] = {}
    first = 0
    for generation, ledger in sorted(archive.ledgers.items()):
        times = [archive.store.rigs[row.rig].frame_time for row in ledger.rows]
        names = (row.name for row in ledger.rows)
        kept = _kept(traits_path(archive.path, generation), _digest(names), times)
        found.update((first + place, trait) for place, trait in enumerate(kept))
        first += len(ledger.rows)
    return found


def check_traits(archive: Path, generations: Iterable[int]) -> list[str]:
    """Return in words which of an archive's traits are damaged; missing ones are not."""
    problems = []
    for path in (traits_path(archive, generation) for generation in generations):
        if path.exists() and _whole(path) is None:
            problem = DamagedError(
                "is not what a job kept for later ones", file=path, advice="Delete it"
            )
            problems.append(str(problem))
    return problems


def _whole(path: Path) -> bytes | None:
    """Return what was written after its digest, or None if that is not what is there."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    whole = data[DIGITS:]
    return whole if data[:DIGITS] == digest(whole).encode() else None


def _kept(path: Path, names: bytes, times: Sequence[float]) -> list[Trait]:
    whole = _whole(path)
    if whole is None:
        return []
    try:
        if whole.startswith(_XZ):  # not so in earlier archives
            whole = lzma.decompress(whole)
        with np.load(io.BytesIO(whole)) as arrays:
            if arrays["names"].tobytes() != names:  # of a job that was never published
                return []
            roots = arrays["sketches"].astype(np.float32) / _LEVELS
            numbers = np.sign(roots) * roots**2 * float(arrays["largest"])
            sketches = _cut(np.rint(numbers), arrays["moments"])
            poses = _cut(arrays["poses"] / np.float32(POSE_UNITS), arrays["landmarks"])
            frames = _cut(arrays["frames"].astype(np.int64), arrays["landmarks"])
            lengths, depths = arrays["lengths"].tolist(), arrays["depths"].tolist()
        return [
            Trait(
                np.asarray(sketch, np.float32),
                Landmarks(at, np.asarray(pose, np.float32), length, time),
                depth,
            )
            for sketch, at, pose, length, time, depth in zip(
                sketches, frames, poses, lengths, times, depths, strict=True
            )
        ]
    except (ValueError, KeyError, lzma.LZMAError):  # another motifold's
        return []


def _digest(names: Iterable[str]) -> bytes:
    return hashlib.blake2b("\n".join(names).encode("utf-8", "surrogateescape")).digest()


def _joined(arrays: Sequence[npt.NDArray[np.float32]], numbers: int) -> FloatArray:
    return np.concatenate([np.zeros((0, numbers)), *arrays])


def _in_units(poses: FloatArray) -> npt.NDArray[np.int16]:
    return np.clip(np.rint(POSE_UNITS * poses), -32768, 32767).astype(np.int16)


def _cut(joined: npt.NDArray[np.generic], counts: IntArray) -> list[npt.NDArray[np.generic]]:
    return np.split(joined, np.cumsum(counts)[:-1]) if len(counts) else []
