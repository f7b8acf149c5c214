"""Clips through the encoder and back, measured by an oracle that shares no code with it."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import oracle
import pytest
from clips import (
    MARKS,
    Bench,
    Marks,
    Recipe,
    bench,
    bench_of,
    marker_bench,
    random_parts,
    recipes,
    skeleton_bench,
    skeleton_clip,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from motifold.codec.clip import Clip, MarkerClip, SkeletonClip
from motifold.codec.errors import GuaranteeError, UnsupportedError
from motifold.codec.geometry.rotations import from_euler, to_euler
from motifold.codec.patterns.segments import SegmentRules
from motifold.codec.version1 import encode
from motifold.codec.version1.decode import decode
from motifold.codec.version1.encode import Encoded
from motifold.codec.version1.index_file import unpack

TOLERANCES = st.sampled_from([0.01, 0.1, 1.0])
SEEDS = st.integers(0, 2**32 - 1)
ROUNDING = 1e-6  # centimetres


def assert_kept(subject: Bench, tolerance: float) -> tuple[Encoded, Clip]:
    """Encode, decode, and hold the result to the tolerance and to its own certificate."""
    made = subject.encoder(tolerance).encode(subject.clip, subject.rig, 12)
    index = unpack(made.data)
    assert (index.rig, index.generation, index.frames) == (12, 3, subject.clip.frames)
    assert index.certificate == made.certificate
    decoded = decode(index, subject.rig, subject.codebook)
    assert type(decoded) is type(subject.clip)
    assert decoded.frame_time == subject.clip.frame_time
    assert decoded.layout == subject.clip.layout
    errors = oracle.clip_error(subject.clip, decoded)
    certificate = made.certificate
    assert certificate.maximum <= tolerance
    assert errors.max(initial=0.0) <= certificate.maximum + ROUNDING
    if errors.size:
        assert errors.mean() <= certificate.mean + ROUNDING
        assert np.percentile(errors, 99) <= certificate.percentile_99 + ROUNDING
        # and it is no idle promise: what is certified was measured
        assert certificate.maximum <= errors.max() * (1 + 1e-6) + ROUNDING
    return made, decoded


@given(recipes(), TOLERANCES, st.booleans())
@settings(max_examples=120, deadline=None)
@example(Recipe(joints=30, frames=30, motion="spin", tree="chain", bone=300.0), 0.01, True)
@example(Recipe(joints=30, frames=30, motion="creep", tree="chain", stretchy=1.0), 0.01, False)
@example(Recipe(joints=20, frames=1, motion="teleport", hinges=1.0), 0.1, True)
@example(Recipe(joints=20, frames=0, stretchy=1.0), 0.1, True)
@example(Recipe(joints=1, frames=2, motion="noise", rate=240.0), 1.0, False)
def test_skeletons_stay_inside_their_tolerance(
    recipe: Recipe, tolerance: float, patterns: bool
) -> None:
    subject = skeleton_bench(recipe, patterns)
    _, decoded = assert_kept(subject, tolerance)
    assert isinstance(decoded, SkeletonClip)
    assert decoded.rotations.shape == subject.clip.rotations.shape  # type: ignore[union-attr]
    assert decoded.skeleton is subject.rig.skeleton


@given(MARKS, TOLERANCES, st.booleans())
@settings(max_examples=80, deadline=None)
@example(Marks(1, 10, 0, 0.9, "smooth"), 0.1, True)
@example(Marks(1, 10, 1, 0.9, "smooth"), 0.1, True)
def test_markers_stay_inside_their_tolerance_and_keep_their_gaps(
    marks: Marks, tolerance: float, patterns: bool
) -> None:
    subject = bench_of(marks, patterns)
    _, decoded = assert_kept(subject, tolerance)
    assert isinstance(decoded, MarkerClip)
    assert decoded.names == subject.clip.names  # type: ignore[union-attr]


@pytest.mark.parametrize("motion", ["smooth", "noise", "still", "spin", "teleport"])
@pytest.mark.parametrize("tolerance", [0.01, 0.1, 1.0])
def test_long_clips_of_every_kind(motion: str, tolerance: float) -> None:
    frames = 3000 if motion == "still" else 600
    recipe = Recipe(7, joints=15, frames=frames, motion=motion, rate=240.0)
    made, _ = assert_kept(skeleton_bench(recipe), tolerance)
    if motion == "still":
        assert len(made.data) < 1500


def test_a_chain_of_creeping_joints_is_kept() -> None:
    """What each joint may neglect adds up: 30 joints stretch together, each a hair."""
    clip = skeleton_clip(Recipe(1, joints=30, frames=40, tree="chain", stretchy=1.0))
    for tolerance in (0.01, 0.1, 1.0):
        hair = 0.9 * min(0.1 * tolerance, 0.02)
        course = hair * np.sin(np.arange(40.0))
        translations = clip.skeleton.offsets + course[:, None, None] * np.ones((30, 3))
        stiff = np.tile(np.eye(3), (40, 30, 1, 1))
        subject = replace(clip, rotations=stiff, translations=translations)
        assert_kept(bench(subject, random_parts(1, 30)), tolerance)


def test_hinges_move_only_as_their_channels_can() -> None:
    subject = skeleton_bench(Recipe(9, joints=20, frames=40, hinges=1.0))
    _, decoded = assert_kept(subject, 0.5)
    assert isinstance(decoded, SkeletonClip)
    hinged = 0
    for joint, names in enumerate(decoded.layout.channels):
        order = "".join(name[0] for name in names if name.endswith("rotation"))
        local = decoded.rotations[:, joint]
        if len(order) < 3:
            hinged += 1
            assert np.abs(from_euler(order, to_euler(order, local)) - local).max() < 1e-9
    assert hinged > 10


def test_patterns_that_fit_jerky_motion_make_files_smaller() -> None:
    """Every frame elsewhere, in segments of 16 frames at the most: only patterns predict it."""
    clip = skeleton_clip(Recipe(3, joints=20, frames=200, motion="still", rate=10.0))
    shake = np.random.default_rng(0).normal(size=(200 * 20, 3)) * 0.3
    turns = Rotation.from_rotvec(shake).as_matrix().reshape(200, 20, 3, 3)
    jerky = replace(clip, rotations=clip.rotations @ turns)
    parts, rules = random_parts(3, 20), SegmentRules(least_seconds=0.8)
    plain, _ = assert_kept(bench(jerky, parts, rules=rules), 1.0)
    known, _ = assert_kept(bench(jerky, parts, patterns=True, rules=rules), 1.0)
    assert len(known.data) < len(plain.data)


@given(st.one_of(recipes(), MARKS), st.booleans())
@settings(max_examples=40, deadline=None)
def test_encoding_is_deterministic_and_survives_pickling(
    recipe: Recipe | Marks, patterns: bool
) -> None:
    subject = bench_of(recipe, patterns)
    encoder = subject.encoder()
    first = encoder.encode(subject.clip, subject.rig, 5)
    assert encoder.encode(subject.clip, subject.rig, 5).data == first.data
    travelled = pickle.loads(pickle.dumps(encoder))
    assert travelled.encode(subject.clip, subject.rig, 5).data == first.data
    assert len(pickle.dumps(encoder)) < 2 * len(pickle.dumps(travelled)) + 1


def test_used_patterns_are_those_of_the_segments() -> None:
    subject = skeleton_bench(Recipe(3, joints=12, frames=120), patterns=True)
    made = subject.encoder().encode(subject.clip, subject.rig, 0)
    for part, used, table in zip(
        subject.rig.parts, made.used_patterns, subject.codebook.patterns, strict=True
    ):
        if part.parent < 0:
            assert not len(used)
        else:  # every segment is a pattern itself
            assert np.array_equal(used, np.arange(len(table)))


def test_fisher_rules_are_kept_too() -> None:
    subject = skeleton_bench(Recipe(3, joints=12, frames=120), patterns=True)
    encoder = replace(subject.encoder(), rules=SegmentRules(method="fisher"))
    made = encoder.encode(subject.clip, subject.rig, 0)
    decoded = decode(unpack(made.data), subject.rig, subject.codebook)
    assert oracle.clip_error(subject.clip, decoded).max() <= 0.1


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e8])
def test_impossible_positions_are_refused(value: float) -> None:
    clip = skeleton_clip(Recipe(1, joints=3, frames=5))
    clip.translations[2, 0, 1] = value
    subject = Bench(clip, *_parts_of(skeleton_bench(Recipe(1, joints=3, frames=5))))
    with pytest.raises(UnsupportedError, match="positions reach"):
        subject.encoder().encode(clip, subject.rig, 0)
    huge = replace(clip.skeleton, end_offsets=clip.skeleton.end_offsets + value)
    subject = Bench(skeleton_clip(Recipe(1, joints=3, frames=5)), subject.rig, subject.codebook)
    with pytest.raises(UnsupportedError, match="positions reach"):
        subject.encoder().encode(
            replace(subject.clip, skeleton=huge),  # type: ignore[arg-type]
            subject.rig,
            0,
        )


def _parts_of(subject: Bench) -> tuple:  # type: ignore[type-arg]
    return subject.rig, subject.codebook


def test_a_clip_of_no_markers_is_refused() -> None:
    subject = marker_bench(1, 1, 5)
    assert isinstance(subject.clip, MarkerClip)
    nothing = replace(subject.clip, names=(), positions=np.zeros((5, 0, 3)))
    with pytest.raises(UnsupportedError, match="no joints or markers"):
        bench(nothing, ()).encoder().encode(nothing, subject.rig, 0)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, 1e-13, float("nan")])
def test_tolerances_that_cannot_be_kept_are_refused(tolerance: float) -> None:
    for subject in (skeleton_bench(Recipe(1)), marker_bench(1, 5, 20)):
        with pytest.raises(GuaranteeError):
            subject.encoder(tolerance).encode(subject.clip, subject.rig, 0)


@pytest.mark.parametrize("markers", [False, True])
def test_nothing_is_certified_that_does_not_decode(
    markers: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The encoder believes the decoder only: one that is off by a millimetre is caught."""

    def off(*arguments: Any, **options: Any) -> Clip:
        clip = decode(*arguments, **options)
        if isinstance(clip, MarkerClip):
            return replace(clip, positions=clip.positions + 0.1)
        return replace(clip, translations=clip.translations + 0.1)

    subject = marker_bench(1, 5, 20) if markers else skeleton_bench(Recipe(1))
    monkeypatch.setattr(encode, "decode", off)
    with pytest.raises(GuaranteeError, match="the decoded clip is"):
        subject.encoder(0.1).encode(subject.clip, subject.rig, 0)


def test_jumps_too_large_for_the_tolerance_are_refused() -> None:
    subject = marker_bench(1, 3, 400, gaps=0.0, motion="still")
    assert isinstance(subject.clip, MarkerClip)
    subject.clip.positions[300:, 0] = 9e6
    with pytest.raises(GuaranteeError, match="larger tolerance"):
        subject.encoder(1e-9).encode(subject.clip, subject.rig, 0)
    assert_kept(subject, 1e-4)


def test_rotations_that_the_channels_cannot_make_are_refused() -> None:
    clip = skeleton_clip(Recipe(1, joints=4, frames=10))
    channels = (clip.layout.channels[0], (), (), ())
    bent = replace(clip, layout=replace(clip.layout, channels=channels))
    subject = bench(bent, random_parts(1, 4))
    with pytest.raises(GuaranteeError, match="no quantiser step"):
        subject.encoder().encode(bent, subject.rig, 0)
