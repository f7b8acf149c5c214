"""Random skeletons, clips and codebooks for the codec's tests.

Hypothesis draws a `Recipe` (a few numbers, which shrink well); the arrays come from a seeded
generator, so that an example is quick to make and always the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from motifold.codec.blocks.leads import Lead
from motifold.codec.clip import Clip, FloatArray, Layout, MarkerClip, Skeleton, SkeletonClip
from motifold.codec.figure.bodyparts import BodyPart
from motifold.codec.figure.jointnames import other_side
from motifold.codec.figure.rig import Family, Rig, bends_of, bone_means, found_family, rig_of
from motifold.codec.geometry.kinematics import world_rotations
from motifold.codec.patterns.patterns import Codebook, to_coefficients
from motifold.codec.patterns.segments import SegmentRules, clip_segments
from motifold.codec.patterns.signals import relative_rotations
from motifold.codec.version1.encode import Encoder

RULES = SegmentRules()
POSITIONS = ("Xposition", "Yposition", "Zposition")
MOTIONS = ("smooth", "noise", "still", "spin", "teleport", "creep")
TREES = ("tree", "chain", "star")


@dataclass(frozen=True)
class Recipe:
    """What a random skeleton clip is made from; see `skeleton_clip`."""

    seed: int = 0
    joints: int = 8
    frames: int = 40
    motion: str = "smooth"
    tree: str = "tree"
    bone: float = 20.0  # centimetres; 0 for none
    hinges: float = 0.0  # share of joints with fewer than three rotation channels
    stretchy: float = 0.0  # share of joints whose translation moves
    rate: float = 30.0


def recipes(most_joints: int = 30, most_frames: int = 60) -> st.SearchStrategy[Recipe]:
    """Recipes of any kind of skeleton clip."""
    return st.builds(
        Recipe,
        seed=st.integers(0, 2**32 - 1),
        joints=st.integers(1, most_joints),
        frames=st.integers(0, most_frames),
        motion=st.sampled_from(MOTIONS),
        tree=st.sampled_from(TREES),
        bone=st.sampled_from([0.0, 0.01, 20.0, 300.0]),
        hinges=st.sampled_from([0.0, 0.3, 1.0]),
        stretchy=st.sampled_from([0.0, 0.3, 1.0]),
        rate=st.sampled_from([10.0, 30.0, 120.0, 240.0]),
    )


@dataclass(frozen=True)
class Marks:
    """What a random marker clip is made from; see `marker_bench`."""

    seed: int
    markers: int
    frames: int
    gaps: float
    motion: str


MARKS = st.builds(
    Marks,
    st.integers(0, 2**32 - 1),
    st.integers(1, 20),
    st.integers(0, 60),
    st.sampled_from([0.0, 0.3, 0.9]),
    st.sampled_from(MOTIONS),
)


def skeleton_of(recipe: Recipe) -> Skeleton:
    """Return the recipe's skeleton, with some zero offsets and some end sites."""
    rng = np.random.default_rng([recipe.seed, 0])
    parents = [-1]
    for joint in range(1, recipe.joints):
        near = {"tree": int(rng.integers(max(0, joint - 4), joint)), "chain": joint - 1, "star": 0}
        parents.append(near[recipe.tree])
    offsets = rng.normal(size=(recipe.joints, 3)) * recipe.bone / np.sqrt(3)
    offsets[rng.random(recipe.joints) < 0.15] = 0.0
    ends = np.array([joint for joint in range(recipe.joints) if joint not in parents], np.int64)
    names = tuple(f"joint{joint}" for joint in range(recipe.joints))
    end_offsets = rng.normal(size=(len(ends), 3)) * recipe.bone / 3
    return Skeleton(names, np.array(parents, np.int64), offsets, ends, end_offsets)


def skeleton_clip(recipe: Recipe) -> SkeletonClip:
    """Return the recipe's clip: every joint moves as its channels allow."""
    rng = np.random.default_rng([recipe.seed, 1])
    skeleton, frames = skeleton_of(recipe), recipe.frames
    channels: list[tuple[str, ...]] = []
    rotations = np.empty((frames, skeleton.joints, 3, 3))
    translations = np.repeat(skeleton.offsets[None], frames, axis=0)
    for joint in range(skeleton.joints):
        order = "".join(rng.permutation(list("XYZ")))
        if rng.random() < recipe.hinges:
            order = order[: rng.integers(0, 3)]
        stretches = joint == 0 or rng.random() < recipe.stretchy
        turns = tuple(f"{axis}rotation" for axis in order)
        channels.append((*(POSITIONS if stretches else ()), *turns))
        rotations[:, joint] = _local_rotations(rng, recipe, joint, order)
        if stretches:
            size = 100.0 if joint == 0 else recipe.bone / 10
            translations[:, joint] += size * _course(rng, recipe, 3)
    if recipe.motion == "teleport" and frames:
        translations[rng.integers(frames) :, 0] += rng.normal(size=3) * 1e5
    layout = Layout("bvh", "cm", "given", 1.0, tuple(channels))
    return SkeletonClip(skeleton, 1.0 / recipe.rate, rotations, translations, layout)


def _course(rng: np.random.Generator, recipe: Recipe, width: int) -> FloatArray:
    """Return a course (frames, width) of a size of about 1."""
    time = np.arange(recipe.frames)[:, None] / recipe.rate
    waves = np.sin(2 * np.pi * rng.uniform(0.1, 2.0, width) * time + rng.uniform(0, 6, width))
    if recipe.motion == "still":
        return np.zeros((recipe.frames, width))
    if recipe.motion == "noise":
        return np.asarray(waves + 0.05 * rng.normal(size=waves.shape))
    if recipe.motion == "creep":  # less than anybody sees, on every joint
        return np.asarray(waves * 10.0 ** rng.uniform(-6, -2))
    return np.asarray(waves)


def _local_rotations(
    rng: np.random.Generator, recipe: Recipe, joint: int, order: str
) -> FloatArray:
    frames = recipe.frames
    if not frames or not order:
        return np.tile(np.eye(3), (frames, 1, 1))
    rest = rng.normal(size=3) if rng.random() < 0.5 else np.zeros(3)
    angles = rest + _course(rng, recipe, 3)
    if recipe.motion == "spin" and (joint == 0 or rng.random() < 0.3):
        speed = rng.uniform(-12.0, 12.0)  # radians per second, about the first axis
        angles[:, 0] += speed * np.arange(frames) / recipe.rate
    if len(order) == 3 and recipe.motion != "spin":
        return np.asarray(Rotation.from_rotvec(angles).as_matrix())
    out = Rotation.from_euler(order[0], angles[:, :1])
    for number, axis in enumerate(order[1:], 1):
        out = out * Rotation.from_euler(axis, angles[:, number, None])
    return np.asarray(out.as_matrix())


def random_parts(seed: int, count: int, first_at_root: bool = True) -> tuple[BodyPart, ...]:
    """Return body parts of ``count`` joints at random: a part's joints need not be neighbours.

    With ``first_at_root`` joint 0 is in the root part, as `bodyparts` and the format have it.
    """
    rng = np.random.default_rng([seed, 2])
    wanted = int(rng.integers(1, min(count, 6) + 1))
    owner = rng.integers(0, wanted, count)
    if first_at_root:
        owner[0] = 0
    parts: list[BodyPart] = []
    for number in [0, *sorted(set(owner.tolist()) - {0})]:
        joints = tuple(np.flatnonzero(owner == number).tolist())
        if not joints:
            continue
        parent = int(rng.integers(0, len(parts))) if parts else -1
        name = f"part{number}" if parts else "root"
        parts.append(BodyPart(name, joints, parent, int(rng.choice(joints))))
    return tuple(parts)


def marker_clip(
    seed: int, markers: int, frames: int, gaps: float = 0.2, motion: str = "smooth"
) -> MarkerClip:
    """Return a clip of markers with gaps of all kinds: short, long, at the ends, for ever."""
    rng = np.random.default_rng([seed, 3])
    recipe = Recipe(frames=frames, motion=motion, rate=120.0)
    positions = np.repeat(rng.normal(size=(1, markers, 3)) * 50, frames, axis=0)
    for marker in range(markers):
        positions[:, marker] += 30 * _course(rng, recipe, 3)
        while frames and rng.random() < gaps:
            start, stop = np.sort(rng.integers(0, frames + 1, 2))
            positions[start:stop, marker] = np.nan
        if rng.random() < gaps / 5:
            positions[:, marker] = np.nan
    names = tuple(f"M{marker}" for marker in range(markers))
    return MarkerClip(names, 1 / 120.0, positions, Layout("trc", "mm", "declared", 0.1))


def family_of(clip: Clip, rig: Rig, head_diagonal: float = 20.0) -> Family:
    """Return the family that a clip's rig founds, with the clip's own usual orientations."""
    joints = rig.skeleton.joints
    if isinstance(clip, MarkerClip):
        return found_family(
            rig, np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)), head_diagonal
        )
    usual, bones = np.tile(np.eye(3), (joints, 1, 1)), rig.skeleton.offsets
    bends = bends_of(clip.rotations)
    if clip.frames:
        world = world_rotations(clip.skeleton, clip.rotations)
        for part in rig.parts:
            usual[list(part.joints)] = relative_rotations(rig.parts, part, world).mean(axis=0)
        bones = bone_means(clip)
    return found_family(rig, usual, bones, bends, head_diagonal)


@dataclass(frozen=True, eq=False)
class Bench:
    """A clip with all that it takes to encode and decode it."""

    clip: Clip
    rig: Rig
    codebook: Codebook
    rules: SegmentRules = RULES

    def encoder(self, tolerance: float = 0.1, radius: float = 8.0) -> Encoder:
        """Return an encoder of generation 3."""
        return Encoder(self.codebook, 3, tolerance, radius, self.rules)


def bench(
    clip: Clip,
    parts: tuple[BodyPart, ...],
    patterns: bool = False,
    rules: SegmentRules = RULES,
) -> Bench:
    """Return the bench of a clip; with ``patterns`` its own segments are the patterns."""
    rig = rig_of(clip, parts)
    codebook = Codebook.empty(family_of(clip, rig))
    if patterns:
        own = clip_segments(clip, codebook.family, rules)
        tables = [
            table if segments is None else to_coefficients(segments.points)
            for table, segments in zip(codebook.patterns, own, strict=True)
        ]
        codebook = replace(codebook, patterns=tuple(tables))
    return Bench(clip, rig, codebook, rules)


def skeleton_bench(recipe: Recipe, patterns: bool = False) -> Bench:
    """Return the bench of a recipe's clip under random body parts."""
    clip = skeleton_clip(recipe)
    return bench(clip, random_parts(recipe.seed, recipe.joints), patterns)


def marker_bench(
    seed: int,
    markers: int,
    frames: int,
    gaps: float = 0.2,
    motion: str = "smooth",
    patterns: bool = False,
) -> Bench:
    """Return the bench of a random marker clip under random body parts."""
    clip = marker_clip(seed, markers, frames, gaps, motion)
    return bench(clip, random_parts(seed, markers, first_at_root=False), patterns)


def bench_of(recipe: Recipe | Marks, patterns: bool) -> Bench:
    """Return the bench of a recipe of either kind."""
    if isinstance(recipe, Recipe):
        return skeleton_bench(recipe, patterns)
    return marker_bench(
        recipe.seed, recipe.markers, recipe.frames, recipe.gaps, recipe.motion, patterns
    )


def leads_among(seed: int, references: int, frames: int) -> tuple[Lead, ...]:
    """Return leads that need not make sense, for a clip whose references are as long."""
    rng = np.random.default_rng(seed)
    count = min(2 * int(rng.integers(1, 4)), 2 * ((frames + 1) // 2))
    borders = np.sort(rng.choice(frames + 1, count, replace=False))
    leads = []
    for first, stop in zip(borders[::2].tolist(), borders[1::2].tolist(), strict=False):
        reference, start, stride = rng.integers((0, 0, 1), (references, frames, 4)).tolist()
        move = tuple(rng.integers(-(10**6), 10**6, 6).tolist()) if rng.integers(2) else None
        leads.append(Lead(reference, first, stop - first, start, stride, move))
    return tuple(leads)


def noisy(clip: SkeletonClip, degrees: float) -> SkeletonClip:
    """Return the same clip with noise in every joint and frame."""
    rng = np.random.default_rng(0)
    count = clip.frames * clip.skeleton.joints
    off = Rotation.from_rotvec(np.radians(degrees) * rng.normal(size=(count, 3))).as_matrix()
    return replace(clip, rotations=clip.rotations @ off.reshape(clip.rotations.shape))


def elsewhere(clip: SkeletonClip) -> SkeletonClip:
    """Return the same motion turned by two radians about y, then moved by (300, 0, -50) cm."""
    turn = Rotation.from_rotvec([0.0, 2.0, 0.0]).as_matrix()
    rotations, translations = clip.rotations.copy(), clip.translations.copy()
    rotations[:, 0] = turn @ rotations[:, 0]
    translations[:, 0] = translations[:, 0] @ turn.T + np.array([300.0, 0.0, -50.0])
    return replace(clip, rotations=rotations, translations=translations)


def in_mirror(clip: SkeletonClip) -> SkeletonClip:
    """Return the image of a clip whose joints all have the axes of the world at rest."""
    names = [name.lower() for name in clip.skeleton.names]
    partner = [names.index(other_side(name)) for name in clip.skeleton.names]
    glass = np.array([-1.0, 1.0, 1.0])
    return replace(
        clip,
        rotations=np.diag(glass) @ clip.rotations[:, partner] @ np.diag(glass),
        translations=clip.translations[:, partner] * glass,
    )


def every_second(clip: SkeletonClip, first: int = 0) -> SkeletonClip:
    """Return every second frame of a clip, at half its frame rate."""
    return replace(
        clip,
        rotations=clip.rotations[first::2],
        translations=clip.translations[first::2],
        frame_time=2 * clip.frame_time,
    )
