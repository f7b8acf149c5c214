"""What models are learned from is what the encoder has left to code, recall and all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from clips import Recipe, bench, random_parts, skeleton_clip

from motifold.codec.blocks.motionmodel import WEIGHT_BITS, MotionModel, fixed_model
from motifold.codec.blocks.nodes import FOLLOWER, KIND, ROW
from motifold.codec.blocks.startpose import usual_pose
from motifold.codec.clip import FloatArray, SkeletonClip
from motifold.codec.figure.bodyparts import BodyPart, body_parts
from motifold.codec.geometry.limits import uniform_limits
from motifold.codec.learned.gathering import gathered
from motifold.codec.learned.learning import learn
from motifold.codec.learned.predictorfit import products_of
from motifold.codec.learned.rehearsal import Rehearsal
from motifold.codec.learned.samples import Manner, Sample
from motifold.codec.version2.motiongoal import goal_of
from motifold.workflows.synthetic import synthetic_clip

STEP = 1 << 23  # half a centimetre


def takes_of(clip: SkeletonClip, parts: tuple[BodyPart, ...], each: int) -> list[Sample]:
    """Pieces of a clip, to learn from."""
    whole = bench(clip, parts)
    samples = []
    for start in range(0, clip.frames, each):
        piece = clip.slice(start, min(start + each, clip.frames))
        limits = uniform_limits(piece, 1.0)
        goal = goal_of(piece, whole.rig, whole.codebook.family, limits)
        samples.append(Sample(goal.path, goal.path[:1], goal.nodes, goal.yardstick))
    return samples


def coefficients(rehearsal: Rehearsal, at: int, state: object, model: MotionModel) -> FloatArray:
    """What is left to code, in steps: (nodes, blocks, channels)."""
    sample = rehearsal.samples[at]
    xs, ys = gathered(sample, np.asarray(state), model, rehearsal.others(at), STEP / (1 << 24))
    rows = sample.nodes.table[:, ROW]
    weights = model.weights[rows] / float(1 << WEIGHT_BITS)
    missed = ys - np.einsum("nbf,nfc->nbc", xs, weights)
    along = np.einsum("nbc,nkc->nbk", missed * (1 << 20), model.analysis[rows])
    return np.asarray(along / (1 << 10) / STEP)


@pytest.mark.parametrize("span", [4, 8])
@pytest.mark.parametrize("action", ["walk", "wave", "walk-turn"])
def test_what_is_fitted_is_what_was_left_to_code(span: int, action: str) -> None:
    """Rounded without thrift, half a step and some rounding away from it; also with references."""
    clip = synthetic_clip(7, action, 1, "normal", 1, seconds=5.0)
    samples = takes_of(clip, body_parts(clip.skeleton), clip.frames // 3)[:3]
    model = fixed_model(2 * clip.skeleton.joints, span)
    manner = Manner(STEP, 0.0)
    alone = Rehearsal(samples, [[1, 2], [0, 2], [0, 1]])
    states = list(alone.walk(model, manner, lambda at, walk: walk.state[: len(samples[at].goal)]))
    for rehearsal in (alone, replace(alone, states=states)):
        for at, walk in rehearsal.walk(model, manner, lambda at, walk: (at, walk)):
            left = coefficients(rehearsal, at, walk.state, model)
            whole = left.shape[1]
            coded = samples[at].nodes.table[:, KIND] != FOLLOWER
            chosen = walk.quantised[:whole].transpose(1, 0, 2)
            assert np.abs(left - chosen)[coded].max(initial=0.0) < 0.6


def test_every_twelfth_sample_is_alone_and_the_others_see_theirs() -> None:
    clip = skeleton_clip(Recipe(3, joints=4, frames=260))
    samples = takes_of(clip, random_parts(3, 4), 20)
    neighbours = [[(at + 1) % 13] for at in range(13)]
    rehearsal = Rehearsal(samples, neighbours)
    assert not any(rehearsal.others(at) for at in range(13))
    states = [sample.goal for sample in samples]
    rehearsal = replace(rehearsal, states=states)
    assert [bool(rehearsal.others(at)) for at in range(13)] == [False, *[True] * 11, False]
    assert rehearsal.others(4)[0][1] is states[5]
    assert [len(poses) > 0 for poses in rehearsal.poses(8)] == [False, *[True] * 11, False]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_few_wild_blocks_do_not_decide(seed: int) -> None:
    """A model learned with one clip of noise among nine serves the nine about as well."""
    clip, parts = skeleton_clip(Recipe(seed, joints=6, frames=900)), random_parts(seed, 6)
    whole, good = bench(clip, parts), takes_of(clip, parts, 100)
    recipe = Recipe(seed, joints=6, frames=100, motion="noise")
    wild = takes_of(skeleton_clip(recipe), parts, 100)
    begin, manner = fixed_model(12, 4), Manner(1 << 21, 0.1)
    usual = usual_pose(whole.rig, whole.codebook.family)

    def bits(samples: list[Sample]) -> float:
        """What the nine cost with a model learned from ``samples``."""
        neighbours = [[(at + 1) % 9, (at + 4) % 9] for at in range(len(samples))]
        first = products_of(Rehearsal(samples, neighbours), begin, manner)
        model, known = learn(first, begin, manner, usual)
        costs = list(known.walk(model, manner, lambda _, walk: float(walk.costs.sum())))
        return sum(costs[:9])

    assert bits([*good, *wild]) < 1.1 * bits(good)
