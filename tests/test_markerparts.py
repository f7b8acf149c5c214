"""The hierarchy of marker sets: planted rigid bodies, known names, awkward sets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from library import library_path

from motifold.codec.figure.bodyparts import BodyPart
from motifold.codec.figure.markerparts import cluster_markers, marker_parts
from motifold.codec.formats.c3d_file import parse_c3d
from motifold.codec.formats.trc import parse_trc
from motifold.codec.geometry.rotations import from_axis_angle

SIDES = "SHO UPA ELB FRM WRA WRB FIN THI KNE TIB ANK HEE TOE".split()  # noqa: SIM905
CORE = (
    *("LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAK LASI RASI LPSI RPSI".split()),  # noqa: SIM905
    *(side + name for side in "LR" for name in SIDES),
)


def wandering(random: np.random.Generator, sizes: list[int], frames: int = 60) -> np.ndarray:
    """Rigid bodies that turn and drift by themselves; (frames, sum of sizes, 3) centimetres."""
    bodies = []
    for size in sizes:
        shape = random.uniform(-8, 8, (size, 3))
        turns = from_axis_angle(np.cumsum(random.normal(0, 0.2, (frames, 3)), axis=0))
        path = random.uniform(-60, 60, 3) + np.cumsum(random.normal(0, 3, (frames, 3)), axis=0)
        bodies.append(np.einsum("fij,mj->fmi", turns, shape) + path[:, None])
    return np.concatenate(bodies, axis=1)


def groups(parts: tuple[BodyPart, ...], names: tuple[str, ...]) -> set[frozenset[str]]:
    return {frozenset(names[marker] for marker in part.joints) for part in parts}


def well_formed(parts: tuple[BodyPart, ...], markers: int) -> None:
    assert sorted(marker for part in parts for marker in part.joints) == list(range(markers))
    for place, part in enumerate(parts):
        assert part.joints == tuple(sorted(part.joints))
        assert part.reference in part.joints
        assert part.parent < place
        assert (part.parent == -1) == (place == 0)
    assert parts[0].name == "root"
    assert len({part.name for part in parts}) == len(parts)


@given(
    st.integers(0, 2**32 - 1),
    st.lists(st.integers(3, 7), min_size=2, max_size=6),
    st.sampled_from([0.0, 0.3]),
)
def test_planted_bodies_are_found(seed: int, sizes: list[int], gaps: float) -> None:
    random = np.random.default_rng(seed)
    positions = wandering(random, sizes)
    positions += random.normal(0, 0.05, positions.shape)
    positions[random.random(positions.shape[:2]) < gaps] = np.nan
    names = tuple(f"m{place}" for place in range(sum(sizes)))
    parts = marker_parts(names, positions)
    well_formed(parts, len(names))
    owner = np.repeat(np.arange(len(sizes)), sizes)
    planted = {
        frozenset(f"m{marker}" for marker in np.flatnonzero(owner == body))
        for body in range(len(sizes))
    }
    assert groups(parts, names) == planted
    found = cluster_markers(positions)
    assert {frozenset(f"m{i}" for i in np.flatnonzero(found == n)) for n in found} == planted


@given(st.integers(0, 2**32 - 1), st.randoms(use_true_random=False), st.booleans())
def test_order_of_markers_does_not_matter(seed: int, shuffler: object, moving: bool) -> None:
    random = np.random.default_rng(seed)
    positions = wandering(random, [4, 3, 5, 2], 40 if moving else 1)
    positions[random.random(positions.shape[:2]) < 0.2] = np.nan
    names = tuple(f"m{place}" for place in range(positions.shape[1]))
    order = list(range(len(names)))
    shuffler.shuffle(order)  # type: ignore[attr-defined]

    def told(parts: tuple[BodyPart, ...], names: tuple[str, ...]) -> list[object]:
        return [
            (part.name, part.parent, names[part.reference], {names[i] for i in part.joints})
            for part in parts
        ]

    shuffled = tuple(names[place] for place in order)
    assert told(marker_parts(names, positions), names) == told(
        marker_parts(shuffled, positions[:, order]), shuffled
    )


def test_a_chain_is_rooted_in_its_middle() -> None:
    # Five rods, each hinged to the next at a shared end: the tree must be that chain.
    random = np.random.default_rng(4)
    angles = np.cumsum(random.normal(0, 0.15, (80, 5)), axis=0)
    joint, positions = np.zeros((80, 3)), []
    for rod in range(5):
        step = np.stack([np.cos(angles[:, rod]), np.sin(angles[:, rod]), 0 * angles[:, rod]], 1)
        positions += [joint + step * reach for reach in (2.0, 15.0, 28.0)]
        joint = joint + step * 30.0
    names = tuple(f"{rod}{place}" for rod in range(5) for place in "abc")
    parts = marker_parts(names, np.stack(positions, axis=1))
    rods = [{names[marker][0] for marker in part.joints} for part in parts]
    assert all(len(rod) == 1 for rod in rods)
    order = [int(rod.pop()) for rod in rods]
    parents = {rod: order[part.parent] for rod, part in zip(order[1:], parts[1:], strict=True)}
    assert order[0] == 2
    assert parents == {1: 2, 3: 2, 0: 1, 4: 3}
    reference = {rod: names[part.reference] for rod, part in zip(order, parts, strict=True)}
    assert reference[1] == "1a"  # next to the joint with rod 0
    assert reference[3] == "3c"


@pytest.mark.parametrize("prefix", ["", "Daphne:"])
def test_plug_in_gait_names_give_the_known_hierarchy(prefix: str) -> None:
    names = tuple(prefix + name for name in CORE)
    positions = np.random.default_rng(0).uniform(-50, 50, (9, len(names), 3))
    parts = marker_parts(names, positions)
    well_formed(parts, len(names))
    tree = {part.name: parts[part.parent].name for part in parts[1:]}
    sides: dict[str, str] = {}
    for side in ("left", "right"):
        sides |= {f"{side}_shoulder": "torso", f"{side}_arm": f"{side}_shoulder",
                  f"{side}_hand": f"{side}_arm", f"{side}_leg": "root",
                  f"{side}_foot": f"{side}_leg"}  # fmt: skip
    assert tree == {"torso": "root", "head": "torso", **sides}
    assert frozenset(prefix + n for n in ("LTHI", "LKNE", "LTIB")) in groups(parts, names)
    assert frozenset(prefix + n for n in ("LASI", "RASI", "LPSI", "RPSI")) in groups(parts, names)


def test_other_markers_join_the_known_part_that_they_move_with() -> None:
    random = np.random.default_rng(3)
    names = (*CORE, "extra", "never")
    positions = random.uniform(-80, 80, (30, len(names), 3))
    head = CORE.index("RBHD")
    positions[:, -2] = positions[:, head] + [3.0, 0, 0]
    positions[:, -1] = np.nan
    parts = marker_parts(names, positions)
    well_formed(parts, len(names))
    owner = {names[marker]: part.name for part in parts for marker in part.joints}
    assert owner["extra"] == owner["RBHD"] == "head"
    assert owner["never"] == "unseen"


def test_known_names_need_three_quarters_and_a_pelvis() -> None:
    random = np.random.default_rng(5)
    for names in (CORE[:26], tuple(name for name in CORE if name[1:] not in ("ASI", "PSI"))):
        parts = marker_parts(names, random.uniform(-50, 50, (20, len(names), 3)))
        assert "torso" not in {part.name for part in parts}
    without = tuple(name for name in CORE if name not in ("LSHO", "LELB", "LUPA", "LFRM"))
    parts = marker_parts(without, random.uniform(-50, 50, (20, len(without), 3)))
    hand = next(part for part in parts if part.name == "left_hand")
    assert parts[hand.parent].name == "torso"  # shoulder and arm have no markers


@given(
    st.integers(0, 8),
    st.integers(1, 12),
    st.sampled_from([0.0, 0.5, 0.9, 1.0]),
    st.booleans(),
    st.integers(0, 2**32 - 1),
)
def test_awkward_sets(frames: int, markers: int, gaps: float, alike: bool, seed: int) -> None:
    random = np.random.default_rng(seed)
    positions = random.uniform(-1e7, 1e7, (frames, markers, 3))
    if alike:
        positions[:] = 5.0
    positions[random.random((frames, markers)) < gaps] = np.nan
    names = tuple(random.choice(["a", "b", "c:d", "LASI"], markers).tolist())  # names may repeat
    parts = marker_parts(names, positions)
    well_formed(parts, markers)
    assert parts == marker_parts(names, positions.copy())


def test_never_seen_markers_are_kept_apart() -> None:
    random = np.random.default_rng(2)
    positions = wandering(random, [4, 4])
    positions[:, 5] = np.nan
    positions[3:, 6] = np.nan  # seen in three frames: joins its own body
    parts = marker_parts(tuple("abcdefgh"), positions)
    assert [part.joints for part in parts if part.name == "unseen"] == [(5,)]
    assert groups(parts, tuple("abcdefgh")) == {
        frozenset("abcd"), frozenset("egh"), frozenset("f")
    }  # fmt: skip


def test_three_hundred_markers() -> None:
    positions = wandering(np.random.default_rng(6), [6] * 50, 500)
    parts = marker_parts(tuple(f"m{place}" for place in range(300)), positions)
    well_formed(parts, 300)
    assert {len(part.joints) for part in parts} == {6}


def test_absurd_numbers_of_markers_take_no_memory() -> None:
    names = tuple(f"m{place}" for place in range(60_000))
    well_formed(marker_parts(names, np.zeros((1, 60_000, 3))), 60_000)


@pytest.mark.library
def test_real_walk_is_taken_apart_at_the_joints() -> None:
    path = Path(library_path("misc", "markers", "bmc", "walk.trc"))
    clip = parse_trc(path.read_bytes())
    parts = marker_parts(clip.names, clip.positions)
    well_formed(parts, len(clip.names))
    owner = {clip.names[marker]: part.name for part in parts for marker in part.joints}
    assert owner["R.ASIS"] == owner["L.PSIS"] == "root"
    for side in "RL":
        assert owner[f"{side}.Heel"] == owner[f"{side}.MT5"] != owner[f"{side}.Knee"]
    assert owner["R.Knee"] != owner["L.Knee"]


@pytest.mark.library
def test_real_plug_in_gait_is_recognised() -> None:
    path = Path(library_path("misc", "markers", "pycgm", "Movement_trial.c3d"))
    clip = parse_c3d(path.read_bytes())
    parts = marker_parts(clip.names, clip.positions)
    well_formed(parts, len(clip.names))
    assert len(parts) == 13
    assert parts[0].name == "root"
    owner = {clip.names[marker]: part.name for part in parts for marker in part.joints}
    assert owner["PELO"] == "root"  # the pelvis' virtual origin
    assert owner["HEDA"] == "head"
    assert owner["LTOO"] == "left_foot"
