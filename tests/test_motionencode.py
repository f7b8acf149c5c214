"""Clips through the codec of version 2 and back, measured by an oracle that shares no code."""

from __future__ import annotations

import hashlib
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from functools import lru_cache

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

from motifold.codec.blocks.motionmodel import MotionModel, fixed_model, usual_span
from motifold.codec.blocks.offered import Reference, reference_of
from motifold.codec.blocks.startpose import usual_pose
from motifold.codec.clip import Clip, MarkerClip, SkeletonClip
from motifold.codec.errors import DamagedError, GuaranteeError, UnsupportedError, UsageError
from motifold.codec.geometry.limits import Bounds, Limits, limits_of, uniform_limits
from motifold.codec.learned.learning import learn
from motifold.codec.learned.modelfile import read_model, write_model
from motifold.codec.learned.predictorfit import products_of
from motifold.codec.learned.rehearsal import Rehearsal
from motifold.codec.learned.samples import Manner, Sample
from motifold.codec.version2.motiondecode import decode_motion, decode_states
from motifold.codec.version2.motionencode import EncodedMotion, MotionEncoder
from motifold.codec.version2.motionfile import unpack_motion
from motifold.codec.version2.motiongoal import goal_of
from motifold.codec.version2.motionhead import Named

TOLERANCES = st.sampled_from([0.01, 0.1, 1.0])
ROUNDING = 1e-6  # centimetres
THOUSANDTH = 2 ** (1 / 1000)  # how much they may overstate the largest error
OCTAVE = 2 ** (1 / 16)  # how much index files may overstate mean and percentile


def model_for(subject: Bench) -> MotionModel:
    hinged = subject.codebook.family.hinged
    span = usual_span(subject.rig.frame_time)
    return fixed_model(2 * subject.rig.skeleton.joints, span, hinged=hinged)


def coded(
    subject: Bench,
    limits: Limits,
    model: MotionModel | None = None,
    references: tuple[tuple[Named, Reference], ...] = (),
) -> tuple[EncodedMotion, Clip]:
    model = model or model_for(subject)
    family = subject.codebook.family
    encoder = MotionEncoder(family, model, 0)
    made = encoder.encode(subject.clip, subject.rig, 12, limits, references)
    known = [reference for _, reference in references]
    return made, decode_motion(unpack_motion(made.data), subject.rig, family, model, known)


def assert_kept(
    subject: Bench,
    tolerance: float,
    mean: float | None = None,
    model: MotionModel | None = None,
    references: tuple[tuple[Named, Reference], ...] = (),
) -> tuple[EncodedMotion, Clip]:
    limits = uniform_limits(subject.clip, tolerance, mean)
    made, decoded = coded(subject, limits, model, references)
    assert type(decoded) is type(subject.clip)
    assert decoded.frame_time == subject.clip.frame_time
    assert decoded.layout == subject.clip.layout
    errors = oracle.clip_error(subject.clip, decoded)
    certificate = made.certificate
    assert certificate.maximum <= tolerance
    assert errors.max(initial=0.0) <= certificate.maximum + ROUNDING
    if errors.size:
        assert errors.mean() <= certificate.mean + ROUNDING
        if isinstance(subject.clip, MarkerClip):  # the oracle has zeros in gaps
            errors = errors[subject.clip.seen]
        if not errors.size:
            return made, decoded
        assert certificate.mean <= errors.mean() * OCTAVE + ROUNDING
        assert np.percentile(errors, 99) <= certificate.percentile_99 + ROUNDING
        assert certificate.maximum <= errors.max() * THOUSANDTH + ROUNDING
        if mean is not None:
            assert errors.mean() <= mean + ROUNDING
    return made, decoded


@given(recipes(), TOLERANCES)
@settings(max_examples=100, deadline=None)
@example(Recipe(joints=30, frames=30, motion="spin", tree="chain", bone=300.0), 0.01)
@example(Recipe(joints=30, frames=30, motion="creep", tree="chain", stretchy=1.0), 0.01)
@example(Recipe(joints=20, frames=1, motion="teleport", hinges=1.0), 0.1)
@example(Recipe(joints=20, frames=0, stretchy=1.0), 0.1)
@example(Recipe(joints=1, frames=2, motion="noise", rate=240.0), 1.0)
@example(Recipe(joints=12, frames=60, motion="teleport", stretchy=0.3), 0.01)
@example(Recipe(175, 25, 2, "creep", tree="chain", hinges=0.3, stretchy=0.3, rate=10.0), 0.01)
def test_skeletons_stay_inside_their_tolerance(recipe: Recipe, tolerance: float) -> None:
    subject = skeleton_bench(recipe)
    _, decoded = assert_kept(subject, tolerance)
    assert isinstance(decoded, SkeletonClip)
    assert decoded.rotations.shape == subject.clip.rotations.shape  # type: ignore[union-attr]


@given(MARKS, TOLERANCES)
@settings(max_examples=60, deadline=None)
@example(Marks(1, 10, 0, 0.9, "smooth"), 0.1)
@example(Marks(1, 10, 1, 0.9, "smooth"), 0.1)
def test_markers_stay_inside_their_tolerance_and_keep_their_gaps(
    marks: Marks, tolerance: float
) -> None:
    subject = bench_of(marks, False)
    _, decoded = assert_kept(subject, tolerance)
    assert isinstance(decoded, MarkerClip)
    assert isinstance(subject.clip, MarkerClip)
    np.testing.assert_array_equal(decoded.seen, subject.clip.seen)


def test_errors_do_not_add_up_along_a_chain() -> None:
    """Each joint makes up for those above: the end is no worse off than the middle."""
    middle, end = [], []
    for seed in range(4):
        subject = skeleton_bench(Recipe(seed, joints=16, frames=60, tree="chain"))
        _, decoded = coded(subject, uniform_limits(subject.clip, 3.0, 0.2))
        errors = oracle.clip_error(subject.clip, decoded).mean(axis=0)
        middle.append(errors[6:10])
        end.append(errors[-4:])
    assert np.mean(end) < 1.25 * np.mean(middle)  # 1.65 when each aimed at its own orientation


@given(st.one_of(recipes(20), MARKS), st.sampled_from([0.003, 0.03, 0.3]))
@settings(max_examples=40, deadline=None)
@example(Recipe(65775, joints=13, frames=2, motion="creep", tree="chain", rate=24.0), 0.3)
def test_the_mean_is_kept(recipe: Recipe | Marks, mean: float) -> None:
    assert_kept(bench_of(recipe, False), 100 * mean, mean)


@pytest.mark.parametrize("motion", ["smooth", "noise", "still", "spin", "teleport"])
@pytest.mark.parametrize("tolerance", [0.01, 0.1, 1.0])
def test_long_clips_of_every_kind(motion: str, tolerance: float) -> None:
    frames = 10_000 if motion == "still" else 1500
    recipe = Recipe(7, joints=15, frames=frames, motion=motion, rate=240.0)
    made, _ = assert_kept(skeleton_bench(recipe), tolerance)
    if motion == "still":
        assert len(made.data) < 4000


@given(recipes(12, 40), TOLERANCES)
@settings(max_examples=30, deadline=None)
def test_encoding_what_was_decoded_is_stable(recipe: Recipe, tolerance: float) -> None:
    """A copy of a copy is inside the tolerance of the copy, and no larger to speak of."""
    subject = skeleton_bench(recipe)
    first, decoded = assert_kept(subject, tolerance)
    again = replace(subject, clip=decoded)
    second, _ = assert_kept(again, tolerance)
    assert len(second.data) <= 1.5 * len(first.data) + 50


@given(recipes(10, 40))
@settings(max_examples=25, deadline=None)
def test_the_same_bytes_come_from_the_same_clip(recipe: Recipe) -> None:
    subject = skeleton_bench(recipe)
    limits = uniform_limits(subject.clip, 0.1)
    encoder = MotionEncoder(subject.codebook.family, model_for(subject), 0)
    first = encoder.encode(subject.clip, subject.rig, 5, limits).data
    travelled = pickle.loads(pickle.dumps(encoder))
    assert travelled.encode(subject.clip, subject.rig, 5, limits).data == first


@given(st.one_of(recipes(10, 40), MARKS), st.integers(0, 10**6))
@settings(max_examples=40, deadline=None)
def test_any_truncation_is_told(recipe: Recipe | Marks, cut: int) -> None:
    subject = bench_of(recipe, False)
    made, _ = coded(subject, uniform_limits(subject.clip, 0.1))
    data = made.data[: cut % len(made.data)]
    with pytest.raises(DamagedError):
        unpack_motion(data)
    try:
        prefix = unpack_motion(data, prefix_only=True)
    except DamagedError:
        return
    family, model = subject.codebook.family, model_for(subject)
    shown = decode_motion(prefix, subject.rig, family, model, (), core_only=True)
    assert shown.frames == subject.clip.frames


def test_joints_and_spans_keep_bounds_of_their_own() -> None:
    subject = skeleton_bench(Recipe(5, joints=12, frames=90))
    bounds = Bounds(1.0, None, (("joint7", 0.02),), ((1.0, 1.5, 0.05),))
    made, decoded = coded(subject, limits_of(subject.clip, bounds))
    errors = oracle.clip_error(subject.clip, decoded)
    assert errors.max() <= made.certificate.maximum + ROUNDING <= 1.0 + ROUNDING
    assert errors[:, 7].max() <= 0.02
    assert errors[30:46].max() <= 0.05
    plain, _ = coded(subject, uniform_limits(subject.clip, 1.0))
    tight, _ = coded(subject, uniform_limits(subject.clip, 0.02))
    assert len(plain.data) < len(made.data) < len(tight.data)


@given(recipes(20), st.integers(0, 19), st.sampled_from([0.02, 0.2, 5.0, 50.0]))
@settings(max_examples=30, deadline=None)
def test_a_joint_keeps_its_own_bound_and_the_others_theirs(
    recipe: Recipe, joint: int, own: float
) -> None:
    subject = skeleton_bench(recipe)
    name = f"joint{joint % recipe.joints}"
    _, decoded = coded(subject, limits_of(subject.clip, Bounds(1.0, None, ((name, own),))))
    allowed = np.ones(recipe.joints + len(subject.rig.skeleton.end_parents))
    owners = [*subject.rig.skeleton.names]
    owners += [owners[carrier] for carrier in subject.rig.skeleton.end_parents]
    allowed[[owner == name for owner in owners]] = own
    assert (oracle.clip_error(subject.clip, decoded) <= allowed + ROUNDING).all()


def test_close_bounds_cost_what_they_are_for() -> None:
    """One arm of eight, or a tenth of the time, is not the price of the whole clip."""
    subject = skeleton_bench(Recipe(3, joints=9, frames=300, tree="star"))
    sizes = [
        len(coded(subject, limits_of(subject.clip, bounds))[0].data)
        for bounds in (
            Bounds(1.0),
            Bounds(1.0, None, (("joint4", 0.05),)),
            Bounds(1.0, None, (), ((1.0, 2.0, 0.05),)),
            Bounds(0.05),
        )
    ]
    plain, joint, span, tight = sizes
    assert plain < joint < plain + 0.5 * (tight - plain)
    assert plain < span < plain + 0.25 * (tight - plain)


def reference_to(made: EncodedMotion, model: MotionModel) -> Reference:
    return reference_of(made.states, made.nodes, model)


def test_a_clip_like_another_costs_less_with_it_as_reference() -> None:
    clip = skeleton_clip(Recipe(11, joints=14, frames=200))
    parts = random_parts(11, 14)
    subject = bench(clip, parts)
    model = model_for(subject)
    alone, _ = assert_kept(subject, 0.1)
    noise = np.random.default_rng(3).normal(size=clip.translations[:, :1].shape) * 0.02
    shifted = clip.translations.copy()
    shifted[:, :1] += noise + 30.0
    other = replace(subject, clip=replace(clip, translations=shifted))
    references = ((Named(4), reference_to(alone, model)),)
    without, _ = assert_kept(other, 0.1)
    with_it, decoded = assert_kept(other, 0.1, references=references)
    assert len(with_it.data) < 0.85 * len(without.data)
    file = unpack_motion(with_it.data)
    with pytest.raises(UsageError, match="references"):
        decode_states(file, subject.rig, subject.codebook.family, model, ())
    preview = decode_motion(
        file, subject.rig, subject.codebook.family, model, [references[0][1]], core_only=True
    )
    assert np.median(oracle.clip_error(decoded, preview)) < 15.0


@lru_cache(maxsize=1)
def learned() -> tuple[tuple[Bench, ...], MotionModel]:
    """Takes of one figure, and the model that they teach."""
    clip = skeleton_clip(Recipe(21, joints=9, frames=900))
    whole = bench(clip, random_parts(21, 9))
    family = whole.codebook.family
    takes = tuple(replace(whole, clip=clip.slice(start, start + 90)) for start in range(0, 900, 90))
    samples = []
    for take in takes:
        limits = uniform_limits(take.clip, 0.1)
        goal = goal_of(take.clip, take.rig, family, limits)
        samples.append(Sample(goal.path, goal.path[:1], goal.nodes, goal.yardstick))
    neighbours = [[(at + 1) % 10, (at + 4) % 10] for at in range(10)]
    begin = fixed_model(18, 4)
    manner = Manner(int(0.11 * 2**24), 0.11)
    first = products_of(Rehearsal(samples, neighbours), begin, manner)
    model, _ = learn(first, begin, manner, usual_pose(whole.rig, family))
    return takes, model


def test_a_learned_model_saves_bytes_and_keeps_the_tolerance() -> None:
    takes, model = learned()
    plain = sum(len(assert_kept(take, 0.1)[0].data) for take in takes)
    better = sum(len(assert_kept(take, 0.1, model=model)[0].data) for take in takes)
    assert better < 0.9 * plain
    assert (model.weights == read_model(write_model(model)).weights).all()


def test_whole_numbers_decide_on_any_linear_algebra() -> None:
    """Decoded states are equal in processes with other threads, kernels and no compiler.

    Plain Python's whole numbers do not overflow, and its loops know no vector instructions:
    what it decodes is what the format says.
    """
    found = {}
    variants = {
        "as it is": {},
        "four threads": {"OPENBLAS_NUM_THREADS": "4", "OMP_NUM_THREADS": "4"},
        "old kernels": {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3"},
        "no compiler": {"NUMBA_DISABLE_JIT": "1"},
    }
    for name, setting in variants.items():
        done = subprocess.run(
            [sys.executable, "-W", "ignore", __file__],
            env={**os.environ, **setting},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr[-2000:]
        found[name] = done.stdout.split()[-1]
    assert len(set(found.values())) == 1, found


def digest_of_states() -> str:
    """Return the digest of decoded states of clips with references, printed by this file."""
    digest = hashlib.blake2b(digest_size=16)
    for seed, motion in ((1, "smooth"), (2, "spin"), (3, "teleport")):
        clip = skeleton_clip(Recipe(seed, joints=6, frames=30, motion=motion, stretchy=0.3))
        subject = bench(clip, random_parts(seed, 6))
        model, family = model_for(subject), subject.codebook.family
        first, _ = coded(subject, uniform_limits(clip, 0.5))
        known = reference_to(first, model)
        second, _ = coded(subject, uniform_limits(clip, 0.1), references=((Named(0), known),))
        for data, references in ((first.data, []), (second.data, [known])):
            digest.update(data)
            decoded = decode_states(unpack_motion(data), subject.rig, family, model, references)
            for state in decoded.states:
                digest.update(state.astype("<i8").tobytes())
    return digest.hexdigest()


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e8])
def test_impossible_positions_are_refused(value: float) -> None:
    subject = skeleton_bench(Recipe(1, joints=3, frames=5))
    assert isinstance(subject.clip, SkeletonClip)
    subject.clip.translations[2, 0, 1] = value
    with pytest.raises(UnsupportedError, match="positions reach"):
        coded(subject, uniform_limits(subject.clip, 0.1))


def test_rotations_that_the_channels_cannot_make_are_refused() -> None:
    clip = skeleton_clip(Recipe(1, joints=4, frames=10))
    channels = (clip.layout.channels[0], (), (), ())
    bent = replace(clip, layout=replace(clip.layout, channels=channels))
    with pytest.raises(GuaranteeError, match="no quantiser step"):
        coded(bench(bent, random_parts(1, 4)), uniform_limits(bent, 0.1))


def test_gaps_cost_almost_nothing() -> None:
    whole = marker_bench(3, 12, 400, gaps=0.0)
    assert isinstance(whole.clip, MarkerClip)
    positions = whole.clip.positions.copy()
    positions[100:200, :6] = np.nan
    holed = replace(whole, clip=replace(whole.clip, positions=positions))
    full, _ = assert_kept(whole, 0.1)
    less, _ = assert_kept(holed, 0.1)
    assert len(less.data) < 1.02 * len(full.data)


if __name__ == "__main__":
    print(digest_of_states())
