from __future__ import annotations

import re
import time
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from library import library_path
from scipy.spatial.transform import Rotation

from motifold.codec.clip import FloatArray, SkeletonClip
from motifold.codec.errors import FormatError, MotifoldError, UnsupportedError, UsageError
from motifold.codec.formats.amc import parse_amc, parse_asf
from motifold.codec.formats.bvh import format_bvh, parse_bvh
from motifold.codec.geometry.kinematics import end_positions, world_positions, world_rotations

relaxed = settings(max_examples=100, deadline=None, suppress_health_check=list(HealthCheck))
numbers = st.integers(-1_800_000, 1_800_000).map(lambda n: n / 10_000)


@dataclass
class Bone:
    name: str
    parent: int
    tip: list[float]
    axis: list[float]
    axis_order: str
    dofs: list[str]


@dataclass
class Case:
    """A rig (bone 0 is the root, its tip the rest position) and its motion, in degrees."""

    bones: list[Bone]
    values: list[list[list[float]]]  # frame, bone, dof
    radians: bool
    newline: str

    def angle(self, degrees: float) -> str:
        return repr(np.radians(degrees).item() if self.radians else degrees)

    def asf(self) -> bytes:
        root = self.bones[0]
        lines = ["# a comment", ":version 1.10", ":units", "  mass 1.0", "  length 0.45"]
        lines += [
            f"  angle {'rad' if self.radians else 'deg'}",
            ":root",
            "order " + " ".join(root.dofs),
        ]
        lines += [f"axis {root.axis_order}", "position " + " ".join(map(str, root.tip))]
        lines += ["orientation " + " ".join(map(self.angle, root.axis)), ":bonedata"]
        for number, bone in enumerate(self.bones[1:], 1):
            lines += ["begin", f"id {number}", f"name {bone.name}"]
            lines += ["direction " + " ".join(map(str, bone.tip)), "length 1.0"]
            lines += [f"axis {' '.join(map(self.angle, bone.axis))}  {bone.axis_order}"]
            lines += [f"dof {' '.join(bone.dofs)}", "limits (-180 180)"] if bone.dofs else []
            lines += ["end"]
        lines += [":hierarchy", "  begin"]
        for index, bone in enumerate(self.bones):
            children = [child.name for child in self.bones[1:] if child.parent == index]
            lines += ["   " + " ".join([bone.name, *children])] if children else []
        return self.newline.join([*lines, "  end", ""]).encode()

    def amc(self) -> bytes:
        lines = ["#!OML:ASF", ":FULLY-SPECIFIED", ":RADIANS" if self.radians else ":DEGREES"]
        for number, frame in enumerate(self.values, 1):
            lines.append(str(number))
            for bone, values in zip(self.bones, frame, strict=True):
                words = [
                    self.angle(value) if dof[0] == "r" else str(value)
                    for dof, value in zip(bone.dofs, values, strict=True)
                ]
                lines += [" ".join([bone.name, *words])] if words else []
        return self.newline.join([*lines, ""]).encode()

    def tips(self) -> tuple[FloatArray, FloatArray]:
        """Bone tips (frames, bones, 3) by the specification, and who is a leaf."""
        out = []
        for frame in self.values:
            places: list[FloatArray] = []
            turns: list[Rotation] = []
            for bone, values in zip(self.bones, frame, strict=True):
                order = bone.axis_order.lower()  # lower case: SciPy turns about fixed axes
                own = Rotation.from_euler(order, [bone.axis["xyz".index(a)] for a in order], True)
                moved = Rotation.identity()
                shift = np.zeros(3)
                for dof, value in zip(bone.dofs, values, strict=True):
                    if dof[0] == "t":
                        shift["xyz".index(dof[1])] += value
                    else:
                        moved = Rotation.from_euler(dof[1], value, degrees=True) * moved
                turn = own * moved * own.inv()
                if bone.parent >= 0:
                    turn = turns[bone.parent] * turn
                    places.append(places[bone.parent] + turn.apply(bone.tip))
                else:
                    places.append(np.array(bone.tip) + shift)
                turns.append(turn)
            out.append(places)
        parents = {bone.parent for bone in self.bones}
        leaves = np.array([index not in parents for index in range(len(self.bones))])
        return np.array(out), leaves


@st.composite
def cases(draw: st.DrawFn) -> Case:
    vectors = st.lists(numbers, min_size=3, max_size=3)
    orders = st.permutations("XYZ").map("".join)
    turns = st.lists(st.sampled_from(["rx", "ry", "rz"]), unique=True)
    root_dofs = draw(st.permutations(["tx", "ty", "tz", "rx", "ry", "rz"]))
    bones = [Bone("root", -1, draw(vectors), draw(vectors), draw(orders), root_dofs)]
    for index in range(1, draw(st.integers(2, 6))):
        parent = draw(st.integers(0, index - 1))
        dofs = draw(turns)
        bone = Bone(f"b{index}", parent, draw(vectors), draw(vectors), draw(orders), dofs)
        bones.append(bone)
    frame = st.tuples(
        *[st.lists(numbers, min_size=len(b.dofs), max_size=len(b.dofs)) for b in bones]
    )
    values = draw(st.lists(frame.map(list), min_size=1, max_size=3))
    return Case(bones, values, draw(st.booleans()), draw(st.sampled_from(["\n", "\r\n"])))


def posed(clip: SkeletonClip) -> tuple[FloatArray, FloatArray]:
    world = world_rotations(clip.skeleton, clip.rotations)
    positions = world_positions(clip.skeleton, world, clip.translations)
    return positions, end_positions(clip.skeleton, world, positions)


@relaxed
@given(cases())
def test_bones_move_as_the_specification_says(case: Case) -> None:
    clip = parse_amc(case.amc(), case.asf(), units="cm")
    tips, leaves = case.tips()
    joints, ends = posed(clip)
    index = {name: joint for joint, name in enumerate(clip.skeleton.names)}
    assert set(index) == {bone.name for bone in case.bones}
    assert (clip.skeleton.parents[1:] < np.arange(1, len(index))).all()
    for number, bone in enumerate(case.bones):
        joint = index[bone.name]
        start = tips[:, max(bone.parent, 0)]
        np.testing.assert_allclose(joints[:, joint], start, atol=1e-9)
        assert (joint in clip.skeleton.end_parents) == leaves[number]
        if leaves[number]:
            end = clip.skeleton.end_parents.tolist().index(joint)
            np.testing.assert_allclose(ends[:, end], tips[:, number], atol=1e-9)


@relaxed
@given(cases())
def test_the_order_of_bones_in_a_frame_does_not_matter(case: Case) -> None:
    lines = case.amc().decode().split(case.newline)
    start = lines.index("1") + 1
    stop = lines.index("2") if "2" in lines else len(lines) - 1
    lines[start:stop] = reversed(lines[start:stop])
    plain = parse_amc(case.amc(), case.asf(), units="cm")
    other = parse_amc("\n".join(lines).encode(), case.asf(), units="cm")
    np.testing.assert_array_equal(plain.rotations, other.rotations)
    np.testing.assert_array_equal(plain.translations, other.translations)


@relaxed
@given(cases())
def test_written_as_bvh_it_moves_the_same(case: Case) -> None:
    clip = parse_amc(case.amc(), case.asf())
    again = parse_bvh(format_bvh(clip), units="cm")
    assert again.skeleton.names == clip.skeleton.names
    np.testing.assert_allclose(again.rotations, clip.rotations, atol=1e-6)
    np.testing.assert_allclose(again.translations, clip.translations, atol=1e-5)


ASF = b"""# comment
:units
  length 0.45
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
    name leg
    direction 0 -1 0
    length 8
    axis 0 0 20 XYZ
    dof rx rz
    limits (-90 90)
           (-90 90)
  end
  begin
    name spine
    direction 0 1 0
    length 7
    axis 0 0 0 XYZ
  end
:hierarchy
  begin
    root leg spine
  end
"""
AMC = b"""#!OML:ASF x.asf
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 4 5 6
leg 7 8
2
root 2 3 4 5 6 7
leg 8 9
3
root 3 4 5 6 7 8
leg 9 10
"""


def test_every_frame_is_kept_and_units_are_declared() -> None:
    clip = parse_amc(AMC, ASF)
    inches = 2.54 / 0.45
    assert clip.layout.unit_source == "declared"
    assert clip.layout.centimetres == pytest.approx(inches)
    np.testing.assert_allclose(clip.translations[:, 0, 0], np.array([1, 2, 3]) * inches)
    np.testing.assert_allclose(clip.skeleton.end_offsets, [[0, -8 * inches, 0], [0, 7 * inches, 0]])
    assert clip.frame_time == 1 / 120
    assert [repair.what for repair in clip.repairs] == [
        "AMC files tell no frame time: 1/120 s assumed"
    ]


def test_given_units_win() -> None:
    clip = parse_amc(AMC, ASF, units="mm")
    assert (clip.layout.unit, clip.layout.unit_source) == ("mm", "given")
    np.testing.assert_allclose(clip.translations[0, 0], [0.1, 0.2, 0.3])
    with pytest.raises(UsageError):
        parse_amc(AMC, ASF, units="league")


def test_a_declared_rate_is_believed() -> None:
    clip = parse_amc(AMC.replace(b":DEGREES", b":DEGREES\n:SAMPLES-PER-SECOND 60"), ASF)
    assert clip.frame_time == pytest.approx(1 / 60)
    assert clip.repairs == ()


@pytest.mark.parametrize(
    ("amc", "asf", "said", "kept"),
    [
        (AMC[: AMC.rindex(b"leg")], ASF, "frame, 3, is cut short", [1, 2]),
        (AMC[: AMC.rindex(b" 10")], ASF, "frame, 3, is cut short", [1, 2]),
        (AMC.replace(b"leg 9 10\n", b"le"), ASF, "frame, 3, is cut short", [1, 2]),
        (AMC + b"4\n", ASF, "frame, 4, is cut short", [1, 2, 3]),
        (AMC.replace(b"\n3\n", b"\n0\n"), ASF, "out of order", [3, 1, 2]),
        (AMC.replace(b"\n3\n", b"\n7\n"), ASF, "missing here", [1, 2, 3]),
        (AMC.replace(b"\n3\n", b"\n2\n"), ASF, "repeat", [1, 2, 3]),
        (AMC, ASF.replace(b"length 0.45", b""), "length unit is missing", [1, 2, 3]),
        (AMC, ASF.replace(b"length 0.45", b"length 0"), "length unit is 0", [1, 2, 3]),
        (AMC, ASF.replace(b"length 0.45", b""), "unit assumed to be cm", [1, 2, 3]),
        (AMC.replace(b"9 10\n", b"9 -"), ASF, "frame, 3, is cut short", [1, 2]),
    ],
)
def test_repairs_are_recorded(amc: bytes, asf: bytes, said: str, kept: list[int]) -> None:
    clip = parse_amc(amc, asf)
    assert any(said in repair.what for repair in clip.repairs), clip.repairs
    tall = np.array(kept, dtype=float) * clip.layout.centimetres
    np.testing.assert_allclose(clip.translations[:, 0, 0], tall)


@pytest.mark.parametrize(
    ("amc", "place", "said"),
    [
        (AMC.replace(b"8 9\n", b"nan 9\n"), "line 9", "frame 2: 'nan' for leg rx"),
        (AMC.replace(b"9 10\n", b"9 inf\n"), "line 12", "frame 3: 'inf' for leg rz"),
        (AMC.replace(b"8 9\n", b"8 9,5\n"), "line 9", "frame 2: '9,5' for leg rz"),
        (AMC.replace(b"leg 8 9\n", b"arm 8 9\n"), "line 9", "unknown bone 'arm'"),
        (AMC.replace(b"leg 8 9\n", b""), "line 7", "frame 2 lacks leg"),
        (AMC.replace(b"leg 8 9\n", b"leg 8 9\nleg 8 9\n"), "line 10", "twice"),
        (AMC.replace(b"leg 8 9\n", b"leg 8\n"), "line 9", "1 values for the 2 of bone leg"),
        (AMC.replace(b"\n2\n", b"\n9999999999999999999999\n"), "line 7", "unknown bone '9999"),
        (b"", "line 1", "no frames"),
        (b"PK\x03\x04", "line 1", "where a frame's number should be"),
    ],
)
def test_errors_of_a_motion_name_file_and_place(amc: bytes, place: str, said: str) -> None:
    with pytest.raises(FormatError) as caught:
        parse_amc(amc, ASF, "walk.amc", "rig.asf")
    assert str(caught.value).startswith(f"walk.amc, {place}: ")
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"direction 0 1 0", b"direction 0 nan 0", "line 22: 3 usable number"),
        (b"length 7", b"length", "line 23: 1 usable number"),
        (b"axis 0 0 20 XYZ", b"axis 0 0 20 XXZ", "line 15: 'XXZ'"),
        (b"dof rx rz", b"dof rx rx", "line 16: 'rx rx'"),
        (b"dof rx rz", b"dof rx l", "line 16: a bone that stretches"),
        (b"dof rx rz", b"dof tx", "line 16: bone leg does more than turn"),
        (b"name spine", b"name leg", "line 25: a bone without a name of its own"),
        (b"root leg spine", b"root leg spin", "line 28: unknown bone 'spin'"),
        (b"root leg spine", b"root leg", "line 20: bone spine hangs on nothing"),
        (b"root leg spine", b"root leg leg", "line 28: bone leg has two parents"),
        (b"root leg spine", b"root leg\nspine spine", "line 20: bone spine hangs on itself"),
        (ASF, b"", "no bones"),
        (ASF[ASF.index(b":hier") :], b"", "no bones hang on the root"),
    ],
)
def test_errors_of_a_rig_name_file_and_place(old: bytes, new: bytes, said: str) -> None:
    assert old in ASF
    with pytest.raises((FormatError, UnsupportedError)) as caught:
        parse_amc(AMC, ASF.replace(old, new), "walk.amc", "rig.asf")
    assert str(caught.value).startswith("rig.asf")
    assert said in str(caught.value)


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_damaged_files_give_a_clip_or_a_named_error(data: st.DataObject) -> None:
    files = [bytearray(AMC), bytearray(ASF)]
    damaged = files[data.draw(st.integers(0, 1))]
    start, stop = sorted(data.draw(st.tuples(*[st.integers(0, len(damaged))] * 2)))
    match data.draw(st.sampled_from(["cut", "flip", "splice", "random"])):
        case "cut":
            del damaged[start:]
        case "flip":
            bits = st.integers(0, 8 * len(damaged) - 1)
            for bit in data.draw(st.lists(bits, min_size=1, max_size=9)):
                damaged[bit // 8] ^= 1 << bit % 8
        case "splice":
            damaged[start:stop] = data.draw(st.binary(max_size=20))
        case "random":
            damaged[:] = data.draw(st.binary(max_size=200))
    try:
        clip = parse_amc(bytes(files[0]), bytes(files[1]), "odd.amc", "odd.asf")
    except MotifoldError as error:
        assert re.match(r"odd\.(amc, line \d+|asf(, line \d+)?): ", str(error))  # noqa: PT017
    else:
        assert np.isfinite(clip.translations).all()
        assert np.isfinite(clip.rotations).all()
        assert parse_bvh(format_bvh(clip)).frames == clip.frames


def test_hostile_rigs_fail_quickly() -> None:
    start = time.perf_counter()
    bone = "begin\nname b%d\ndirection 0 1 0\nlength 1\naxis 0 0 0 XYZ\nend\n"
    many = ":bonedata\n" + "".join(bone % i for i in range(20_000))
    with pytest.raises(UnsupportedError, match="more than 10000"):
        parse_asf(many.encode())
    chain = "".join(f"b{i} b{i + 1}\n" for i in range(8_999))
    rig = ":root\norder tx\n:bonedata\n" + "".join(bone % i for i in range(9_000))
    rig += ":hierarchy\nroot b0\n" + chain
    motion = "".join(f"{i}\nroot 1\n" for i in range(20_000))
    with pytest.raises(UnsupportedError, match="share only"):
        parse_amc(motion.encode(), rig.encode())
    assert time.perf_counter() - start < 10


@pytest.mark.library
def test_agrees_with_someone_elses_conversion() -> None:
    """01_01.bvh has one frame more in front, and hangs neck and arms on the chest's lower end.

    So the legs must agree as they are, and the arms when seen from the shoulder.
    """
    folder = library_path("misc", "bvh", "fairmotion_tests")
    bvh = parse_bvh((folder / "01_01.bvh").read_bytes(), units="cm")
    asf = parse_asf((folder / "01.asf").read_bytes())
    clip = parse_amc((folder / "01_01.amc").read_bytes(), asf, units="cm")
    assert clip.frames == bvh.frames - 1 == 2751
    joints, theirs = posed(clip)[0], posed(bvh)[0][1:]

    def mine(name: str) -> FloatArray:
        return np.asarray(joints[:, clip.skeleton.names.index(name)])

    def other(name: str) -> FloatArray:
        return np.asarray(theirs[:, bvh.skeleton.names.index(name)])

    for side, word in (("l", "Left"), ("r", "Right")):
        leg = {"femur": "UpLeg", "tibia": "Leg", "foot": "Foot", "toes": "ToeBase"}
        for bone, joint in leg.items():
            np.testing.assert_allclose(mine(side + bone), other(word + joint), atol=2e-4)
        for bone, joint in {"radius": "ForeArm", "wrist": "Hand"}.items():
            seen = mine(side + bone) - mine(side + "humerus")
            np.testing.assert_allclose(seen, other(word + joint) - other(word + "Arm"), atol=2e-4)
