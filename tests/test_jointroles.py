from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joint_trees import (
    BIPED,
    CMU_ASF,
    COLLARS,
    MIXAMO,
    UNREAL,
    VICON,
    XSENS,
    assert_sound,
    described,
    skeleton,
    t_pose,
)
from library import library_path

from motifold.codec.clip import Skeleton
from motifold.codec.figure.bodyparts import body_parts


@pytest.mark.parametrize(
    ("tree", "expected"),
    [
        (
            CMU_ASF,
            {
                "root": "root < - / root",
                "spine": "lowerback upperback thorax < root / thorax",
                "head": "lowerneck upperneck head < spine / head",
                "left_hip": "lhipjoint < root / lhipjoint",
                "left_leg": "lfemur ltibia < left_hip / ltibia",
                "left_foot": "lfoot ltoes < left_leg / ltoes",
                "left_shoulder": "lclavicle < spine / lclavicle",
                "left_arm": "lhumerus lradius < left_shoulder / lradius",
                "left_hand": "lwrist lhand < left_arm / lhand",
                "left_fingers": "lthumb lfingers < left_hand / lfingers",
                "right_hip": "rhipjoint < root / rhipjoint",
                "right_leg": "rfemur rtibia < right_hip / rtibia",
                "right_foot": "rfoot rtoes < right_leg / rtoes",
                "right_shoulder": "rclavicle < spine / rclavicle",
                "right_arm": "rhumerus rradius < right_shoulder / rradius",
                "right_hand": "rwrist rhand < right_arm / rhand",
                "right_fingers": "rthumb rfingers < right_hand / rfingers",
            },
        ),
        (
            BIPED,
            {
                "root": "Bip01 Bip01 Pelvis < - / Bip01 Pelvis",
                "other_Bip01 Footsteps": "Bip01 Footsteps < root / Bip01 Footsteps",
                "spine": "Bip01 Spine Bip01 Spine1 < root / Bip01 Spine1",
                "left_leg": "Bip01 L Thigh Bip01 L Calf < root / Bip01 L Calf",
                "right_leg": "Bip01 R Thigh < root / Bip01 R Thigh",
                "left_foot": "Bip01 L Foot Bip01 L Toe0 < left_leg / Bip01 L Toe0",
                "head": "Bip01 Neck Bip01 Head < spine / Bip01 Head",
                "left_shoulder": "Bip01 L Clavicle < spine / Bip01 L Clavicle",
                "left_arm": "Bip01 L UpperArm Bip01 LUpArmTwist Bip01 L Forearm < left_shoulder"
                " / Bip01 L Forearm",
                "left_hand": "Bip01 L Hand < left_arm / Bip01 L Hand",
                "left_fingers": "Bip01 L Finger0 Bip01 L Finger01 < left_hand / Bip01 L Finger01",
            },
        ),
        (
            UNREAL,
            {
                "root": "root pelvis < - / pelvis",
                "other_ik_foot_root": "ik_foot_root ik_foot_l < root / ik_foot_l",
                "spine": "spine_01 spine_02 < root / spine_02",
                "left_shoulder": "clavicle_l < spine / clavicle_l",
                "left_arm": "upperarm_l lowerarm_l upperarm_twist_01_l lowerarm_twist_01_l"
                " < left_shoulder / lowerarm_l",
                "left_hand": "hand_l < left_arm / hand_l",
                "left_fingers": "index_01_l < left_hand / index_01_l",
                "other_weapon_l": "weapon_l weapon_tip_l < left_hand / weapon_tip_l",
                "head": "neck_01 head < spine / head",
                "left_leg": "thigh_l calf_l < root / calf_l",
                "left_foot": "foot_l ball_l < left_leg / ball_l",
                "right_leg": "thigh_r calf_r < root / calf_r",
            },
        ),
        (
            XSENS,
            {
                "root": "Pelvis < - / Pelvis",
                "spine": "L5 L3 T12 T8 < root / T8",
                "head": "Neck Head < spine / Head",
                "right_shoulder": "RightShoulder < spine / RightShoulder",
                "right_arm": "RightUpperArm RightForeArm < right_shoulder / RightForeArm",
                "right_hand": "RightHand < right_arm / RightHand",
                "right_leg": "RightUpperLeg RightLowerLeg < root / RightLowerLeg",
                "right_foot": "RightFoot RightToe < right_leg / RightToe",
            },
        ),
        (
            COLLARS,
            {
                "root": "Hips < - / Hips",
                "spine": "LowerBack < root / LowerBack",
                "left_hip": "LHipJoint < root / LHipJoint",
                "left_leg": "LeftHip LeftKnee < left_hip / LeftKnee",
                "left_foot": "LeftAnkle < left_leg / LeftAnkle",
                "right_leg": "RightHip RightKnee < root / RightKnee",
                "right_foot": "RightAnkle < right_leg / RightAnkle",
                "left_shoulder": "LeftCollar < spine / LeftCollar",
                "left_arm": "LeftShoulder LeftElbow < left_shoulder / LeftElbow",
                "left_hand": "LeftWrist < left_arm / LeftWrist",
                "right_arm": "RightShoulder RightElbow < spine / RightElbow",
                "head": "Head < spine / Head",
            },
        ),
        (
            VICON,
            {
                "root": "pelvis < - / pelvis",
                "spine": "thorax < root / thorax",
                "head": "head < spine / head",
                "left_leg": "LFemur LTibia < root / LTibia",
                "left_foot": "LFoot LToes < left_leg / LToes",
                "left_shoulder": "LClavicle < spine / LClavicle",
                "left_arm": "LHumerus LRadius < left_shoulder / LRadius",
                "left_hand": "LHand < left_arm / LHand",
            },
        ),
    ],
    ids=["cmu_asf", "biped", "unreal", "xsens", "collars", "vicon"],
)
def test_known_rigs(tree: str, expected: dict[str, str]) -> None:
    rig = skeleton(tree)
    parts = body_parts(rig)
    assert_sound(rig, parts)
    assert described(rig, parts) == expected


@pytest.mark.parametrize("prefix", ["mixamorig:", "mixamorig1_", "Character1_", "actor7:", ""])
def test_prefixes_do_not_matter(prefix: str) -> None:
    rig = skeleton(MIXAMO)
    names = tuple(name.replace("mixamorig:", prefix) for name in rig.names)
    named = Skeleton(names, rig.parents, rig.offsets)
    found = [(part.name, part.joints, part.parent) for part in body_parts(named)]
    assert {name: len(joints) for name, joints, _ in found} == {
        "root": 1,
        "spine": 2,
        "head": 3,
        "face": 1,
        "left_shoulder": 1,
        "left_arm": 2,
        "left_hand": 1,
        "left_fingers": 2,
        "right_shoulder": 1,
        "right_arm": 1,
        "left_leg": 2,
        "left_foot": 2,
    }
    assert found == [(p.name, p.joints, p.parent) for p in body_parts(rig)]


def test_a_rig_without_names_is_known_by_its_shape() -> None:
    rig = t_pose()
    blind = Skeleton(tuple(f"n{j}" for j in range(rig.joints)), rig.parents, rig.offsets)
    found = {part.name: part.joints for part in body_parts(blind)}
    named = {part.name: part.joints for part in body_parts(rig)}
    for name in ("root", "spine", "head", "left_leg", "right_leg", "left_foot", "left_hip"):
        assert found[name] == named[name]
    for side in ("left", "right"):
        assert found[f"{side}_arm"] == named[f"{side}_arm"]
        assert found[f"{side}_shoulder"] == named[f"{side}_shoulder"]


def test_sides_missing_from_names_come_from_the_rest_pose() -> None:
    rig = t_pose()
    names = tuple(
        name[1:] if name[0] in "lr" and not name.startswith(("lower", "root")) else name
        for name in rig.names
    )
    unsided = Skeleton(names, rig.parents, rig.offsets)
    named = {part.name: part.joints for part in body_parts(rig)}
    assert {part.name: part.joints for part in body_parts(unsided)} == named


def read_tree(path: Path) -> Skeleton:
    """The joint tree of a BVH file, as little of it as the tests need."""
    names: list[str] = []
    parents: list[int] = []
    open_joints: list[int] = []
    for line in path.read_text(errors="replace").splitlines():
        words = line.split()
        if words[:1] in (["ROOT"], ["JOINT"]):
            parents.append(open_joints[-1] if open_joints else -1)
            names.append(" ".join(words[1:]))
        elif words[:1] == ["{"]:
            open_joints.append(len(names) - 1)
        elif words[:1] == ["}"]:
            open_joints.pop()
        elif words[:1] == ["MOTION"]:
            break
    return Skeleton(tuple(names), np.array(parents), np.zeros((len(names), 3)))


def test_real_rigs() -> None:
    paths = [
        next(library_path("bandai").glob("*.bvh")),
        *library_path("misc", "bvh").rglob("*.bvh"),
    ]
    body = {"root", "spine", "head"} | {
        f"{side}_{part}" for side in ("left", "right") for part in ("arm", "hand", "leg", "foot")
    }
    for path in paths:
        rig = read_tree(path)
        parts = body_parts(rig)
        assert_sound(rig, parts)
        names = {part.name for part in parts}
        if "sinusoidal" in path.name:  # a chain that is no body
            assert names == {"root", "other_child1"}
            continue
        assert names >= body, path
        assert not any(name.startswith("other_") for name in names), path
        mirrored = {
            name.replace("left", "x").replace("right", "left").replace("x", "right")
            for name in names
        }
        assert mirrored == names
        for part in parts:
            if part.name.endswith(("_arm", "_leg")):
                assert len(part.joints) == 2, (path, part)


def test_bandai() -> None:
    rig = read_tree(next(library_path("bandai").glob("*.bvh")))
    expected = {
        "root": "joint_Root Hips < - / Hips",
        "spine": "Spine Chest < root / Chest",
        "head": "Neck Head < spine / Head",
    }
    for side, letter in (("left", "L"), ("right", "R")):
        for part, joints, parent in (
            ("shoulder", "Shoulder_X", "spine"),
            ("arm", "UpperArm_X LowerArm_X", f"{side}_shoulder"),
            ("hand", "Hand_X", f"{side}_arm"),
            ("leg", "UpperLeg_X LowerLeg_X", "root"),
            ("foot", "Foot_X Toes_X", f"{side}_leg"),
        ):
            reference = joints.split()[-1]
            expected[f"{side}_{part}"] = f"{joints} < {parent} / {reference}".replace("X", letter)
    assert described(rig, body_parts(rig)) == expected
