"""Words of motion: what they must not depend on, and what they must."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from libraries import short_specs
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

from motifold.catalog.bodysignals import PARTS, Signals, body_signals, mirror_signs, resampled
from motifold.catalog.vocabulary import (
    COLUMNS,
    NO_WORD,
    POSTURE_COLUMNS,
    WORDS,
    Vocabulary,
    features_of,
    kind_of,
    learn_vocabulary,
    part_of,
)
from motifold.codec.clip import SkeletonClip
from motifold.codec.figure.bodyparts import body_parts

CLIPS = [spec.clip() for spec in short_specs(10)]


def signals_of(clip: SkeletonClip) -> Signals:
    return body_signals(clip, body_parts(clip.skeleton))


SIGNALS = [signals_of(clip) for clip in CLIPS]
VOCABULARY = learn_vocabulary(SIGNALS)


def moved(clip: SkeletonClip, turn: float, shift: tuple[float, float]) -> SkeletonClip:
    """Return a clip turned about the vertical, radians, and moved over the floor, centimetres."""
    matrix = Rotation.from_euler("Y", turn).as_matrix()
    rotations, translations = clip.rotations.copy(), clip.translations.copy()
    rotations[:, 0] = matrix @ rotations[:, 0]
    translations[:, 0] = translations[:, 0] @ matrix.T + [shift[0], 0.0, shift[1]]
    return replace(clip, rotations=rotations, translations=translations)


@settings(max_examples=20, deadline=None)
@given(
    st.integers(0, len(CLIPS) - 1),
    st.floats(-7.0, 7.0),
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
)
def test_neither_place_nor_heading_matters(
    number: int, turn: float, shift: tuple[float, float]
) -> None:
    again = signals_of(moved(CLIPS[number], turn, shift))
    for part, signal in SIGNALS[number].items():
        assert np.allclose(again[part], signal, atol=1e-6), part


def test_every_part_of_a_body_has_signals_of_one_length() -> None:
    for clip, signals in zip(CLIPS, SIGNALS, strict=True):
        assert tuple(signals) == PARTS
        lengths = {len(signal) for signal in signals.values()}
        assert lengths == {round((clip.frames - 1) * clip.frame_time * 10) + 1}


def test_a_bigger_body_moves_alike() -> None:
    clip = CLIPS[0]
    skeleton = replace(
        clip.skeleton,
        offsets=1.5 * clip.skeleton.offsets,
        end_offsets=1.5 * clip.skeleton.end_offsets,
    )
    giant = replace(clip, skeleton=skeleton, translations=1.5 * clip.translations)
    for part, signal in signals_of(giant).items():
        assert np.allclose(signal, SIGNALS[0][part], atol=1e-6), part


@given(st.integers(1, 40), st.integers(2, 12), st.integers(0, 2**32 - 1))
def test_resampling_takes_the_mean_of_the_frames_about(frames: int, width: int, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(frames, 2, 3))
    expected = uniform_filter1d(points, width, axis=0, mode="nearest")[::width]
    found = resampled(points, 1.0 / (10.0 * width))
    assert np.allclose(found[: len(expected)], expected[: len(found)], atol=1e-9)


def test_words_are_the_nearest_centres() -> None:
    said = VOCABULARY.words_of(SIGNALS[0])
    for number, column in enumerate(COLUMNS):
        features = features_of(column, SIGNALS[0][part_of(column)])
        centres = VOCABULARY.centres[kind_of(column)]
        gaps = np.linalg.norm(features[:, None] - centres[None], axis=2)
        chosen = gaps[np.arange(len(said)), said[:, number]]
        assert np.allclose(chosen, gaps.min(axis=1), atol=1e-6)


def test_learning_twice_gives_the_same_words() -> None:
    again = learn_vocabulary(SIGNALS)
    for kind, centres in VOCABULARY.centres.items():
        assert np.array_equal(centres, again.centres[kind])


def test_a_vocabulary_survives_its_arrays() -> None:
    again = Vocabulary.from_arrays(VOCABULARY.to_arrays())
    assert np.array_equal(again.words_of(SIGNALS[3]), VOCABULARY.words_of(SIGNALS[3]))


def test_growing_only_appends() -> None:
    rng = np.random.default_rng(0)
    strange = {part: 200.0 * rng.normal(size=(600, s.shape[1])) for part, s in SIGNALS[0].items()}
    grown = VOCABULARY.grown([strange])
    for kind, centres in VOCABULARY.centres.items():
        assert np.array_equal(grown.centres[kind][: len(centres)], centres)
    assert sum(grown.sizes.values()) > sum(VOCABULARY.sizes.values())
    assert VOCABULARY.grown(SIGNALS).sizes == VOCABULARY.sizes


def test_the_mirror_image_of_limbs_is_exact() -> None:
    """The words of a motion seen in a mirror, computed the long way round."""
    swap = {"left": "right", "right": "left"}
    image = {}
    for part, signal in SIGNALS[1].items():
        side, _, limb = part.partition("_")
        other = f"{swap[side]}_{limb}" if limb else part
        image[other] = signal * mirror_signs(part, signal.shape[1])
    seen = VOCABULARY.words_of({part: image[part] for part in PARTS})
    made = VOCABULARY.mirrored(VOCABULARY.words_of(SIGNALS[1]))
    limbs = [
        number for number, column in enumerate(COLUMNS) if "_arm" in column or "_leg" in column
    ]
    assert np.array_equal(made[:, limbs], seen[:, limbs])


def test_softness_is_a_share_of_few_neighbours() -> None:
    soft = VOCABULARY.softness("arm", WORDS)
    assert np.allclose(soft.sum(axis=1), 1.0)
    assert ((soft > 0).sum(axis=1) <= 8).all()
    assert (soft.argmax(axis=1) == np.arange(len(soft))).all()


@pytest.mark.parametrize("missing", ["left_arm", "root"])
def test_a_part_that_a_body_lacks_has_no_word(missing: str) -> None:
    signals = {part: signal for part, signal in SIGNALS[0].items() if part != missing}
    said = VOCABULARY.words_of(signals)
    about = np.array([part_of(column) == missing for column in COLUMNS])
    assert (said[:, about] == NO_WORD).all()
    assert (said[:, ~about] != NO_WORD).all()


def test_amplitudes_are_the_deviations_of_what_words_stand_for() -> None:
    said = [VOCABULARY.words_of(signals) for signals in SIGNALS[:3]]
    said[1] = VOCABULARY.words_of({p: s for p, s in SIGNALS[1].items() if p != "left_arm"})
    starts = np.cumsum([0, *(len(each) for each in said)])
    found = VOCABULARY.amplitudes(np.concatenate(said), starts)
    for clip, words in enumerate(said):
        for place, column in enumerate(POSTURE_COLUMNS):
            named = words[:, COLUMNS.index(column)]
            expected = 0.0
            if NO_WORD not in named:
                points = VOCABULARY.centres[kind_of(column)][named]
                expected = np.sqrt(points.var(axis=0).sum())
            assert np.isclose(found[clip, place], expected, atol=1e-3)
