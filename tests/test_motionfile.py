"""The envelope of versions 2 to 4: whole files come back, and nothing else passes for one."""

from __future__ import annotations

import binascii
import struct
import time
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle_motion import crc_8

from motifold.codec.anyfile import check_whole, unpack_any
from motifold.codec.errors import DamagedError, MotifoldError, VersionError
from motifold.codec.geometry.metrics import Errors
from motifold.codec.streams.envelope import varint
from motifold.codec.version2.motionfile import (
    MAGIC,
    RUN_FRAMES,
    VERSIONS,
    MotionFile,
    pack_motion,
    runs_of,
    unpack_motion,
)
from motifold.codec.version2.pieces import check_byte

FIXED = struct.Struct("<2sBHH")  # magic, version, checksum of header and cores, of the rests
STREAMS = st.binary(max_size=40)
NOTHING = Errors(0.0, 0.0, 0.0)


@st.composite
def certificates(draw: st.DrawFn) -> Errors:
    """Maximum, and a mean and a percentile that are not above it."""
    largest = draw(st.one_of(st.just(0.0), st.floats(1e-6, 1e4)))
    shares = st.one_of(st.sampled_from([0.0, 1.0]), st.floats(2e-5, 1.0))
    return Errors(largest, largest * draw(shares), largest * draw(shares))


@st.composite
def files(draw: st.DrawFn) -> MotionFile:
    """Files of no run, one, or several, each with a rest of one stream or more."""
    frames = draw(st.one_of(st.integers(0, 3), st.integers(0, 6 * RUN_FRAMES)))
    runs = len(runs_of(frames))
    streams = draw(st.integers(1, 5))
    rests = tuple(draw(STREAMS) for _ in range(runs * streams))
    return MotionFile(
        draw(st.integers(0, 2**40)),
        draw(st.integers(0, 300)),
        frames,
        draw(st.integers(0, 7679)),
        draw(certificates()),
        tuple(draw(STREAMS) for _ in range(max(runs, 1))),
        rests,
        streams,
        *draw(st.sampled_from([(False, False), (True, False), (False, True)])),
    )


def made(
    seed: int, frames: int, streams: int = 1, led: bool = False, mirrored: bool = False
) -> MotionFile:
    """A file of some ten bytes a stream."""
    rng = np.random.default_rng(seed)
    runs = len(runs_of(frames))
    cores = max(runs, 1)
    made = [rng.bytes(int(rng.integers(1, 20))) for _ in range(cores + runs * streams)]
    certificate = Errors(0.1, 0.02, 0.07)
    pieces = tuple(made[:cores]), tuple(made[cores:])
    return MotionFile(3, 1, frames, 5000, certificate, *pieces, streams, led, mirrored)


def rest_bytes(file: MotionFile) -> int:
    assert file.rests is not None
    sealed = file.streams > 1 or file.led or file.mirrored
    return sum(len(rest) + (sealed and len(rest) > 0) for rest in file.rests)


@given(files())
def test_files_come_back(file: MotionFile) -> None:
    data = pack_motion(file)
    read = unpack_motion(data)
    assert replace(read, certificate=NOTHING) == replace(file, certificate=NOTHING)
    assert unpack_any(data) == read
    check_whole(data)


@given(files())
def test_certificates_are_never_understated_and_little_overstated(file: MotionFile) -> None:
    wanted, told = file.certificate, unpack_motion(pack_motion(file)).certificate
    assert wanted.maximum <= told.maximum <= wanted.maximum * 2.0 ** (1 / 1000)
    for true, read in ((wanted.mean, told.mean), (wanted.percentile_99, told.percentile_99)):
        assert true <= read <= told.maximum
        assert read <= true * 2.0 ** (1 / 16) * (1 + 1e-6)


@given(st.floats(1e-6, 1e4), st.floats(0.0, 2e-5))
def test_errors_far_below_the_largest_are_never_understated(largest: float, share: float) -> None:
    file = replace(made(0, 5), certificate=Errors(largest, largest * share, largest))
    told = unpack_motion(pack_motion(file)).certificate
    assert largest * share <= told.mean <= 2.1e-5 * largest


@pytest.mark.parametrize("largest", [0.25, 2.0 ** (-3402 / 1024), 2.0 ** (1932 / 1024)])
def test_errors_a_hair_above_what_a_code_says_are_not_understated(largest: float) -> None:
    for code in range(1, 255):
        mean = float(np.nextafter(largest * 2.0 ** (-code / 16), np.inf))
        file = replace(made(0, 5), certificate=Errors(largest, mean, mean))
        told = unpack_motion(pack_motion(file)).certificate
        assert mean <= told.mean == told.percentile_99 <= 1.05 * mean


@given(st.integers(0, 10**6))
def test_runs_cover_the_frames_in_order(frames: int) -> None:
    runs = runs_of(frames)
    assert all(0 < high - low <= RUN_FRAMES for low, high in runs)
    assert all(before[1] == after[0] for before, after in pairwise(runs))
    assert not runs or (runs[0][0], runs[-1][1]) == (0, frames)
    assert bool(runs) == bool(frames)


@given(files(), st.data())
def test_any_prefix_that_covers_the_cores_is_enough_for_them(
    file: MotionFile, data: st.DataObject
) -> None:
    whole = pack_motion(file)
    cores_end = len(whole) - rest_bytes(file)
    prefix = whole[: data.draw(st.integers(cores_end, len(whole)))]
    read = unpack_motion(prefix, prefix_only=True)
    assert read.rests is None
    assert replace(read, rests=file.rests) == unpack_motion(whole)
    assert unpack_any(prefix, prefix_only=True) == read
    with pytest.raises(DamagedError):
        unpack_motion(whole[: data.draw(st.integers(0, cores_end - 1))], prefix_only=True)


@pytest.mark.parametrize("kind", [(1,), (3,), (1, True), (3, True), (1, False, True)])
@pytest.mark.parametrize("frames", [0, 1, 300, 2500])
def test_every_truncation_is_damage(frames: int, kind: tuple[Any, ...]) -> None:
    data = pack_motion(made(frames, frames, *kind))
    for length in range(len(data)):
        with pytest.raises(DamagedError):
            unpack_motion(data[:length])
    with pytest.raises(DamagedError):
        unpack_motion(data + b"\1")


@pytest.mark.parametrize("kind", [(1,), (3,), (1, True), (3, True), (1, False, True)])
@pytest.mark.parametrize("frames", [1, 2500])
def test_every_changed_byte_is_noticed(frames: int, kind: tuple[Any, ...]) -> None:
    """Whatever a byte is changed to; the version's byte may name a version that is not known."""
    data = pack_motion(made(frames, frames, *kind))
    for place in range(len(data)):
        for change in range(1, 256):
            wrong = bytearray(data)
            wrong[place] ^= change
            unknown = place == 2 and wrong[2] not in VERSIONS
            with pytest.raises(VersionError if unknown else DamagedError):
                unpack_motion(bytes(wrong))


def streams_at(file: MotionFile) -> list[tuple[int, int]]:
    """Where the streams of a packed file of version 3 are, check bytes included."""
    streams, found = [*file.cores, *(file.rests or ())], []
    at = len(pack_motion(file))
    for number, stream in reversed([*enumerate(streams)]):
        start = at - len(stream) - (number > 0 and len(stream) > 0)
        found.append((start, at))
        at = start
    return found[::-1]


@given(files().filter(lambda file: file.streams > 1 or file.led or file.mirrored), st.data())
def test_streams_are_checked_one_by_one(file: MotionFile, data: st.DataObject) -> None:
    """A changed byte of a stream is noticed where that is read, and hurts no other."""
    whole = pack_motion(file)
    where = streams_at(file)
    place = data.draw(st.integers(where[0][0], len(whole) - 1)) if where[0][0] < len(whole) else 2
    wrong = bytearray(whole)
    wrong[place] ^= data.draw(st.integers(1, 255))
    if place < where[0][1]:
        with pytest.raises((DamagedError, VersionError)):
            unpack_motion(bytes(wrong), piecewise=True)
        return
    read = unpack_motion(bytes(wrong), piecewise=True)
    assert read.rests is not None
    assert file.rests is not None
    wanted, found = [*file.cores, *file.rests], [read.cores, read.rests]
    for number, (start, stop) in enumerate(where):
        cores = number < len(file.cores)
        index = number if cores else number - len(file.cores)
        if start <= place < stop:
            with pytest.raises(DamagedError, match="checksum of a stream"):
                found[not cores][index]
        else:
            assert found[not cores][index] == wanted[number]
    assert unpack_motion(whole, piecewise=True).rests_of(0) is not None


@given(st.binary(max_size=60))
def test_check_bytes_are_those_of_the_text(data: bytes) -> None:
    assert check_byte(b"123456789") == 0xF4
    assert check_byte(data) == crc_8(data)


@pytest.mark.parametrize("place", range(500))
def test_every_changed_bit_of_long_rests_is_noticed(place: int) -> None:
    rng = np.random.default_rng(8)
    data = pack_motion(replace(made(0, 9), rests=(rng.bytes(500),)))
    for bit in range(8):
        wrong = bytearray(data)
        wrong[-1 - place] ^= 1 << bit
        with pytest.raises(DamagedError, match="checksum of the rests"):
            unpack_motion(bytes(wrong))


def test_damage_of_the_rests_leaves_the_cores() -> None:
    file = made(4, 2500)
    data = bytearray(pack_motion(file))
    data[-1] ^= 1
    with pytest.raises(DamagedError, match="rests"):
        unpack_motion(bytes(data))
    assert unpack_motion(bytes(data), prefix_only=True).cores == file.cores


def hostile(fields: list[int], body: bytes, version: int = VERSIONS[0]) -> bytes:
    """A file whose checksums are right, whatever its header claims."""
    prefix = b"".join(map(varint, fields)) + body
    begun = 0 if version == VERSIONS[0] else version
    checks = binascii.crc_hqx(prefix, begun), begun  # of no rests: where it begins
    return FIXED.pack(MAGIC, version, *checks) + prefix


HUGE = 10**12


@pytest.mark.parametrize(
    ("fields", "body"),
    [
        ([0, 0, HUGE, 5], b""),
        ([0, 0, HUGE, 5], b"\0" * 5000),
        ([0, 0, 2**62, 5], b"\0" * 100),
        ([0, 0, 2**24, 5], b"\0" * 5000),  # a run in three bytes
        ([0, 0, 10 * RUN_FRAMES, 5], b""),  # no room for the lengths
        ([0, 0, 0, 5, HUGE], b"\0" * 6),
        ([0, 0, 5, 5, HUGE], b"\0" * 6),
        ([0, 0, 2000, 5, 0, HUGE, 0], b"\0" * 6),
        ([0, 0, 2000, 5, 0, 0, HUGE], b"\0" * 4),  # a rest
        ([HUGE] * 4, b""),
        ([0, 0, 5, 5, 0], b"\0" * 3),  # half a certificate
    ],
)
@pytest.mark.parametrize("prefix_only", [False, True])
def test_hostile_headers_are_refused_quickly(
    fields: list[int], body: bytes, prefix_only: bool
) -> None:
    data = hostile(fields, body)
    began = time.perf_counter()
    if prefix_only and fields[-1] == HUGE and len(fields) == 7:  # a rest that is not asked for
        assert unpack_motion(data, prefix_only=True).frames == 2000
    else:
        with pytest.raises(DamagedError):
            unpack_motion(data, prefix_only=prefix_only)
    assert time.perf_counter() - began < 1.0


@pytest.mark.parametrize(
    "fields",
    [
        [0, 0, 5, 5, 0, 1, 1],  # no streams
        [0, 0, 5, 5, 1, 1, 1],  # one
        [0, 0, 5, 5, HUGE, 1],
        [0, 0, 5000, 5, HUGE, 1],
        [0, 0, 5, 5, 2, 0, HUGE],
    ],
)
@pytest.mark.parametrize("piecewise", [False, True])
def test_hostile_numbers_of_streams_are_refused_quickly(fields: list[int], piecewise: bool) -> None:
    data = hostile(fields, b"\0" * 50, VERSIONS[1])
    began = time.perf_counter()
    with pytest.raises(DamagedError):
        unpack_motion(data, piecewise=piecewise)
    assert time.perf_counter() - began < 1.0


@given(st.binary(max_size=200), st.booleans(), st.sampled_from(VERSIONS), st.booleans())
@settings(max_examples=200)
def test_any_bytes_after_a_right_checksum_are_a_file_or_damage(
    body: bytes, prefix_only: bool, version: int, piecewise: bool
) -> None:
    data = hostile([], body, version)
    try:
        read = unpack_motion(data, prefix_only=prefix_only, piecewise=piecewise)
    except MotifoldError:
        return
    assert sum(map(len, (*read.cores, *(read.rests or ())))) <= len(data)


@pytest.mark.parametrize("data", [b"", b"MF", b"MF\2", b"BV\2" + b"\0" * 40])
def test_what_is_no_index_file_is_damage(data: bytes) -> None:
    with pytest.raises(DamagedError):
        unpack_motion(data)


@pytest.mark.parametrize("version", [0, 1, 6, 255])
def test_other_versions_are_told(version: int) -> None:
    data = bytearray(pack_motion(made(1, 5)))
    data[2] = version
    with pytest.raises(VersionError, match=f"version {version}"):
        unpack_motion(bytes(data))
