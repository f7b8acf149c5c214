"""Small joint trees of well-known rigs, and what every set of body parts must satisfy."""

from __future__ import annotations

import numpy as np

from motifold.codec.clip import Skeleton
from motifold.codec.figure.bodyparts import BodyPart


def skeleton(text: str) -> Skeleton:
    """A skeleton from lines "parent: child child …", the first parent the root."""
    names: list[str] = []
    parents: list[int] = []
    for line in text.strip().splitlines():
        parent, _, children = (part.strip() for part in line.partition(":"))
        if not names:
            names.append(parent)
            parents.append(-1)
        for child in children.split():
            names.append(child)
            parents.append(names.index(parent))
    names = [name.replace("~", " ").replace("=", ":") for name in names]
    return Skeleton(tuple(names), np.array(parents), np.zeros((len(names), 3)))


def described(rig: Skeleton, parts: tuple[BodyPart, ...]) -> dict[str, str]:
    """Per part "joints < parent / reference"."""
    return {
        part.name: " ".join(rig.names[joint] for joint in part.joints)
        + f" < {parts[part.parent].name if part.parent >= 0 else '-'}"
        + f" / {rig.names[part.reference]}"
        for part in parts
    }


def assert_sound(rig: Skeleton, parts: tuple[BodyPart, ...]) -> None:
    joints = [joint for part in parts for joint in part.joints]
    assert sorted(joints) == list(range(rig.joints))
    assert len({part.name for part in parts}) == len(parts)
    for index, part in enumerate(parts):
        assert part.parent < index
        assert (part.parent == -1) == (index == 0)
        assert part.reference in part.joints
        assert list(part.joints) == sorted(part.joints)
    assert parts[0].name == "root"
    assert 0 in parts[0].joints


CMU_ASF = """
root: lhipjoint rhipjoint lowerback
lhipjoint: lfemur
lfemur: ltibia
ltibia: lfoot
lfoot: ltoes
rhipjoint: rfemur
rfemur: rtibia
rtibia: rfoot
rfoot: rtoes
lowerback: upperback
upperback: thorax
thorax: lowerneck lclavicle rclavicle
lowerneck: upperneck
upperneck: head
lclavicle: lhumerus
lhumerus: lradius
lradius: lwrist
lwrist: lhand lthumb
lhand: lfingers
rclavicle: rhumerus
rhumerus: rradius
rradius: rwrist
rwrist: rhand rthumb
rhand: rfingers
"""
BIPED = """
Bip01: Bip01~Footsteps Bip01~Pelvis
Bip01~Pelvis: Bip01~Spine
Bip01~Spine: Bip01~L~Thigh Bip01~R~Thigh Bip01~Spine1
Bip01~L~Thigh: Bip01~L~Calf
Bip01~L~Calf: Bip01~L~Foot
Bip01~L~Foot: Bip01~L~Toe0
Bip01~Spine1: Bip01~Neck
Bip01~Neck: Bip01~Head Bip01~L~Clavicle
Bip01~L~Clavicle: Bip01~L~UpperArm
Bip01~L~UpperArm: Bip01~LUpArmTwist Bip01~L~Forearm
Bip01~L~Forearm: Bip01~L~Hand
Bip01~L~Hand: Bip01~L~Finger0
Bip01~L~Finger0: Bip01~L~Finger01
"""
UNREAL = """
root: pelvis ik_foot_root
ik_foot_root: ik_foot_l
pelvis: spine_01 thigh_l thigh_r
spine_01: spine_02
spine_02: clavicle_l neck_01
clavicle_l: upperarm_l
upperarm_l: lowerarm_l upperarm_twist_01_l
lowerarm_l: hand_l lowerarm_twist_01_l
hand_l: index_01_l weapon_l
weapon_l: weapon_tip_l
neck_01: head
thigh_l: calf_l
calf_l: foot_l
foot_l: ball_l
thigh_r: calf_r
"""
MIXAMO = """
mixamorig=Hips: mixamorig=Spine mixamorig=LeftUpLeg
mixamorig=Spine: mixamorig=Spine1
mixamorig=Spine1: mixamorig=Neck mixamorig=LeftShoulder mixamorig=RightShoulder
mixamorig=Neck: mixamorig=Head
mixamorig=Head: mixamorig=HeadTop_End mixamorig=LeftEye
mixamorig=LeftShoulder: mixamorig=LeftArm
mixamorig=LeftArm: mixamorig=LeftForeArm
mixamorig=LeftForeArm: mixamorig=LeftHand
mixamorig=LeftHand: mixamorig=LeftHandThumb1 mixamorig=LeftHandIndex1
mixamorig=RightShoulder: mixamorig=RightArm
mixamorig=LeftUpLeg: mixamorig=LeftLeg
mixamorig=LeftLeg: mixamorig=LeftFoot
mixamorig=LeftFoot: mixamorig=LeftToeBase
"""
XSENS = """
Pelvis: L5 RightUpperLeg
L5: L3
L3: T12
T12: T8
T8: Neck RightShoulder
Neck: Head
RightShoulder: RightUpperArm
RightUpperArm: RightForeArm
RightForeArm: RightHand
RightUpperLeg: RightLowerLeg
RightLowerLeg: RightFoot
RightFoot: RightToe
"""
COLLARS = """
Hips: LowerBack LHipJoint RightHip
LHipJoint: LeftHip
LeftHip: LeftKnee
LeftKnee: LeftAnkle
RightHip: RightKnee
RightKnee: RightAnkle
LowerBack: LeftCollar RightShoulder Head
LeftCollar: LeftShoulder
LeftShoulder: LeftElbow
LeftElbow: LeftWrist
RightShoulder: RightElbow
"""
VICON = """
pelvis: LFemur thorax
LFemur: LTibia
LTibia: LFoot
LFoot: LToes
thorax: head LClavicle
LClavicle: LHumerus
LHumerus: LRadius
LRadius: LHand
"""


def t_pose() -> Skeleton:
    """CMU's tree as a plain T-pose: Y up, facing Z, left at +X, 0.1 cm off a perfect mirror."""
    rig = skeleton(CMU_ASF)
    lengths = {"hipjoint": 2, "femur": 8, "tibia": 40, "foot": 40, "toes": 14, "clavicle": 4}
    lengths |= {"humerus": 14, "radius": 28, "wrist": 26, "hand": 8, "fingers": 6, "thumb": 5}
    offsets = np.zeros((rig.joints, 3))
    for joint, name in enumerate(rig.names):
        side = {"l": 1.0, "r": -1.0}[name[0]] if name[1:] in lengths else 0.0
        length = lengths.get(name[1:], 12) + (0.1 if side > 0 else 0.0)
        if name[1:] in ("foot", "tibia"):  # offsets lead to the joint: thigh and shin go down
            offsets[joint] = (0, -length, 0)
        elif name[1:] == "toes":
            offsets[joint] = (0, 0, length)
        elif side:
            offsets[joint] = (side * length, 0, 0)
        elif joint:
            offsets[joint] = (0, length, 0)
    return Skeleton(rig.names, rig.parents, offsets)
