"""Leads: a clip that goes as another one goes costs next to nothing, and any lead is harmless."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from clips import elsewhere, every_second, family_of
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.blocks.leads import Lead
from motifold.codec.blocks.motionmodel import MotionModel, fixed_model, usual_span
from motifold.codec.blocks.offered import Reference, reference_of
from motifold.codec.clip import SkeletonClip
from motifold.codec.figure.bodyparts import body_parts
from motifold.codec.figure.rig import Family, Rig, rig_of
from motifold.codec.geometry.limits import Bounds, Limits, limits_of, uniform_limits
from motifold.codec.geometry.metrics import measure
from motifold.codec.version2.leadfinding import Hint, find_leads
from motifold.codec.version2.motiondecode import decode_motion
from motifold.codec.version2.motionencode import EncodedMotion, MotionEncoder
from motifold.codec.version2.motionfile import unpack_motion
from motifold.codec.version2.motiongoal import goal_of
from motifold.codec.version2.motionhead import Named
from motifold.workflows.synthetic import synthetic_clip

TOLERANCE = 0.1


@cache
def take(action: str = "walk", number: int = 1) -> SkeletonClip:
    return synthetic_clip(7, action, 1, "normal", number, seconds=6.0)


@dataclass(frozen=True, eq=False)
class Desk:
    """A rig at work, with one archived clip."""

    rig: Rig
    family: Family
    model: MotionModel
    reference: Reference

    @property
    def encoder(self) -> MotionEncoder:
        return MotionEncoder(self.family, self.model, 0)

    def encode(
        self, clip: SkeletonClip, hints: list[Hint], limits: Limits | None = None
    ) -> EncodedMotion:
        limits = limits or uniform_limits(clip, TOLERANCE)
        return self.encoder.encode(clip, self.rig, 0, limits, [(Named(5), self.reference)], hints)

    def decode(self, data: bytes) -> SkeletonClip:
        known = (self.rig, self.family, self.model, [self.reference])
        found = decode_motion(unpack_motion(data), *known)
        assert isinstance(found, SkeletonClip)
        return found

    def leads(self, clip: SkeletonClip, hint: Hint) -> tuple[Lead, ...]:
        goal = goal_of(clip, self.rig, self.family, uniform_limits(clip, TOLERANCE))
        track = self.reference.track
        return find_leads(goal.path, goal.nodes, [track], [hint], self.model.span, TOLERANCE)


@cache
def desk() -> Desk:
    clip = take()
    rig = rig_of(clip, body_parts(clip.skeleton))
    family = family_of(clip, rig)
    model = fixed_model(2 * rig.skeleton.joints, usual_span(rig.frame_time), hinged=family.hinged)
    made = MotionEncoder(family, model, 0).encode(clip, rig, 0, uniform_limits(clip, TOLERANCE))
    return Desk(rig, family, model, reference_of(made.states, made.nodes, model))


def excerpt(clip: SkeletonClip) -> SkeletonClip:
    return clip.slice(41, 147)


COPIES: dict[str, tuple[Callable[[SkeletonClip], SkeletonClip], Hint, float]] = {
    "same": (lambda clip: clip, Hint(0, 0, 1), 0.06),
    "excerpt": (excerpt, Hint(0, 41, 1), 0.15),
    "half the rate": (lambda clip: every_second(clip, 1), Hint(0, 1, 2), 0.1),
    "elsewhere": (elsewhere, Hint(0, 0, 1), 0.15),
}


@pytest.mark.parametrize("kind", COPIES)
@pytest.mark.parametrize("off", [-1, 0, 1])
def test_copies_cost_next_to_nothing(kind: str, off: int) -> None:
    """Beside what they cost without leads; hints may be off by a stride."""
    copy, hint, share = COPIES[kind]
    clip = copy(take())
    hint = replace(hint, shift=hint.shift + off * hint.stride)
    led, alone = desk().encode(clip, [hint]), desk().encode(clip, [])
    assert unpack_motion(led.data).led
    assert len(led.data) < share * len(alone.data)
    errors = measure(clip, desk().decode(led.data))
    assert errors.maximum <= TOLERANCE
    assert errors.maximum <= led.certificate.maximum


@pytest.mark.parametrize("mean", [0.005, 0.02, 0.1])
def test_mean_bounds_hold_for_copies(mean: float) -> None:
    """Also where the reference was less exact than the copy is to be."""
    clip = excerpt(take())
    limits = limits_of(clip, Bounds(tolerance=1.0, mean=mean))
    made = desk().encode(clip, [Hint(0, 41, 1)], limits)
    assert measure(clip, desk().decode(made.data)).mean <= mean


@pytest.mark.parametrize("hint", [Hint(0, 3, 1), Hint(0, 60, 1), Hint(0, -500, 1), Hint(0, 0, 3)])
def test_a_wrong_hint_changes_nothing(hint: Hint) -> None:
    clip = take("wave", 2)
    assert desk().leads(clip, hint) == ()
    assert desk().encode(clip, [hint]).data == desk().encode(clip, []).data


def test_a_lead_is_where_the_clip_goes_so() -> None:
    """Another motion, then the walk from its frame 30 on, then the other motion."""
    other, walk = take("wave", 2), take()
    clip = replace(
        walk,
        rotations=np.concatenate(
            [other.rotations[:50], walk.rotations[30:90], other.rotations[50:90]]
        ),
        translations=np.concatenate(
            [other.translations[:50], walk.translations[30:90], other.translations[50:90]]
        ),
    )
    (lead,) = desk().leads(clip, Hint(0, -20, 1))
    assert (lead.first, lead.stop, lead.start) == (50, 110, 30)
    assert lead.move is None
    assert unpack_motion(desk().encode(clip, [Hint(0, -20, 1)]).data).led


def test_a_figure_elsewhere_is_moved() -> None:
    (lead,) = desk().leads(elsewhere(take()), Hint(0, 0, 1))
    assert (lead.first, lead.frames) == (0, take().frames)
    assert lead.move is not None
    np.testing.assert_allclose(np.array(lead.move[:3]) / 2**20, [0.0, 2.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(np.array(lead.move[3:]) / 2**10, [300.0, 0.0, -50.0], atol=0.3)


@st.composite
def any_leads(draw: st.DrawFn, frames: int, known: int) -> tuple[Lead, ...]:
    """Leads of a clip of so many frames by a reference of ``known``."""
    borders = sorted(draw(st.sets(st.integers(0, frames), min_size=2, max_size=8)))
    return tuple(
        Lead(
            0,
            first,
            stop - first,
            draw(st.integers(0, known - 1)),
            draw(st.integers(1, 9)),
            draw(st.none() | st.tuples(*[st.integers(-(2**23), 2**23)] * 6)),
        )
        for first, stop in zip(borders[::2], borders[1::2], strict=False)
    )


@given(any_leads(90, 180), st.sampled_from([0.02, 0.5]))
@settings(max_examples=25, deadline=None)
def test_the_tolerance_holds_whatever_leads_say(leads: tuple[Lead, ...], tolerance: float) -> None:
    clip = take("jump", 3).slice(0, 90)
    known = [(Named(5), desk().reference)]
    limits = uniform_limits(clip, tolerance)
    made = desk().encoder.encode_led(clip, desk().rig, 0, limits, known, leads)
    found = desk().decode(made.data)
    assert measure(clip, found).maximum <= tolerance
    again = desk().encoder.encode_led(clip, desk().rig, 0, limits, known, leads)
    assert again.data == made.data
