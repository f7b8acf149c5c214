from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from joint_trees import CMU_ASF, assert_sound, described, skeleton

from motifold.codec.clip import Skeleton
from motifold.codec.errors import UsageError
from motifold.codec.figure.bodyparts import BodyPart, body_parts, load_parts
from motifold.codec.figure.bodysize import head_diagonal

WORDS = """
Hips pelvis Spine1 neck Head LeftShoulder L_Clavicle RightArm rForeArm Hand.L thumb_01_r
LHipJoint LeftHip RightUpLeg Knee foot_l Toes ik_hand_l tail Jaw Bone.003 x shoulder arm
"""


@st.composite
def any_skeleton(draw: st.DrawFn) -> Skeleton:
    count = draw(st.integers(1, 30))
    parents = [-1] + [draw(st.integers(0, joint - 1)) for joint in range(1, count)]
    vocabulary = draw(
        st.sampled_from([st.sampled_from(WORDS.split()), st.text(max_size=4), st.just("j")])
    )
    names = tuple(draw(vocabulary) for _ in range(count))
    offsets = draw(st.lists(st.integers(-20, 20), min_size=3 * count, max_size=3 * count))
    return Skeleton(names, np.array(parents), np.array(offsets, float).reshape(count, 3))


@given(any_skeleton())
def test_every_joint_is_in_one_part_of_a_tree(rig: Skeleton) -> None:
    assert_sound(rig, body_parts(rig))
    assert head_diagonal(rig) >= 1.0


def test_a_single_joint_is_the_root() -> None:
    rig = skeleton("anything")
    assert body_parts(rig) == (BodyPart("root", (0,), -1, 0),)
    assert head_diagonal(rig) == 1.0


def corrected(tmp_path: Path, text: str, tree: str = CMU_ASF) -> dict[str, str]:
    path = tmp_path / "parts.toml"
    path.write_text(text, encoding="utf-8")
    rig = skeleton(tree)
    parts = body_parts(rig, load_parts(path))
    assert_sound(rig, parts)
    return described(rig, parts)


def test_corrections_move_joints_and_leave_the_rest(tmp_path: Path) -> None:
    automatic = described(skeleton(CMU_ASF), body_parts(skeleton(CMU_ASF)))
    found = corrected(
        tmp_path,
        """
        [parts.left_arm]
        joints = ["lhumerus", "lradius", "lwrist"]
        reference = "lradius"
        [parts.torso]
        joints = ["thorax"]
        parent = "spine"
        [parts.head]
        parent = "root"
        """,
    )
    changed = {
        "left_arm": "lhumerus lradius lwrist < left_shoulder / lradius",
        "left_hand": "lhand < left_arm / lhand",
        "torso": "thorax < spine / thorax",
        "spine": "lowerback upperback < root / upperback",
        "head": "lowerneck upperneck head < root / head",
        "left_shoulder": "lclavicle < torso / lclavicle",
        "right_shoulder": "rclavicle < torso / rclavicle",
        "left_fingers": "lthumb lfingers < left_arm / lfingers",
    }
    assert found == automatic | changed


def test_a_part_that_lost_its_joints_is_gone(tmp_path: Path) -> None:
    found = corrected(tmp_path, '[parts.left_leg]\njoints = ["lhipjoint"]')
    assert "left_hip" not in found
    assert found["left_leg"] == "lhipjoint lfemur ltibia < root / ltibia"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[parts.left_arm", r"parts\.toml: cannot read"),
        ("[parts.left_arm]\njoints = 7", r"\[parts\.left_arm\]: a part has joints"),
        ("[parts.left_arm]\njoint = ['lradius']", r"\[parts\.left_arm\]: a part has joints"),
        ("[part.left_arm]\njoints = []", "part: a parts file holds"),
        ("parts = 3", "a parts file holds"),
        ("[parts.root]\nparent = 'spine'", r"\[parts\.root\]: the root part has no parent"),
        ("[parts.arm]\njoints = ['nose']", r"\[parts\.arm\]: the skeleton has no joint 'nose'"),
        ("[parts.arm]\nparent = 'spine'", r"\[parts\.arm\]: no joint belongs"),
        ("[parts.head]\nparent = 'sky'", r"\[parts\.head\]: there is no part 'sky'"),
        ("[parts.head]\nreference = 'lradius'", r"\[parts\.head\]: its reference 'lradius'"),
        ("[parts.a]\njoints = ['head']\n[parts.b]\njoints = ['head']", "'head' is in 'a' already"),
        ("[parts.spine]\nparent = 'left_hand'", r"\[parts\.spine\]: its parents lead back"),
        ("[parts.spine]\nparent = 'spine'", r"\[parts\.spine\]: its parents lead back"),
        ("[parts.spine]\njoints = ['root']", r"\[parts\.spine\]: the skeleton's root joint"),
    ],
)
def test_wrong_corrections_are_explained(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message) as raised:
        corrected(tmp_path, text)
    assert str(tmp_path / "parts.toml") in str(raised.value)
    assert raised.value.advice


def test_a_parts_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"nowhere\.toml: cannot read"):
        load_parts(tmp_path / "nowhere.toml")


def test_large_trees_are_quick() -> None:
    n = 20_000
    for parents in (np.arange(n) - 1, np.minimum(np.arange(n) - 1, 0), (np.arange(n) + 1) // 2 - 1):
        rig = Skeleton(tuple(f"n{j}" for j in range(n)), parents, np.ones((n, 3)))
        assert_sound(rig, body_parts(rig))
