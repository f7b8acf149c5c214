"""Clips that a library holds twice: equal files, the same motion, crops, mirror images, retakes.

The catalog says which pairs could be; their decoded motion decides. Motion is the same if all of
the shorter clip lies inside the longer one, joint by joint, within what two lossy copies of one
recording may differ by.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..codec.clip import FloatArray, IntArray
from ..codec.errors import MotifoldError
from ..codec.figure.bodyparts import BodyPart
from ..pipeline.archive import Archive
from .bodysignals import RATE, faced, resampled
from .catalogfolder import Catalog
from .framewarp import warped_frames
from .search import POSTURE_SHARE, Query, best_clips, clip_scores, column_weights, part_weights
from .wordwarp import slid_inside

NOISE = 0.4  # centimetres that copies may differ by on average, beside their certified errors
STILL = 3.0  # times that: clips that move less are too still to tell
RETAKE = 4.5  # centimetres between the joints of two takes, warped onto each other
LONGER = 1.5  # times as long as another one that a retake lasts, at most
ALIKE = 0.5  # distance of words up to which motion is looked at
NEAR = 8  # clips that each clip is compared with, of each kind of query
COARSE, FINE = 30.0, 240.0  # samples a second: of the first search, and of the offset
SHORTEST = 0.5  # seconds
_KEPT = 512  # decoded clips


@dataclass(frozen=True)
class Pair:
    """Two clips that are alike, and how.

    ``kind``: ``equal`` source files, the ``same`` motion, a ``crop`` of it, either one
    ``mirrored``, or a ``retake``. ``offset``: seconds from the start of ``clip`` to where
    ``other``, the shorter one, starts. ``distance``: mean distance of joints, centimetres.
    """

    kind: str
    clip: str
    other: str
    offset: float
    distance: float


def find_duplicates(
    archive: Archive,
    catalog: Catalog,
    *,
    retakes: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> list[Pair]:
    """Return the pairs of clips of an archive that are alike, the surest kinds first.

    Clips that cannot be decoded are left out: `verify` names them.
    """
    found, equal = _equal_files(archive)
    numbers = sorted(catalog.numbers.values())
    motion = lru_cache(maxsize=_KEPT)(lambda name: _motion(archive, name))
    done: set[tuple[int, int, bool]] = set()
    for place, number in enumerate(numbers):
        for other, mirrored in candidates(catalog, number):
            key = (min(number, other), max(number, other), mirrored)
            if key in done or catalog.names[other] in equal or catalog.names[number] in equal:
                continue
            done.add(key)
            try:
                some, others = motion(catalog.names[number]), motion(catalog.names[other])
            except MotifoldError:
                continue
            pair = compare_motions(some, others, mirrored, retakes=retakes)
            if pair:
                found.append(pair)
        if progress:
            progress(place + 1, len(numbers))
    order = ["equal", "same", "same, mirrored", "crop", "crop, mirrored", "retake"]
    return sorted(found, key=lambda pair: (order.index(pair.kind), pair.clip, pair.other))


def candidates(catalog: Catalog, number: int) -> Iterator[tuple[int, bool]]:
    """Yield the clips that a clip could be the same as, and whether mirrored."""
    words = catalog.words(number)
    for mirrored in (False, True):
        said = catalog.vocabulary.mirrored(words) if mirrored else words
        query = Query(said, own=number)
        parts = part_weights(query)
        weights = column_weights(parts, POSTURE_SHARE["windows", "none"])
        chosen: set[int] = set()
        for mode in ("whole", "windows"):
            scores = clip_scores(catalog, query, parts, mode)
            chosen.update(best_clips(scores, NEAR)[0].tolist())
        for other in sorted(chosen):
            pair = said, catalog.words(other)
            short, long = sorted(pair, key=len)
            if slid_inside(short, [long], catalog.table, weights)[0][0] <= ALIKE:
                yield other, mirrored


@dataclass(frozen=True, eq=False)
class Motion:
    """A decoded clip: ``points`` (frames, joints, 3) facing forwards, and its mirror ``image``.

    ``error``: its certified mean error, centimetres.
    """

    name: str
    points: FloatArray
    image: FloatArray
    frame_time: float
    error: float

    @property
    def seconds(self) -> float:
        """From the first to the last frame."""
        return (len(self.points) - 1) * self.frame_time


def compare_motions(
    some: Motion, others: Motion, mirrored: bool, *, retakes: bool = False
) -> Pair | None:
    """Return how two motions are alike, None if they are not.

    ``mirrored``: compares one with the other's mirror image.
    """
    long, short = sorted((some, others), key=lambda each: (-each.seconds, each.name))
    if some.points.shape[1] != others.points.shape[1] or short.seconds < SHORTEST:
        return None
    points = short.image if mirrored else short.points
    allowed = NOISE + long.error + short.error
    if points.std(axis=0).mean() * 3.0 < STILL * allowed / 3.0:
        return None
    offset, distance = aligned(long.points, long.frame_time, points, short.frame_time)
    if distance <= allowed:
        whole = long.seconds - short.seconds < 2.0 / RATE
        kind = ("same" if whole else "crop") + (", mirrored" if mirrored else "")
        return Pair(kind, long.name, short.name, round(offset, 4), round(distance, 3))
    alike_long = long.seconds <= LONGER * short.seconds  # warping makes a wave of any raised hand
    if retakes and alike_long and not mirrored and distance < 5.0 * RETAKE:
        slow = [
            resampled(each.points, each.frame_time).astype(np.float32).reshape(-1, points[0].size)
            for each in (long, short)
        ]
        apart = warped_frames(*slow) / np.sqrt(points.shape[1])
        if apart <= RETAKE:
            return Pair("retake", long.name, short.name, 0.0, round(apart, 3))
    return None


def aligned(
    long: FloatArray, long_time: float, short: FloatArray, short_time: float
) -> tuple[float, float]:
    """Return where a motion starts inside a longer one (seconds), and their mean distance.

    Motions: (frames, joints, 3) centimetres, with the seconds from frame to frame. The distance
    is the mean over joints and frames, at the best start, to a 240th of a second.
    """
    some, other = (resampled(*each, COARSE) for each in ((long, long_time), (short, short_time)))
    wide = min(len(other), len(some))
    flat, target = some.reshape(len(some), -1), other[:wide].reshape(-1)
    windows = np.lib.stride_tricks.sliding_window_view(flat, wide, axis=0)
    gaps = [float(np.square(window.T.reshape(-1) - target).sum()) for window in windows]
    coarse = int(np.argmin(gaps)) / COARSE
    tries = coarse + np.arange(-int(FINE / COARSE), int(FINE / COARSE) + 1) / FINE
    times = np.arange(len(short)) * short_time
    ends = (len(long) - 1) * long_time
    best = (coarse, np.inf)
    for start in tries.tolist():
        at = np.clip(times + start, 0.0, ends) / long_time
        low = np.minimum(at.astype(np.int64), len(long) - 1)
        high = np.minimum(low + 1, len(long) - 1)
        share = (at - low)[:, None, None]
        there = long[low] * (1.0 - share) + long[high] * share
        distance = float(np.sqrt(np.square(there - short).sum(axis=2)).mean())
        best = min(best, (start, distance), key=lambda pair: pair[1])
    return max(best[0], 0.0), best[1]


def mirrored_joints(joints: int, parts: tuple[BodyPart, ...]) -> IntArray:
    """Return which joint each becomes in a mirror (joints,), by the sides of body parts."""
    named = {part.name: part for part in parts}
    image = np.arange(joints)
    for name, part in named.items():
        other = named.get(name.replace("left_", "right_", 1)) if "left_" in name else None
        if other and len(other.joints) == len(part.joints):
            image[list(part.joints)], image[list(other.joints)] = other.joints, part.joints
    return image


def _motion(archive: Archive, name: str) -> Motion:
    clip = archive[name]
    parts = clip.rig.parts
    points = faced(clip.decode(), parts)
    image = points[:, mirrored_joints(points.shape[1], parts)] * [-1.0, 1.0, 1.0]
    return Motion(name, points, image, clip.frame_time, clip.certificate.mean)


def _equal_files(archive: Archive) -> tuple[list[Pair], set[str]]:
    """Return the pairs of clips with equal source files, and all but the first of each."""
    first: dict[tuple[str, int], str] = {}
    pairs = []
    for name, (row, _) in archive.rows.items():
        if row.content in first:
            pairs.append(Pair("equal", first[row.content], name, 0.0, 0.0))
        else:
            first[row.content] = name
    return pairs, {pair.other for pair in pairs}
