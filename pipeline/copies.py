"""Which clips of a job may be copies of others, or of parts of them, and from where on.

Clips that share landmarks in the same order and at the same distances are compared frame by frame
when they are encoded; here is only said which, and the longer one is encoded first.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Mapping, Sequence
from itertools import zip_longest
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from scipy.spatial import cKDTree

from ..codec.learned.landmarks import Landmarks

RADIUS = 2.0  # centimetres between landmarks of copies: noise of all joints together
NEAREST = 16  # landmarks that are looked at for each one
LEAST_SHARED = 3  # landmarks, or all that the shorter clip has
MOST_ORIGINALS = 2  # of a clip
MOST_STRIDE = 16  # of an original's frames: more is a wrong unit of time
HIGHEST_LEVEL = 5  # of a copy: those of copies of copies grow

Name = TypeVar("Name", bound=Hashable)


class Copy(NamedTuple, Generic[Name]):
    """A clip that may go as another one.

    ``original``: that one; ``shift``: its frame that the copy's frame 0 is like, or would be;
    ``stride``: its frames from one of the copy's to the next.
    """

    original: Name
    shift: int
    stride: int
    mirrored: bool = False


def find_copies(
    clips: Sequence[Landmarks], first: int = 0, images: Sequence[Landmarks | None] = ()
) -> list[list[Copy[int]]]:
    """Return what each clip may be a copy of, the likeliest first.

    Clips before ``first`` are archived, so originals only. ``images``: the mirror images of the
    others, as far as they have one.
    """
    ranked: list[list[tuple[int, int, int, int, int, bool]]] = [[] for _ in clips]
    lengths = [len(clip.frames) for clip in clips]
    if sum(lengths) < 2:
        return [[] for _ in clips]
    poses = np.concatenate([clip.poses for clip in clips])
    frames = np.concatenate([clip.frames for clip in clips])
    owners = np.repeat(np.arange(len(clips)), lengths)
    tree, near = cKDTree(poses), min(NEAREST, len(poses))
    shared: dict[tuple[int, int, bool], list[tuple[int, int]]] = defaultdict(list)
    asked = [(number, clip, False) for number, clip in enumerate(clips)]
    asked += [(number, clip, True) for number, clip in enumerate(images, first) if clip]
    # the image has other landmarks than its clip: both together say how noisy a clip is
    noise = lengths[:first] + [
        length + (len(image.frames) if image else 0)
        for length, image in zip_longest(lengths[first:], images)
    ]
    looked = {(number, mirrored): len(clip.frames) for number, clip, mirrored in asked}
    for number, clip, mirrored in asked:
        if not len(clip.frames):
            continue
        _, others = tree.query(clip.poses, k=near, distance_upper_bound=RADIUS)
        mine, theirs = np.repeat(clip.frames, near), np.asarray(others).ravel()
        known = theirs < len(poses)
        mine, theirs = mine[known], theirs[known]
        apart = owners[theirs] != number
        for own, other in zip(mine[apart].tolist(), theirs[apart].tolist(), strict=True):
            original = int(owners[other])
            if _goes_first(clips, noise, original, number, first):
                shared[number, original, mirrored].append((own, int(frames[other])))
    for (copy, original, mirrored), pairs in sorted(shared.items()):
        stride = _stride(clips[copy], clips[original])
        if stride is None:
            continue
        votes, shift = _agreed(pairs, stride)
        # of an image other frames may be landmarks, so others may be all that it has
        if votes >= min(LEAST_SHARED, max(looked[copy, mirrored], 2)):
            length = clips[original].length
            ranked[copy].append((-votes, -length, original, shift, stride, mirrored))
    return [[Copy(*each[2:]) for each in sorted(votes)[:MOST_ORIGINALS]] for votes in ranked]


def after_originals(
    levels: Mapping[str, int], originals: Mapping[str, Sequence[str | int]]
) -> dict[str, int]:
    """Return levels at which every clip comes after its originals; those without stay.

    Originals of earlier jobs, which have numbers, come before all. Where that would lead too
    high, a clip stays where it is.
    """
    out = dict(levels)
    for _ in range(HIGHEST_LEVEL):
        for name, others in originals.items():
            above = max((out[each] + 1 for each in others if isinstance(each, str)), default=0)
            if above <= HIGHEST_LEVEL:
                out[name] = max(out[name], above)
    return out


def _goes_first(
    clips: Sequence[Landmarks], noise: Sequence[int], one: int, other: int, first: int
) -> bool:
    """Return whether ``other`` may be a copy of ``one``, and not the other way round."""
    if other < first:
        return False
    if one < first:
        return True
    # of more frames a second, longer, with less noise, which makes landmarks
    ranks = [
        (clips[number].frame_time, -clips[number].length, noise[number], number)
        for number in (one, other)
    ]
    return ranks[0] < ranks[1]


def _stride(copy: Landmarks, original: Landmarks) -> int | None:
    ratio = copy.frame_time / original.frame_time
    stride = round(ratio)
    known = 0 < stride <= MOST_STRIDE
    return stride if known and abs(ratio / stride - 1.0) < 0.01 else None


def _agreed(pairs: Sequence[tuple[int, int]], stride: int) -> tuple[int, int]:
    """Return how many frames of the copy agree about the shift, and the shift."""
    found = np.array(sorted((theirs - stride * own, own) for own, theirs in pairs))
    shifts = found[:, 0]
    ends = np.searchsorted(shifts, shifts + stride, side="right")
    at = int((ends - np.arange(len(shifts))).argmax())
    group = found[at : ends[at]]
    return len(np.unique(group[:, 1])), int(np.median(group[:, 0]))
