from __future__ import annotations

import itertools
import math
import random
import re
import time
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from library import library_path
from scipy.spatial.transform import Rotation

from motifold.codec.clip import FloatArray, Layout, SkeletonClip
from motifold.codec.errors import FormatError, MotifoldError, UnsupportedError, UsageError
from motifold.codec.formats.bvh import format_bvh, parse_bvh
from motifold.codec.geometry.kinematics import end_positions, world_positions, world_rotations

POSITIONS = ("Xposition", "Yposition", "Zposition")
ROTATIONS = ("Xrotation", "Yrotation", "Zrotation")
relaxed = settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))


@dataclass
class Case:
    """A BVH file and what it says."""

    data: bytes
    names: list[str]
    parents: list[int]
    offsets: list[list[float]]
    channels: list[tuple[str, ...]]
    ends: list[tuple[int, list[float]]]
    values: list[list[float]]
    header: str


numbers = st.integers(-2_000_000, 2_000_000).map(lambda n: n / 10_000)
vectors = st.lists(numbers, min_size=3, max_size=3)
letters = st.characters(codec="latin-1", min_codepoint=33, exclude_characters="{}")
names = st.text(letters, max_size=6)


def are_euler_angles(channels: list[str]) -> bool:
    turns = [name for name in channels if name in ROTATIONS]
    return len(turns) <= 3 and all(a != b for a, b in itertools.pairwise(turns))


some_channels = (
    st.lists(st.sampled_from(POSITIONS + ROTATIONS * 2), max_size=6)
    .filter(lambda names: all(names.count(name) < 2 for name in POSITIONS))
    .filter(are_euler_angles)
    .map(tuple)
)
channel_lists = some_channels | st.permutations(ROTATIONS).map(tuple)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Random trees, channels, numbers and every oddity of spelling."""
    spelling = random.Random(draw(st.integers(0, 2**32)))
    newline = draw(st.sampled_from(["\n", "\r\n", "\r"]))
    glued = draw(st.booleans())  # braces on the same line
    count = draw(st.integers(1, 7))
    case = Case(b"", [], [], [], [], [], [], "")
    children: list[list[int]] = [[] for _ in range(count)]
    for joint in range(1, count):
        children[draw(st.integers(0, joint - 1))].append(joint)

    def cased(word: str) -> str:
        return spelling.choice([word, word.lower(), word.upper(), word.title()])

    def blank() -> str:
        return spelling.choice(["", " ", "\t", "  \t"])

    def line(text: str) -> str:
        return blank() + text + blank() + newline * spelling.choice([1, 1, 1, 2])

    def opening(title: str) -> str:
        return line(title + " {") if glued else line(title) + line("{")

    def emit(joint: int, parent: int) -> str:
        mine = len(case.names)
        name = draw(names)
        offset = draw(vectors)
        channels = draw(channel_lists)
        case.names.append(name)
        case.parents.append(parent)
        case.offsets.append(offset)
        case.channels.append(channels)
        text = opening(cased("ROOT" if parent < 0 else "JOINT") + " " + name)
        fields = [line("\t".join([cased("OFFSET"), *map(str, offset)]))]
        words = [cased("CHANNELS"), str(len(channels)), *map(cased, channels)]
        if channels or draw(st.booleans()):
            fields.append(line(" ".join(words)))
        spelling.shuffle(fields)
        text += "".join(fields)
        if draw(st.booleans()):
            tip = draw(vectors)
            case.ends.append((mine, tip))
            title = cased("End") + spelling.choice([" Site", " site", " Site tip of it", ""])
            text += opening(title) + line("OFFSET " + "  ".join(map(str, tip))) + line("}")
        for child in children[joint]:
            text += emit(child, mine)
        return text + line("}")

    mark = draw(st.sampled_from(["", "\xef\xbb\xbf"]))
    case.header = mark + line(cased("HIERARCHY")).lstrip() + emit(0, -1) + blank() + cased("MOTION")
    width = sum(map(len, case.channels))
    frames = draw(st.integers(0, 4)) if width else 0
    row = st.lists(numbers, min_size=width, max_size=width)
    case.values = draw(st.lists(row, min_size=frames, max_size=frames))
    motion = newline + line(f"{cased('Frames:')}{blank()}{frames}")
    motion += line(f"{cased('Frame Time:')}{blank()}0.0083333")
    motion += "".join(
        line(spelling.choice([" ", "\t", "  "]).join(map(str, v))) for v in case.values
    )
    case.data = (case.header + motion).encode("latin-1")
    return case


def positions_by_the_book(case: Case) -> tuple[FloatArray, FloatArray]:
    """World positions of joints and end sites: one frame and joint at a time, with SciPy."""
    joints: list[list[FloatArray]] = []
    tips: list[list[FloatArray]] = []
    for frame in case.values:
        left = list(frame)
        places: list[FloatArray] = []
        turns: list[Rotation] = []
        for parent, offset, channels in zip(case.parents, case.offsets, case.channels, strict=True):
            step, turn = np.array(offset), Rotation.identity()
            for channel in channels:
                value = left.pop(0)
                if channel in POSITIONS:
                    step["XYZ".index(channel[0])] = value
                else:
                    turn = turn * Rotation.from_euler(channel[0].lower(), value, degrees=True)
            if parent >= 0:
                step, turn = places[parent] + turns[parent].apply(step), turns[parent] * turn
            places.append(step)
            turns.append(turn)
        joints.append(places)
        tips.append([places[j] + turns[j].apply(tip) for j, tip in case.ends])
    return np.array(joints), np.array(tips)


def posed(clip: SkeletonClip) -> tuple[FloatArray, FloatArray]:
    world = world_rotations(clip.skeleton, clip.rotations)
    positions = world_positions(clip.skeleton, world, clip.translations)
    return positions, end_positions(clip.skeleton, world, positions)


def decoded(name: str) -> str:
    try:
        return name.encode("latin-1").decode("utf-8")
    except UnicodeDecodeError:
        return name


SIMPLE = """HIERARCHY
ROOT hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT head
  {
    OFFSET 0 70 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 100 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
1 2 3 10 20 30 40 50 60
4 5 6 11 21 31 41 51 61
"""


PARTS = {
    "frames": "Frames: 2",
    "time": "Frame Time: 0.01",
    "first": "1 2 3 10 20 30 40 50 60",
    "last": "4 5 6 11 21 31 41 51 61",
    "offset": "OFFSET 0 70 0",
    "channels": "CHANNELS 3 Zrotation Xrotation Yrotation",
}


def simple(**changes: str) -> bytes:
    """`SIMPLE` with some of its `PARTS` replaced."""
    text = SIMPLE
    for part, new in changes.items():
        text = text.replace(PARTS[part], new)
    return text.encode("latin-1")


@relaxed
@given(cases())
def test_reads_what_the_file_says(case: Case) -> None:
    clip = parse_bvh(case.data, units="cm")
    assert clip.skeleton.names == tuple(decoded(name) for name in case.names)
    assert clip.skeleton.parents.tolist() == case.parents
    assert clip.skeleton.offsets.tolist() == case.offsets
    assert clip.skeleton.end_parents.tolist() == [joint for joint, _ in case.ends]
    assert clip.skeleton.end_offsets.tolist() == [tip for _, tip in case.ends]
    assert clip.layout.channels == tuple(case.channels)
    assert clip.layout.detail("header") == case.header
    assert clip.frames == len(case.values)
    assert clip.frame_time == 0.0083333
    if case.values:
        joints, tips = positions_by_the_book(case)
        mine, my_tips = posed(clip)
        np.testing.assert_allclose(mine, joints, atol=1e-8)
        np.testing.assert_allclose(my_tips.reshape(tips.shape), tips, atol=1e-8)


@relaxed
@given(cases(), st.sampled_from(["cm", "m", "mm", "in"]))
def test_round_trip(case: Case, units: str) -> None:
    clip = parse_bvh(case.data, units=units)
    written = format_bvh(clip)
    again = parse_bvh(written, units=units)
    assert written.startswith(case.header.encode("latin-1"))
    assert again.layout == clip.layout
    assert again.skeleton.names == clip.skeleton.names
    assert again.frame_time == clip.frame_time
    np.testing.assert_allclose(again.translations, clip.translations, atol=1e-5)
    np.testing.assert_allclose(again.rotations, clip.rotations, atol=1e-6)
    motion = written[len(case.header) :].split(b"0.0083333", 1)[1].decode().split()
    assert "-0" not in motion
    assert not any("e" in word or word.endswith(".") for word in motion)
    turning = [name in ROTATIONS for names in case.channels for name in names]
    for word, turn in zip(motion, turning * clip.frames, strict=True):
        assert not turn or -180 < float(word) <= 180


@relaxed
@given(cases())
def test_layout_does_not_depend_on_the_motion(case: Case) -> None:
    layout = parse_bvh(case.data, units="m").layout
    rows = [" ".join(map(str, row)) for row in case.values[:1]]
    lines = [case.header, f"Frames: {len(rows)}", "Frame Time: 0.0083333", *rows, ""]
    other = layout.detail("newline").join(lines).encode("latin-1")
    assert parse_bvh(other, units="m").layout == layout


@pytest.mark.library
@pytest.mark.parametrize(
    "name",
    ["pybvh_data/bvh_test1", "pybvh_data/bvh_test2", "pymo/AV_8Walk_Meredith_HVHA_Rep1",
     "animated_drawings/jumping_jacks"],
)  # fmt: skip
def test_agrees_with_pybvh(name: str) -> None:
    pybvh = pytest.importorskip("pybvh")
    path = library_path("misc", "bvh", f"{name}.bvh")
    other = pybvh.read_bvh_file(str(path))
    clip = parse_bvh(path.read_bytes(), units="cm")
    assert list(clip.skeleton.names) == list(other.joint_names)
    np.testing.assert_allclose(posed(clip)[0], other.joint_positions(), atol=1e-3)


@pytest.mark.library
def test_real_files_come_back() -> None:
    paths = sorted(library_path("bandai").glob("*.bvh"))[::600]
    assert paths
    for path in [*paths, *sorted(library_path("misc", "bvh").rglob("*_0?.bvh"))[:3]]:
        clip = parse_bvh(path.read_bytes(), str(path))
        again = parse_bvh(format_bvh(clip))
        np.testing.assert_allclose(again.translations, clip.translations, atol=1e-5)
        np.testing.assert_allclose(again.rotations, clip.rotations, atol=1e-6)


@pytest.mark.parametrize(
    ("data", "said", "frames"),
    [
        (simple(frames="Frames: 3"), "Frames is '3': the file holds 2", 2),
        (simple(frames="Frames: 1"), "Frames is '1': the file holds 2", 2),
        (simple(frames="Frames: 1000000000000"), "the file holds 2", 2),
        (simple(frames="Frames: many"), "'many'", 2),
        (simple(frames=""), "no Frames line", 2),
        (simple(last="4 5 6 11"), "4 of 9 numbers", 1),
        (simple(last="4 5 6 11 21 31 41 51 -"), "8 of 9 numbers", 1),
        (simple(last="4 5 6 11 21 31 41 51 1.5e-"), "8 of 9 numbers", 1),
        (simple(last="4 5 6 11\n21 31 41\n51 61"), "one on a line", 2),
        (simple(last="4 5 6 11\n21 31 41\n51"), "8 of 9 numbers", 1),
        (simple(last="4 5 6 7 8 9 1 2 3 4 5 6 7 8 9 1 2 3"), "one on a line", 3),
        (simple(time="Frame Time: 0"), "1/30 s assumed", 2),
        (simple(time="Frame Time: -0.1"), "1/30 s assumed", 2),
        (simple(time="Frame Time: fast"), "1/30 s assumed", 2),
        (simple(time="Frame Time: nan"), "1/30 s assumed", 2),
        (simple(time=""), "no Frame Time", 2),
        (SIMPLE.replace("head", "hips").encode(), "stands for 2 joints", 2),
        (SIMPLE.encode(), "unit estimated as cm", 2),
        (SIMPLE.replace("70", "3").replace("100", "3").encode(), "unit assumed to be cm", 2),
    ],
)
def test_repairs_are_recorded(data: bytes, said: str, frames: int) -> None:
    clip = parse_bvh(data)
    assert any(said in f"{repair.what}" for repair in clip.repairs), clip.repairs
    assert clip.frames == frames
    np.testing.assert_allclose(clip.translations[0, 0], [1, 2, 3])
    assert math.isclose(clip.frame_time, 1 / 30 if "1/30" in str(clip.repairs) else 0.01)
    again = parse_bvh(format_bvh(clip))
    assert (again.layout, again.frames) == (clip.layout, clip.frames)


def test_nothing_is_repaired_in_a_sound_file_with_known_units() -> None:
    assert parse_bvh(SIMPLE.encode(), units="cm").repairs == ()


def test_given_units_scale_all_lengths() -> None:
    metres, plain = parse_bvh(SIMPLE.encode(), units="m"), parse_bvh(SIMPLE.encode(), units="cm")
    assert (metres.layout.unit, metres.layout.unit_source) == ("m", "given")
    np.testing.assert_allclose(metres.translations, 100 * plain.translations)
    np.testing.assert_allclose(metres.skeleton.end_offsets, 100 * plain.skeleton.end_offsets)
    with pytest.raises(UsageError):
        parse_bvh(SIMPLE.encode(), units="parsec")


def test_unit_from_position_channels_where_the_offsets_are_empty() -> None:
    text = SIMPLE.replace("OFFSET 0 70 0", "OFFSET 0 0 0").replace("OFFSET 0 100 0", "OFFSET 0 0 0")
    text = text.replace("CHANNELS 3 Z", "CHANNELS 6 Xposition Yposition Zposition Z")
    text = text.replace("30 40 50", "30 0 1.7 0 40 50").replace("31 41 51", "31 0 1.7 0 41 51")
    clip = parse_bvh(text.encode())
    assert clip.layout.unit == "m"
    np.testing.assert_allclose(clip.translations[:, 1], [[0, 170, 0]] * 2)


def test_position_channels_replace_the_offset_axis_by_axis() -> None:
    data = simple(channels="CHANNELS 1 Zposition", first="1 2 3 10 20 30 9", last="")
    clip = parse_bvh(data, units="cm")
    np.testing.assert_allclose(clip.translations[0, 1], [0, 70, 9])


@pytest.mark.parametrize(
    ("data", "place", "said"),
    [
        (simple(first="1 2 3 10 20 nan 40 50 60"), "line 19", "'nan' for hips Yrotation"),
        (simple(last="1 2 3 10 20 30 40 50 -inf"), "line 20", "'-inf' for head Yrotation"),
        (simple(first="1 2 3 10 20 30 40 50 1e300"), "line 19", "head Yrotation"),
        (simple(first="1 2 3 10 20 30 40 5o 60"), "line 19", "'5o' for head Xrotation"),
        (simple(first="1 2 3 10 20 30 40 5_0 60"), "line 19", "'5_0' for head Xrotation"),
        (simple(first="1,0 2 3 10 20 30 40 50 60"), "line 19", "decimal points"),
        (simple(first="1 2 3 10 20 30 40 50"), "line 19", "8 numbers where the channels need 9"),
        (simple(last="1 2 3 10 20 30 40 50 60 70"), "line 20", "10 numbers"),
        (simple(offset="OFFSET 0 x 0"), "line 8", "OFFSET"),
        (simple(offset="OFFSET 0 nan 0"), "line 8", "OFFSET"),
        (simple(offset=""), "line 14", "without OFFSET"),
        (simple(offset="OFFSET 0 70 0\nOFFSET 0 70 0"), "line 9", "second OFFSET"),
        (simple(channels="CHANNELS 3 Zrotation Xrotation Wrotation"), "line 9", "Wrotation"),
        (simple(channels="CHANNELS 1000000000000"), "line 9", "CHANNELS"),
        (simple(channels="CHANNELS 2 Xposition Xposition"), "line 9", "twice"),
        (simple(channels="CHANNELS 2 Zrotation Zrotation"), "line 9", "no"),
        (SIMPLE.replace("}\nMOTION", "MOTION").encode(), "line 15", "MOTION"),
        (SIMPLE.partition("MOTION")[0].encode(), "line 16", "file ends"),
        (b"", "line 1", "file ends"),
        (b"PK\x03\x04 zipped", "line 1", "no BVH"),
        (SIMPLE.replace("MOTION", "ROOT b {OFFSET 0 0 0}\nMOTION").encode(), "line 16", "roots"),
    ],
)
def test_errors_name_file_and_place(data: bytes, place: str, said: str) -> None:
    with pytest.raises((FormatError, UnsupportedError)) as caught:
        parse_bvh(data, "walk.bvh")
    assert str(caught.value).startswith(f"walk.bvh, {place}: ")
    assert said in str(caught.value)


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_damaged_files_give_a_clip_or_a_named_error(data: st.DataObject) -> None:
    damaged = bytearray(SIMPLE.encode())
    kind = data.draw(st.sampled_from(["cut", "flip", "random", "splice"]))
    if kind == "cut":
        del damaged[data.draw(st.integers(0, len(damaged))) :]
    elif kind == "flip":
        for bit in data.draw(
            st.lists(st.integers(0, 8 * len(damaged) - 1), min_size=1, max_size=9)
        ):
            damaged[bit // 8] ^= 1 << bit % 8
    elif kind == "splice":
        start, stop = sorted(data.draw(st.tuples(*[st.integers(0, len(damaged))] * 2)))
        damaged[start:stop] = data.draw(st.binary(max_size=20))
    else:
        damaged = bytearray(data.draw(st.sampled_from([b"", b"HIERARCHY\nROOT a\n{\n"])))
        damaged += data.draw(st.binary(max_size=200))
    try:
        clip = parse_bvh(bytes(damaged), "odd.bvh")
    except MotifoldError as error:
        assert re.match(r"odd\.bvh, line \d+: ", str(error))  # noqa: PT017
    else:
        assert np.isfinite(clip.translations).all()
        assert np.isfinite(clip.rotations).all()
        assert parse_bvh(format_bvh(clip)).layout == clip.layout


def nested(joints: int, channels: str = "CHANNELS 0") -> str:
    block = f"JOINT j {{ OFFSET 0 1 0 {channels} "
    return (
        "HIERARCHY ROOT r { OFFSET 0 0 0 CHANNELS 1 Xrotation "
        + block * joints
        + "}" * (joints + 1)
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (nested(20_000) + " MOTION", "more than 10000 joints"),
        (nested(9_999) + " MOTION\n" + "0\n" * 3000, "numbers"),
        ("HIERARCHY ROOT r {" + "OFFSET 0 0 0 " + "End {OFFSET 0 0 0} " * 20_000, "end sites"),
        (SIMPLE.replace("CHANNELS 3", "CHANNELS 999999999999"), "CHANNELS"),
    ],
)
def test_hostile_headers_fail_quickly(text: str, said: str) -> None:
    start = time.perf_counter()
    with pytest.raises((UnsupportedError, FormatError), match=said):
        parse_bvh(text.encode(), "hostile.bvh")
    assert time.perf_counter() - start < 5


def test_deep_nesting_is_read() -> None:
    clip = parse_bvh(
        (nested(3_000) + " MOTION Frames: 1\nFrame Time: 0.1\n90").encode(), units="cm"
    )
    assert (clip.skeleton.joints, clip.frames) == (3_001, 1)


def test_lengths_in_metres_keep_a_hundredth_of_a_micrometre() -> None:
    clip = parse_bvh(SIMPLE.encode(), units="m")
    moved = replace(clip, translations=clip.translations + 1.23456789e-4)
    again = parse_bvh(format_bvh(moved), units="m")
    np.testing.assert_allclose(again.translations[:, 0], moved.translations[:, 0], atol=1e-6)


def test_a_clip_without_bvh_layout_gets_a_header_in_centimetres() -> None:
    clip = parse_bvh(SIMPLE.encode(), units="in")
    bare = replace(clip, layout=Layout("amc", "in", "declared", 2.54))
    again = parse_bvh(format_bvh(bare), units="cm")
    assert again.skeleton.names == clip.skeleton.names
    np.testing.assert_allclose(again.skeleton.end_offsets, clip.skeleton.end_offsets, atol=1e-6)
    for mine, theirs in zip(posed(again), posed(clip), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-5)
