"""C3D files: built with the library's writer, read against the library and ezc3d, damaged."""

from __future__ import annotations

import io
import struct
import time
import warnings
from pathlib import Path
from typing import Any

import c3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from library import library_path

from motifold.codec.clip import MarkerClip
from motifold.codec.errors import FormatError, MotifoldError, UnsupportedError, UsageError
from motifold.codec.formats.c3d_file import parse_c3d
from motifold.codec.formats.trc import format_trc, parse_trc

CENTIMETRES = {"mm": 0.1, "cm": 1.0, "m": 100.0, "in": 2.54}
REAL = [
    "bmc/Gait.c3d",
    "pycgm/59993_Frame_Static.c3d",
    "pycgm/Movement_trial.c3d",
    "pycgm/RoboStatic.c3d",
    "pycgm/Sample_Static.c3d",
    "pycgm/Static_trial.c3d",
    "pyomeca/markers_analogs.c3d",
]


def written(
    points: np.ndarray,
    gaps: np.ndarray | None = None,
    labels: list[str] | None = None,
    units: str = "mm  ",
    rate: float = 100.0,
    scale: float = -1.0,
    analog: int = 0,
    first: int = 1,
    lists: dict[str, list[str]] | None = None,
) -> bytes:
    """A C3D file of ``points`` (frames, markers, 3) in file units, by the library's writer."""
    frames, markers = points.shape[:2]
    writer = c3d.Writer(
        point_rate=rate, analog_rate=2 * rate if analog else 0, point_scale=scale, point_units=units
    )
    labels = [f"L{number}" for number in range(markers)] if labels is None else labels
    for number, start in enumerate(range(0, len(labels), 255), 1):
        part = labels[start : start + 255]
        width = max(len(label.encode("latin-1")) for label in part)
        text = "".join(label.ljust(width) for label in part)
        key = "LABELS" if number == 1 else f"LABELS{number}"
        writer.point_group.add_str(key, "", text, width, len(part))
    for key, names in (lists or {}).items():
        width = max(map(len, names))
        text = "".join(name.ljust(width) for name in names)
        writer.point_group.add_str(key, "", text, width, len(names))
    if markers > 255:  # the writer's own would not fit into one parameter
        writer.point_group.add_str("DESCRIPTIONS", "", "", 1, 0)
    if analog:
        writer.set_analog_labels([f"A{number}" for number in range(analog)])
    writer.set_start_frame(first)
    for frame in range(frames):
        values = np.zeros((markers, 5), np.float32)
        values[:, :3] = points[frame]
        if gaps is not None:
            values[gaps[frame], 3] = -1
        pair = np.empty((1, 2), object)  # the writer guesses wrongly from other nestings
        pair[0, 0], pair[0, 1] = values, np.ones((analog, 2 if analog else 0))
        writer.add_frames(pair)
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        writer.write(buffer)
    return buffer.getvalue()


def repairs_of(clip: MarkerClip) -> str:
    return "; ".join(f"{repair.place}: {repair.what}" for repair in clip.repairs)


@st.composite
def motions(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    frames, markers = draw(st.integers(1, 12)), draw(st.integers(1, 5))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    points = random.uniform(-3000, 3000, (frames, markers, 3)).astype(np.float32)
    return points, random.random((frames, markers)) < draw(st.sampled_from([0, 0.4]))


@given(
    motions(),
    st.sampled_from(list(CENTIMETRES)),
    st.sampled_from([50.0, 119.88, 240.0]),
    st.integers(0, 3),
    st.integers(1, 60000),
)
def test_what_the_writer_wrote_is_read(
    motion: tuple[np.ndarray, np.ndarray], unit: str, rate: float, analog: int, first: int
) -> None:
    points, gaps = motion
    clip = parse_c3d(written(points, gaps, units=unit, rate=rate, analog=analog, first=first))
    np.testing.assert_array_equal(clip.seen, ~gaps)
    expected = points.astype(float) * CENTIMETRES[unit]
    np.testing.assert_allclose(clip.positions[~gaps], expected[~gaps], rtol=1e-12)
    assert clip.names == tuple(f"L{number}" for number in range(points.shape[1]))
    assert clip.frame_time == 1 / rate
    assert (clip.layout.format, clip.layout.unit) == ("c3d", unit)
    assert clip.layout.detail("first_frame", "1") == str(first)
    assert (f"{analog} analog channels" in repairs_of(clip)) == (analog > 0)

    restored = parse_trc(format_trc(clip))
    assert restored.names == clip.names
    np.testing.assert_array_equal(restored.seen, clip.seen)
    np.testing.assert_allclose(restored.positions, clip.positions, rtol=0, atol=1e-6)
    assert restored.layout.detail("first_frame", "1") == str(first)
    assert not restored.repairs


@given(motions())
def test_integer_files(motion: tuple[np.ndarray, np.ndarray]) -> None:
    points, gaps = motion
    clip = parse_c3d(written(points, gaps, scale=0.5))
    np.testing.assert_array_equal(clip.seen, ~gaps)
    error = np.abs(clip.positions - points * 0.1)[~gaps]
    assert (error <= 0.5 * 0.1 + 1e-6).all()  # the writer cuts off below one unit of the scale


@given(motions(), st.floats(0, 1))
def test_truncated_files_keep_the_frames_that_are_there(
    motion: tuple[np.ndarray, np.ndarray], share: float
) -> None:
    points, gaps = motion
    data = written(points, gaps, analog=1)
    whole = parse_c3d(data)
    start = len(data) - -(-len(points) * (16 * points.shape[1] + 8) // 512) * 512
    length = start + int(share * (len(data) - start))
    part = parse_c3d(data[:length])
    held = min(len(points), (length - start) // (16 * points.shape[1] + 8))
    assert part.frames == held
    np.testing.assert_array_equal(part.positions, whole.positions[:held])
    assert (f"claims {len(points)} frames, the file holds {held}" in repairs_of(part)) == (
        held < len(points)
    )


def test_many_labels_and_missing_ones() -> None:
    points = np.zeros((2, 300, 3))
    labels = [f"marker {number}" for number in range(300)]
    assert parse_c3d(written(points, labels=labels)).names == tuple(labels)
    clip = parse_c3d(written(points, labels=labels[:298]))
    assert clip.names == (*labels[:298], "M299", "M300")
    assert "2 markers without a name" in repairs_of(clip)


def test_labels_in_latin_1_and_with_control_characters() -> None:
    data = written(np.zeros((1, 3, 3)), labels=["Fus", "a-b", "c"])
    clip = parse_c3d(data.replace(b"Fus", b"Fu\xdf").replace(b"a-b", b"a\tb"))
    assert clip.names == ("Fuß", "a b", "c")
    assert "control characters" in repairs_of(clip)


def test_model_outputs_are_left_out() -> None:
    points = np.arange(12.0).reshape(1, 4, 3)
    labels = ["LASI", "LHipAngles", "RASI", "LAnkleForce"]
    lists = {"ANGLES": ["LHipAngles", "RHipAngles"], "FORCES": ["LAnkleForce"]}
    clip = parse_c3d(written(points, labels=labels, lists=lists))
    assert clip.names == ("LASI", "RASI")
    np.testing.assert_allclose(clip.positions[0], points[0, [0, 2]] / 10)
    assert "2 model outputs" in repairs_of(clip)
    assert "1 angles, 1 forces" in repairs_of(clip)
    with pytest.raises(UnsupportedError, match="no marker positions"):
        parse_c3d(written(points, labels=labels, lists={"ANGLES": labels}))


def test_units() -> None:
    points = np.full((1, 1, 3), 10.0)
    blank = parse_c3d(written(points, units="    "))
    assert blank.layout.unit_source == "estimated"
    assert "millimetres are assumed" in repairs_of(blank)
    np.testing.assert_allclose(blank.positions, 1.0)
    told = parse_c3d(written(points), units="m")
    assert told.layout.unit_source == "given"
    np.testing.assert_allclose(told.positions, 1000.0)
    with pytest.raises(FormatError, match=r"a\.c3d, POINT:UNITS: unknown unit 'ells'"):
        parse_c3d(written(points, units="ells"), "a.c3d")
    with pytest.raises(UsageError):
        parse_c3d(written(points), units="ells")


@pytest.mark.parametrize("value", [np.inf, 3e8])
def test_positions_from_nowhere_are_refused(value: float) -> None:
    points = np.zeros((3, 2, 3))
    points[2, 1, 0] = value
    with pytest.raises(FormatError, match="frame 3, marker L1"):
        parse_c3d(written(points))


def test_nan_is_a_gap() -> None:
    points = np.ones((1, 2, 3))
    points[0, 1, 2] = np.nan
    np.testing.assert_array_equal(parse_c3d(written(points)).seen, [[True, False]])


def test_frame_numbers_beyond_16_bits() -> None:
    points = np.arange(7.0).repeat(3).reshape(7, 1, 3)
    clip = parse_c3d(written(points, first=200_000))
    np.testing.assert_allclose(clip.positions, points / 10)
    # The writer takes the high word of its own number for 65535, not 65536.
    assert clip.layout.detail("first_frame") == str(200_000 - 200_000 // 65536)


def test_hostile_header_takes_no_time() -> None:
    data = bytearray(written(np.zeros((1, 1, 3))))
    struct.pack_into("<HH", data, 6, 1, 65534)  # first and last frame
    begin = time.monotonic()
    clip = parse_c3d(bytes(data))
    assert clip.frames <= 32  # what the last block can hold
    assert "claims 65534 frames" in repairs_of(clip)
    struct.pack_into("<H", data, 2, 65535)  # points
    with pytest.raises(FormatError):
        parse_c3d(bytes(data))
    assert time.monotonic() - begin < 2


@pytest.mark.filterwarnings("error")
def test_the_library_is_kept_quiet(capfd: pytest.CaptureFixture[str]) -> None:
    filters = list(warnings.filters)
    data = written(np.zeros((4, 2, 3)))
    parse_c3d(data)
    parse_c3d(data[:-300])
    with pytest.raises(FormatError, match=r"not a readable C3D file"):
        parse_c3d(b"\x02\x51" + data[2:])
    assert capfd.readouterr() == ("", "")
    assert warnings.filters == filters


def survives(data: bytes) -> None:
    try:
        clip = parse_c3d(data, "some file")
    except MotifoldError:
        return
    assert clip.positions.shape == (clip.frames, len(clip.names), 3)
    assert clip.positions.nbytes <= 16 * len(data) + 1000
    assert np.isnan(clip.positions[~clip.seen]).all()
    restored = parse_trc(format_trc(clip))
    np.testing.assert_array_equal(restored.seen, clip.seen)
    assert restored.names == clip.names


SAMPLE = written(
    np.random.default_rng(1).uniform(-999, 999, (5, 3, 3)),
    labels=["LASI", "RASI", "LHipAngles"],
    lists={"ANGLES": ["LHipAngles"]},
    analog=2,
)


@settings(max_examples=400)
@given(
    st.integers(0, len(SAMPLE)),
    st.lists(st.tuples(st.integers(0, 1500), st.integers(0, 255)), max_size=4),
)
def test_damaged_bytes_give_a_clip_or_an_error(length: int, flips: list[tuple[int, int]]) -> None:
    data = bytearray(SAMPLE)
    for place, value in flips:
        data[place] = value
    survives(bytes(data[:length]))
    survives(bytes(data))


@given(st.binary(max_size=2000), st.booleans())
def test_random_bytes_give_a_clip_or_an_error(data: bytes, headed: bool) -> None:
    survives(SAMPLE[:512] + data if headed else data)


def by_library(data: bytes) -> tuple[list[str], np.ndarray]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        reader = c3d.Reader(io.BytesIO(data))
        points = np.stack([points for _, points, _ in reader.read_frames()]).astype(float)
        positions = np.where(points[:, :, 3:4] < 0, np.nan, points[:, :, :3])
        return [str(label).strip() for label in reader.point_labels], positions


def by_ezc3d(path: Path) -> tuple[list[str], np.ndarray]:
    ezc3d: Any = pytest.importorskip("ezc3d")
    file = ezc3d.c3d(str(path))
    labels = [label.strip() for label in file["parameters"]["POINT"]["LABELS"]["value"]]
    return labels, np.asarray(file["data"]["points"][:3]).transpose(2, 1, 0)


@pytest.mark.library
@pytest.mark.parametrize("oracle", ["c3d", "ezc3d"])
@pytest.mark.parametrize("name", REAL)
def test_real_files_against_other_readers(name: str, oracle: str) -> None:
    path = Path(library_path("misc", "markers", *name.split("/")))
    data = path.read_bytes()
    clip = parse_c3d(data, name)
    labels, points = by_library(data) if oracle == "c3d" else by_ezc3d(path)
    # Labels may repeat: the kept points are found in order.
    places, after = [], 0
    for label in clip.names:
        after = labels.index(label, after) + 1
        places.append(after - 1)
    np.testing.assert_allclose(clip.positions, points[:, places] * 0.1, rtol=1e-6, atol=1e-6)
    dropped = [label for place, label in enumerate(labels) if place not in places]
    outputs = ("Angle", "Force", "GRF", "Moment", "Power")
    assert all(any(kind in label for kind in outputs) for label in dropped)
