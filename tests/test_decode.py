"""Index files decoded in part, from a prefix, and in other processes."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import oracle
import pytest
from clips import (
    MARKS,
    Bench,
    Marks,
    Recipe,
    bench_of,
    recipes,
    skeleton_bench,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.clip import MarkerClip, SkeletonClip
from motifold.codec.errors import UsageError
from motifold.codec.figure.bodyparts import BodyPart
from motifold.codec.version1.decode import decode
from motifold.codec.version1.index_file import unpack

SEEDS = st.integers(0, 2**32 - 1)


@given(st.one_of(recipes(), MARKS), st.booleans(), SEEDS)
@settings(max_examples=80, deadline=None)
def test_parts_alone_equal_the_whole(recipe: Recipe | Marks, patterns: bool, seed: int) -> None:
    subject = bench_of(recipe, patterns)
    index = unpack(subject.encoder().encode(subject.clip, subject.rig, 0).data)
    rng = np.random.default_rng(seed)
    parts = [part for part in subject.rig.parts if rng.random() < 0.4]
    joints = [joint for part in parts for joint in part.joints]
    whole = decode(index, subject.rig, subject.codebook)
    some = decode(index, subject.rig, subject.codebook, parts=[part.name for part in parts])
    if isinstance(whole, MarkerClip):
        assert isinstance(some, MarkerClip)
        assert np.array_equal(some.positions[:, joints], whole.positions[:, joints], equal_nan=True)
        rest = sorted(set(range(len(whole.names))) - set(parts_above(subject, parts)))
        assert np.isnan(some.positions[:, rest]).all()
        return
    assert isinstance(some, SkeletonClip)
    assert isinstance(whole, SkeletonClip)
    assert np.abs(some.rotations[:, joints] - whole.rotations[:, joints]).max(initial=0) < 1e-12
    assert np.array_equal(some.translations[:, joints], whole.translations[:, joints])
    if whole.frames:
        there, here = (oracle.pose(oracle.of_clip(clip)) for clip in (whole, some))
        size = np.abs(there[1]).max(initial=1.0)
        assert np.abs(there[1] - here[1])[:, joints].max(initial=0.0) < 1e-12 * size
    rest = sorted(set(range(whole.skeleton.joints)) - set(parts_above(subject, parts)))
    assert (some.rotations[:, rest] == np.eye(3)).all()
    assert (some.translations[:, rest] == whole.skeleton.offsets[rest]).all()


def parts_above(subject: Bench, parts: list[BodyPart]) -> set[int]:
    """The joints of the root part, of the parts and of all above, in parts and in skeleton."""
    everything = subject.rig.parts
    found = {0, *(everything.index(part) for part in parts)}
    for _ in everything:
        for number in list(found):
            found.add(max(everything[number].parent, 0))
            for joint in everything[number].joints:
                parent = int(subject.rig.skeleton.parents[joint])
                found |= {n for n, part in enumerate(everything) if parent in part.joints}
    return {joint for number in found for joint in everything[number].joints}


@given(st.one_of(recipes(), MARKS), st.booleans())
@settings(max_examples=60, deadline=None)
def test_previews_need_the_prefix_only(recipe: Recipe | Marks, patterns: bool) -> None:
    subject = bench_of(recipe, patterns)
    data = subject.encoder().encode(subject.clip, subject.rig, 0).data
    whole = unpack(data)
    assert whole.residual is not None
    prefix = unpack(data[: len(data) - len(whole.residual)], prefix_only=True)
    preview = decode(prefix, subject.rig, subject.codebook, tier="preview")
    full = decode(whole, subject.rig, subject.codebook)
    root = subject.rig.parts[0]
    assert preview.frames == subject.clip.frames
    if isinstance(full, MarkerClip):
        assert isinstance(preview, MarkerClip)
        assert np.array_equal(preview.seen, full.seen)
        a, b = preview.positions[:, root.joints], full.positions[:, root.joints]
        assert np.array_equal(a, b, equal_nan=True)
    else:
        assert isinstance(preview, SkeletonClip)
        assert np.array_equal(preview.translations[:, 0], full.translations[:, 0])
        assert np.abs(preview.rotations[:, 0] - full.rotations[:, 0]).max(initial=0) < 1e-12
        oracle.of_clip(preview)  # proper rotations
    with pytest.raises(UsageError, match="preview layer"):
        decode(prefix, subject.rig, subject.codebook)


def test_previews_of_known_patterns_look_like_the_clip() -> None:
    """The clip's own segments as patterns: off by a hand's breadth, not by a body's."""
    subject = skeleton_bench(Recipe(3, joints=12, frames=120, motion="smooth"), patterns=True)
    index = unpack(subject.encoder().encode(subject.clip, subject.rig, 0).data)
    preview = decode(index, subject.rig, subject.codebook, tier="preview")
    strange = replace(subject.codebook, patterns=skeleton_bench(Recipe(3, 12)).codebook.patterns)
    other = Bench(subject.clip, subject.rig, strange)
    still = unpack(other.encoder().encode(other.clip, other.rig, 0).data)
    blank = decode(still, subject.rig, strange, tier="preview")
    assert (
        oracle.clip_error(subject.clip, preview).mean()
        < 0.3 * oracle.clip_error(subject.clip, blank).mean()
    )


def test_unknown_parts_are_named() -> None:
    subject = skeleton_bench(Recipe(1, joints=5, frames=4))
    index = unpack(subject.encoder().encode(subject.clip, subject.rig, 0).data)
    with pytest.raises(UsageError, match=r"no body part tail.*Choose from root"):
        decode(index, subject.rig, subject.codebook, parts=["tail"])


FRESH_PROCESS = """
import hashlib, sys
import numpy as np
from clips import Recipe, marker_bench, skeleton_bench
from motifold.codec.version1.decode import decode
from motifold.codec.version1.index_file import unpack
from motifold.codec.version1.layers import group_channels, read_preview, read_rest
from motifold.codec.patterns.segments import most_frames

digest = hashlib.blake2b()
for subject in (
    skeleton_bench(Recipe(3, joints=25, frames=150, hinges=0.2, stretchy=0.2), patterns=True),
    skeleton_bench(Recipe(4, joints=25, frames=150, motion="spin"), patterns=True),
    marker_bench(3, 30, 150, patterns=True),
):
    data = subject.encoder().encode(subject.clip, subject.rig, 0).data
    index, rig, codebook = unpack(data), subject.rig, subject.codebook
    preview, root = read_preview(index.preview, rig, codebook, index.frames, most_frames(
        rig.frame_time))
    rest = read_rest(index.residual, index.frames, group_channels(codebook, preview.frame)[1:])
    decoded = decode(index, rig, codebook)
    values = decoded.positions if rig.kind == "markers" else decoded.rotations
    for array in (root, *rest, values):
        digest.update(array.tobytes())
    digest.update(data)
print(digest.hexdigest())
"""


def test_threads_do_not_change_a_bit() -> None:
    printed = set()
    for threads in "12":
        names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
        environment = {**os.environ, **dict.fromkeys(names, threads)}
        environment["PYTHONPATH"] = os.path.dirname(__file__)  # noqa: PTH120
        done = subprocess.run(
            [sys.executable, "-c", FRESH_PROCESS],
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
        printed.add(done.stdout.strip())
    assert len(printed) == 1
    assert len(printed.pop()) == 128
