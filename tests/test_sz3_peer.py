"""SZ3's side of the comparison: its channels hold the whole motion, its errors are inside."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import numpy as np
import pytest
from clips import Recipe, recipes, skeleton_clip, skeleton_of
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import of_clip, shell_error
from scipy.spatial.transform import Rotation
from sz3_peer import (
    LEVERS,
    channels_of,
    load_sz3,
    reach_levers,
    smallest_inside,
    through_sz3,
    unwrapped,
)

from motifold.codec.formats.bvh import format_bvh, parse_bvh
from motifold.workflows.synthetic import synthetic_clip


@given(recipes(12, 40), st.sampled_from(sorted(LEVERS)))
@settings(max_examples=40)
def test_the_channels_hold_the_whole_motion(recipe: Recipe, kind: str) -> None:
    clip = skeleton_clip(recipe)
    if clip.frames == 0:
        return
    channels = channels_of(clip, 1e-6, kind)
    back = channels.posed(channels.values)
    assert shell_error(of_clip(clip), of_clip(back)).max(initial=0.0) < 1e-4


@given(st.integers(0, 2**32 - 1), st.floats(0.01, 1.0))
def test_unwrapping_keeps_the_turns_and_does_not_jump(seed: int, pace: float) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    angles = rng.uniform(0.5, 2.5) + pace * np.arange(60)
    turns = Rotation.from_rotvec(angles[:, None] * axis)
    vectors = unwrapped(turns.as_rotvec()[:, None])[:, 0]
    assert (Rotation.from_rotvec(vectors) * turns.inv()).magnitude().max() < 1e-9
    steps = np.linalg.norm(np.diff(vectors, axis=0), axis=1)
    assert np.abs(steps - pace).max() < 1e-6


@given(recipes(20, 1))
def test_reach_is_that_of_the_longest_chain(recipe: Recipe) -> None:
    skeleton = skeleton_of(recipe)
    lengths = np.linalg.norm(skeleton.offsets, axis=1)
    wanted = np.zeros(skeleton.joints)
    ends = zip(skeleton.end_parents, np.linalg.norm(skeleton.end_offsets, axis=1), strict=True)
    for joint, travelled in [*((j, 0.0) for j in range(skeleton.joints)), *ends]:
        while joint >= 0:
            wanted[joint] = max(wanted[joint], travelled)
            travelled += lengths[joint]
            joint = skeleton.parents[joint]
    assert np.allclose(reach_levers(skeleton) ** 2, 9.0 + wanted**2)


def test_without_pysz_one_is_told_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pysz", None)
    with pytest.raises(SystemExit, match="pip install pysz"):
        load_sz3()


def test_sz3_keeps_its_bound() -> None:
    pysz = pytest.importorskip("pysz")
    values = np.cumsum(np.random.default_rng(0).normal(size=(50, 7)), axis=0)
    sizes = []
    for bound in (1e-3, 1e-1):
        size, back = through_sz3(pysz, values, bound)
        assert back.shape == values.shape
        assert np.abs(back - values).max() <= bound
        sizes.append(size)
    assert sizes[1] < sizes[0] < values.nbytes


@pytest.mark.parametrize("kind", sorted(LEVERS))
def test_the_search_ends_just_inside(kind: str, tmp_path: Path) -> None:
    pysz = pytest.importorskip("pysz")
    source = tmp_path / "walk.bvh"
    source.write_bytes(format_bvh(synthetic_clip(0, "walk", 1, "normal", 1, seconds=2.0)))
    found = smallest_inside((source, 0.1, kind))
    clip = parse_bvh(source.read_bytes())
    channels = channels_of(clip, 0.1, kind)
    size, values = through_sz3(pysz, channels.values, found.bound)
    largest = shell_error(of_clip(clip), of_clip(channels.posed(values))).max()
    assert size == found.bytes
    assert largest == pytest.approx(found.largest, abs=1e-9)
    assert 0.08 < largest <= 0.1
    assert found.joint_count == clip.frames * clip.skeleton.joints
    assert 0 < found.joint_sum / found.joint_count < largest
