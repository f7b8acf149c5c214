"""A seeded library of synthetic motion: for the demo, and as a load for benchmarks.

Every clip depends only on the seed and its own specification, so that a library of 1,000 clips
starts with the library of 100.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..codec.clip import FloatArray, Layout, SkeletonClip
from ..codec.errors import UsageError
from ..codec.formats.bvh import format_bvh
from ..codec.geometry.rotations import about_axis, from_axis_angle
from .gaits import run, turn, walk, walk_turn
from .gestures import idle, jump, reach, sit, wave
from .performers import JOINTS, STYLES, Motion, Performer, Style, ease, performer, smooth_noise

Action = Callable[[Performer, Style, np.random.Generator, FloatArray], Motion]

# the places in ACTIONS and STYLES seed the generators: append, never reorder
ACTIONS: dict[str, Action] = {
    "walk": walk,
    "run": run,
    "reach": reach,
    "wave": wave,
    "turn": turn,
    "idle": idle,
    "walk-turn": walk_turn,
    "sit": sit,
    "jump": jump,
}
ACTORS = 8
_RETAKES = 3  # in a row, before the plan goes on to the next action
_SHORTEST, _LONGEST = 2.0, 600.0  # seconds
_LEGS = [joint for joint, name in enumerate(JOINTS) if name.endswith(("Leg", "Foot", "ToeBase"))]


@dataclass(frozen=True)
class SyntheticSpec:
    """All that a synthetic clip depends on. ``seconds`` long, ``rate`` frames per second."""

    seed: int
    action: str
    actor: int
    style: str
    take: int
    seconds: float
    rate: float

    @property
    def name(self) -> str:
        """File name without suffix, such as ``walk_tired_actor2_take03``."""
        return f"{self.action}_{self.style}_actor{self.actor}_take{self.take:02d}"

    def clip(self) -> SkeletonClip:
        """Return the clip."""
        return synthetic_clip(
            self.seed,
            self.action,
            self.actor,
            self.style,
            self.take,
            seconds=self.seconds,
            rate=self.rate,
        )


def synthetic_clip(
    seed: int,
    action: str,
    actor: int,
    style: str,
    take: int,
    *,
    seconds: float | None = None,
    rate: float = 30.0,
) -> SkeletonClip:
    """Return one take of ``actor`` (1, 2, …) doing ``action`` in ``style``.

    The same arguments give the same clip on the same machine. Takes of one actor, action and
    style share the rig and the actor's habits, and differ in timing, size and phase.
    ``seconds`` is drawn from 2 to 8 when not given. Raises UsageError for unknown names, negative
    numbers, and lengths outside 2 to 600 s or rates outside 10 to 480 frames per second.
    """
    _check(action, style, actor=actor, take=take, seed=seed)
    place = (list(ACTIONS).index(action), list(STYLES).index(style))
    if seconds is None:
        seconds = _length(_generator(seed, 3, actor, take, *place))
    if not (_SHORTEST <= seconds <= _LONGEST and 10.0 <= rate <= 480.0):
        raise UsageError(
            f"{seconds} s at {rate} frames per second",
            advice=f"Ask for {_SHORTEST:g} to {_LONGEST:g} s at 10 to 480 frames per second",
        )
    body = performer(_generator(seed, 0, actor))
    habit = STYLES[style].habit(_generator(seed, 1, actor, *place), 0.05)
    rng = _generator(seed, 2, actor, take, *place)
    times = np.arange(round(seconds * rate)) / rate
    motion = ACTIONS[action](body, habit.habit(rng, 0.015), rng, times)
    motion = _placed(rng, _as_captured(rng, times, habit, motion))
    translations = np.repeat(body.skeleton.offsets[None], times.size, axis=0)
    translations[:, 0] = motion.root
    turns = ("Zrotation", "Xrotation", "Yrotation")
    channels = (("Xposition", "Yposition", "Zposition", *turns), *[turns] * (len(JOINTS) - 1))
    layout = Layout("bvh", "cm", "given", 1.0, channels)
    return SkeletonClip(body.skeleton, 1.0 / rate, motion.rotations, translations, layout)


def plan_library(clips: int, seed: int = 0) -> list[SyntheticSpec]:
    """Return the plan of a library of ``clips``: balanced over actions, actors and styles.

    Three takes of a performance, then the next action; every action meets every actor in every
    style before more retakes follow. About one clip in ten has 60 or 120 frames per second. The
    plan of a smaller library is the start of a larger one's. Raises UsageError for negative
    numbers.
    """
    if clips < 0 or seed < 0:
        raise UsageError(f"a library of {clips} clips, seed {seed}", advice="Count from 0")
    shuffle = _generator(seed, 4)
    actions, styles = shuffle.permutation(list(ACTIONS)), shuffle.permutation(list(STYLES))
    actors = shuffle.permutation(ACTORS) + 1
    plan = []
    for index in range(clips):
        rest, retake = divmod(index, _RETAKES)
        rest, action = divmod(rest, len(actions))
        rest, column = divmod(rest, ACTORS)
        encore, row = divmod(rest, len(styles))
        draw = _generator(seed, 5, index)
        spec = SyntheticSpec(
            seed,
            str(actions[action]),
            int(actors[(column + action) % ACTORS]),
            str(styles[(row + column) % len(styles)]),
            1 + encore * _RETAKES + retake,
            _length(draw),
            float(draw.choice([30.0, 60.0, 120.0], p=[0.9, 0.08, 0.02])),
        )
        plan.append(spec)
    return plan


def write_library(
    folder: Path,
    clips: int,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> list[Path]:
    """Write the BVH files of `plan_library` into ``folder`` and return their paths.

    ``progress`` is called with the number of files written and of all files. Files of the same
    names are replaced.
    """
    plan = plan_library(clips, seed)
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for done, spec in enumerate(plan, 1):
        path = folder / f"{spec.name}.bvh"
        path.write_bytes(format_bvh(spec.clip()))
        paths.append(path)
        if progress:
            progress(done, clips)
    return paths


def _generator(*key: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(key)))


def _length(rng: np.random.Generator) -> float:
    return round(_SHORTEST + 6.0 * float(rng.beta(1.4, 2.6)), 2)


def _check(action: str, style: str, **numbers: int) -> None:
    for kind, name, known in (("action", action, ACTIONS), ("style", style, STYLES)):
        if name not in known:
            raise UsageError(f"unknown {kind} {name!r}", advice=f"Use one of {', '.join(known)}")
    for kind, number in numbers.items():
        if number < 0:
            raise UsageError(f"{kind} {number} is negative", advice="Count from 0")


def _as_captured(
    rng: np.random.Generator, times: FloatArray, style: Style, motion: Motion
) -> Motion:
    """Return the motion as a capture system sees it.

    Slow wander of the upper body by about a degree, which no plan explains; sensor noise of
    0.03 degrees and 0.02 cm below some 7 Hz; in one clip of five, a marker that slips and turns
    a joint by up to half a degree.
    """
    joints = len(JOINTS)
    wander = 1.1 * np.sqrt(style.energy) * smooth_noise(rng, times, 0.7, 3 * joints)
    turns = wander.reshape(-1, joints, 3)
    turns[:, [0, *_LEGS]] = 0.0  # planted feet stay planted
    turns += 0.03 * smooth_noise(rng, times, 0.07, 3 * joints).reshape(-1, joints, 3)
    if rng.random() < 0.2:
        onset, lasting = rng.uniform(0.1, 0.8) * times[-1], rng.uniform(0.3, 2.0)
        slip = ease((times - onset) / lasting)[:, None] * rng.uniform(-0.3, 0.3, 3)
        turns[:, int(rng.integers(1, joints))] += slip
    rotations = motion.rotations @ from_axis_angle(np.radians(turns))
    return Motion(rotations, motion.root + 0.02 * smooth_noise(rng, times, 0.07, 3))


def _placed(rng: np.random.Generator, motion: Motion) -> Motion:
    """Return the motion somewhere in the room, facing anywhere."""
    turn = about_axis(1, rng.uniform(-np.pi, np.pi, 1))[0]
    rotations = motion.rotations.copy()
    rotations[:, 0] = turn @ rotations[:, 0]
    start = np.array([rng.uniform(-150.0, 150.0), 0.0, rng.uniform(-150.0, 150.0)])
    return Motion(rotations, motion.root @ turn.T + start)
