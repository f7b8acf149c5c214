"""TRC files: round trips, an independent reading with the csv module, mendings, damage."""

from __future__ import annotations

import csv
import io
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from library import library_path

from motifold.codec.clip import Layout, MarkerClip
from motifold.codec.errors import FormatError, MotifoldError, UsageError
from motifold.codec.formats.trc import format_trc, parse_trc

CENTIMETRES = {"mm": 0.1, "cm": 1.0, "m": 100.0, "in": 2.54}
NAMES = st.text(
    st.characters(codec="utf-8", exclude_categories=("Cc", "Cs", "Zl", "Zp", "Zs")) | st.just(" "),
    min_size=1,
    max_size=8,
).filter(lambda name: name.strip() == name)
REAL = [
    "bmc/motion_capture_run.trc",
    "bmc/walk.trc",
    "bmc/walk1.trc",
    "bmc/walk2.trc",
    "opensim/subject01_static.trc",
    "opensim/subject01_walk.trc",
]


@st.composite
def clips(draw: st.DrawFn) -> MarkerClip:
    names = draw(st.lists(NAMES, min_size=1, max_size=5))
    frames = draw(st.integers(0, 7))
    seed = draw(st.integers(0, 2**32 - 1))
    random = np.random.default_rng(seed)
    reach = draw(st.sampled_from([0.001, 1.0, 100.0, 5e6]))
    positions = random.uniform(-reach, reach, (frames, len(names), 3))
    positions[random.random((frames, len(names))) < draw(st.sampled_from([0, 0.3, 1]))] = np.nan
    unit = draw(st.sampled_from(list(CENTIMETRES)))
    details = {}
    if draw(st.booleans()):
        details["newline"] = "crlf"
    if draw(st.booleans()):
        details["first_frame"] = str(draw(st.integers(0, 10**6)))
    if draw(st.booleans()):
        details["start_time"] = str(draw(st.integers(-50, 5000)) / 8)
    rate = draw(st.sampled_from([24.0, 59.94, 100.0, 119.88, 150.0, 1000.0]))
    layout = Layout("trc", unit, "declared", CENTIMETRES[unit], details=tuple(details.items()))
    return MarkerClip(tuple(names), 1.0 / rate, positions, layout)


def text_of(rows: list[str], header: str = "100\t100\t{n}\t2\tcm\t100\t1\t{n}", newline: str = "\n",
            names: str = "Frame#\tTime\tHead\t\t\tLeft hand\t\t") -> bytes:  # fmt: skip
    """A TRC file of two markers, of the given rows."""
    fields = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame"
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tC:\\take 1.trc",
        "\t".join([*fields.split(), "OrigNumFrames"]),
        header.format(n=len(rows)),
        names,
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2",
        "",
        *rows,
        "",
    ]
    return newline.join(lines).encode()


def repairs_of(clip: MarkerClip) -> str:
    return "; ".join(f"{repair.place}: {repair.what}" for repair in clip.repairs)


@given(clips())
def test_round_trip(clip: MarkerClip) -> None:
    data = format_trc(clip)
    back = parse_trc(data)
    assert back.names == clip.names
    assert back.frame_time == pytest.approx(clip.frame_time, rel=1e-11)
    assert back.positions.shape == clip.positions.shape
    np.testing.assert_array_equal(back.seen, clip.seen)
    np.testing.assert_allclose(back.positions, clip.positions, rtol=0, atol=1e-6)
    assert back.layout.unit == clip.layout.unit
    assert not back.repairs
    assert format_trc(back) == data or not clip.frames  # no frames, no first frame
    assert parse_trc(format_trc(back)).layout == back.layout


@given(clips(), clips())
def test_layout_holds_nothing_of_one_file(one: MarkerClip, other: MarkerClip) -> None:
    other = replace(
        other, layout=replace(one.layout, details=()), names=one.names, frame_time=one.frame_time,
        positions=np.resize(other.positions if other.positions.size else [0.0],
                            (other.frames, len(one.names), 3)),
    )  # fmt: skip
    one = replace(one, layout=replace(one.layout, details=()))
    assert parse_trc(format_trc(one)).layout == parse_trc(format_trc(other)).layout


def by_csv(data: bytes, centimetres: float) -> np.ndarray:
    """Positions in centimetres as a plain reader of tab-separated values sees them."""
    rows = list(csv.reader(io.StringIO(data.decode("latin-1"), newline=""), delimiter="\t"))
    body = [row for row in rows[5:] if row and row[0].strip()]
    width = max(map(len, body))
    padded = [row + [""] * (width - len(row)) for row in body]
    values = np.array([[float(cell or "nan") for cell in row] for row in padded])
    count = (width - 2) // 3
    return values[:, 2 : 2 + 3 * count].reshape(len(body), count, 3) * centimetres


@pytest.mark.library
@pytest.mark.parametrize("name", REAL)
def test_real_files_against_csv(name: str) -> None:
    data = Path(library_path("misc", "markers", *name.split("/"))).read_bytes()
    clip = parse_trc(data, name)
    expected = by_csv(data, 0.1)
    assert np.isnan(expected[:, len(clip.names) :]).all()
    np.testing.assert_allclose(clip.positions, expected[:, : len(clip.names)], rtol=0, atol=1e-9)
    assert parse_trc(format_trc(clip)).layout == clip.layout


CELLS = st.sampled_from(["", "NaN", "nan", "1", "-2.5", "3e2", " 7.25 ", ".5", "-0.000001", "+4."])


@given(
    st.lists(st.lists(CELLS, min_size=6, max_size=6), min_size=1, max_size=6),
    st.sampled_from(["\n", "\r\n", "\r"]),
    st.sampled_from(list(CENTIMETRES)),
    st.booleans(),
)
def test_cells_against_csv(rows: list[list[str]], newline: str, unit: str, stripped: bool) -> None:
    lines = [f"{i + 1}\t{i / 100}\t" + "\t".join(row) for i, row in enumerate(rows)]
    lines = [line.rstrip("\t") if stripped else line for line in lines]
    header = "100\t100\t{n}\t2\t%s\t100\t1\t{n}" % unit  # noqa: UP031
    data = text_of(lines, header, newline)
    clip = parse_trc(data)
    expected = np.full((len(rows), 2, 3), np.nan)
    found = by_csv(data.replace(newline.encode(), b"\n"), CENTIMETRES[unit])
    expected[:, : found.shape[1]] = found  # trailing gaps may have no cells at all
    gaps = np.isnan(expected).any(axis=2)
    expected[gaps] = np.nan
    np.testing.assert_allclose(clip.positions, expected, rtol=1e-12, atol=0)
    assert clip.names == ("Head", "Left hand")


def test_frame_and_marker_counts_that_are_off_are_mended() -> None:
    rows = ["1\t0\t1\t2\t3\t4\t5\t6", "2\t0.01\t1\t2\t3\t4\t5\t6"]
    clip = parse_trc(text_of(rows, "100\t100\t999999999999\t77\tcm\t100\t1\t5"))
    assert clip.positions.shape == (2, 2, 3)
    assert "NumFrames is '999999999999', but there are 2" in repairs_of(clip)
    assert "NumMarkers is '77', but there are 2" in repairs_of(clip)


def test_markers_without_a_name_are_kept() -> None:
    row = "1\t0\t" + "\t".join(map(str, range(9)))
    clip = parse_trc(text_of([row, row.replace("1\t0", "2\t0.01", 1)]))
    assert clip.names == ("Head", "Left hand", "M003")
    np.testing.assert_array_equal(clip.positions[:, 2], [[6, 7, 8]] * 2)
    assert "1 markers without a name" in repairs_of(clip)


def test_names_beyond_the_marker_count_without_data_are_left_out() -> None:
    names = "Frame#\tTime\tHead\t\t\tLeft hand\t\t\tV_Hip\t\t\t"
    clip = parse_trc(text_of(["1\t0\t1\t2\t3\t4\t5\t6\t\t\t"], names=names))
    assert clip.names == ("Head", "Left hand")
    assert "1 names beyond NumMarkers" in repairs_of(clip)


def test_missing_unit_and_given_unit() -> None:
    row = "1\t0\t10\t20\t30\t4\t5\t6"
    assumed = parse_trc(text_of([row], "100\t100\t1\t2\t\t100\t1\t1"))
    assert assumed.layout.unit == "mm"
    assert assumed.layout.unit_source == "estimated"
    assert "millimetres are assumed" in repairs_of(assumed)
    np.testing.assert_allclose(assumed.positions[0, 0], [1, 2, 3])
    given_unit = parse_trc(text_of([row]), units="m")
    assert given_unit.layout.unit_source == "given"
    np.testing.assert_allclose(given_unit.positions[0, 0], [1000, 2000, 3000])
    with pytest.raises(FormatError, match=r"line 3.*furlong"):
        parse_trc(text_of([row], "100\t100\t1\t2\tfurlong\t100\t1\t1"))
    with pytest.raises(UsageError):
        parse_trc(text_of([row]), units="furlong")


def test_missing_rate_comes_from_the_times_or_is_assumed() -> None:
    rows = [f"{i + 1}\t{i / 50}\t1\t2\t3\t4\t5\t6" for i in range(4)]
    clip = parse_trc(text_of(rows, "\t\t4\t2\tcm\t\t1\t4"))
    assert clip.frame_time == pytest.approx(1 / 50)
    assert "50 frames per second from the time column" in repairs_of(clip)
    alone = parse_trc(text_of(rows[:1], "0\t\t1\t2\tcm\t\t1\t1"))
    assert alone.frame_time == pytest.approx(1 / 100)
    assert "assumed" in repairs_of(alone)


def test_irregular_times_and_frame_numbers_are_named() -> None:
    rows = [f"{n}\t{t}\t1\t2\t3\t4\t5\t6" for n, t in ((1, 0), (2, 0.01), (5, 0.05))]
    clip = parse_trc(text_of(rows))
    assert "line 9: times do not follow" in repairs_of(clip)
    assert "line 9: frame numbers do not count up" in repairs_of(clip)


def test_start_is_kept_and_written_back() -> None:
    rows = [f"{n}\t{3 + n / 100:.3f}\t1\t2\t3\t4\t5\t6" for n in (20, 21)]
    clip = parse_trc(text_of(rows))
    assert not clip.repairs
    written = format_trc(clip).decode().splitlines()
    assert [line.split("\t")[:2] for line in written[6:]] == [
        ["20", "3.200000"],
        ["21", "3.210000"],
    ]


@pytest.mark.parametrize("frames", [0, 1])
def test_no_frames_and_one_frame(frames: int) -> None:
    clip = parse_trc(text_of(["1\t0\t1\t2\t3\t4\t5\t6"][:frames]))
    assert clip.positions.shape == (frames, 2, 3)
    assert not clip.repairs


@pytest.mark.parametrize(
    "cell", ["abc", "inf", "-Infinity", "1e999", "1_000", "1,5", "0x1F", "9e9"]
)
def test_garbage_cells_are_refused_with_their_line(cell: str) -> None:
    rows = ["1\t0\t1\t2\t3\t4\t5\t6", f"2\t0.01\t1\t{cell}\t3\t4\t5\t6"]
    with pytest.raises(FormatError, match=r"walk\.trc, line 8"):
        parse_trc(text_of(rows), "walk.trc")


def test_marker_with_a_coordinate_missing_becomes_a_gap() -> None:
    clip = parse_trc(text_of(["1\t0\t1\t\t3\t4\t5\t6"]))
    np.testing.assert_array_equal(clip.seen, [[False, True]])
    assert "line 7: 1 positions with a coordinate missing" in repairs_of(clip)


@pytest.mark.parametrize(("name", "fits"), [("a b", True), ("a\tb", False), ("a\nb", False)])
def test_names_that_do_not_fit_are_refused(name: str, fits: bool) -> None:
    clip = replace(parse_trc(text_of(["1\t0\t1\t2\t3\t4\t5\t6"])), names=(name, "x"))
    if fits:
        assert parse_trc(format_trc(clip)).names == clip.names
    else:
        with pytest.raises(UsageError):
            format_trc(clip)


@given(clips(), st.floats(0, 1))
def test_truncated_files_keep_what_is_there(clip: MarkerClip, share: float) -> None:
    data = format_trc(clip)
    whole = parse_trc(data)
    cut = data[: int(share * len(data))]
    try:
        part = parse_trc(cut)
    except FormatError:
        assert cut.count(b"\n") < 4  # the header is cut off
        return
    if part.frames == 0:
        return
    assert part.frames <= whole.frames
    kept = part.positions.copy()
    if not cut.endswith(b"\n"):  # the last number of a full line may be cut, and nobody can tell
        kept[-1, -1] = np.nan
    known = ~np.isnan(kept)
    np.testing.assert_array_equal(kept[known], whole.positions[: part.frames][known])
    if part.frames < whole.frames:
        assert "NumFrames" in repairs_of(part)


@given(clips(), st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), max_size=4))
def test_flipped_bytes_give_a_clip_or_an_error(
    clip: MarkerClip, flips: list[tuple[float, int]]
) -> None:
    data = bytearray(format_trc(clip))
    for place, value in flips:
        data[int(place * (len(data) - 1))] = value
    survives(bytes(data))


@given(st.binary(max_size=300), st.booleans())
def test_random_bytes_give_a_clip_or_an_error(data: bytes, headed: bool) -> None:
    survives(text_of([])[:-1] + data if headed else data)


def survives(data: bytes) -> None:
    try:
        clip = parse_trc(data, "some file")
    except MotifoldError:
        return
    assert clip.positions.shape == (clip.frames, len(clip.names), 3)
    assert (np.abs(clip.positions[clip.seen]) <= 1.0000001e7).all()
    assert np.isnan(clip.positions[~clip.seen]).all()
    again = parse_trc(format_trc(clip))
    np.testing.assert_array_equal(again.seen, clip.seen)
    assert again.layout == replace(clip.layout, unit_source=again.layout.unit_source)


def test_memory_stays_in_proportion_to_the_file() -> None:
    names = "Frame#\tTime" + "\tM\t\t" * 200_000
    data = text_of(["1\t0"] * 200_000, names=names)  # 40 billion markers' positions
    start = time.monotonic()
    with pytest.raises(FormatError, match="shorter than the line of marker names"):
        parse_trc(data)
    assert time.monotonic() - start < 5
