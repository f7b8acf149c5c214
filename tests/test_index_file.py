"""The container: fields survive, and no damage goes unseen."""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from motifold.codec.errors import DamagedError, VersionError
from motifold.codec.geometry.metrics import Errors
from motifold.codec.streams.envelope import FRAME_LIMIT
from motifold.codec.version1.index_file import (
    MAGIC,
    VERSION,
    IndexFile,
    float32_above,
    pack,
    unpack,
)

NUMBERS = st.integers(0, 2**63 - 1)
LENGTHS = st.floats(0.0, 4000.0)
FILES = st.builds(
    IndexFile,
    NUMBERS,
    NUMBERS,
    st.integers(0, FRAME_LIMIT),
    st.integers(0, 7679),
    st.builds(Errors, LENGTHS, LENGTHS, LENGTHS),
    st.binary(max_size=80),
    st.binary(max_size=80),
)
SAMPLE = IndexFile(3, 7, 1234, 900, Errors(0.0991, 0.021, 0.07), b"preview" * 5, b"residual" * 6)


@given(FILES)
def test_fields_survive(index: IndexFile) -> None:
    back = unpack(pack(index))
    assert replace(back, certificate=index.certificate) == index


@given(FILES)
@example(replace(SAMPLE, certificate=Errors(1e-300, 5e-324, 2.0**-20)))
@example(replace(SAMPLE, certificate=Errors(0.1, 3020.4480857792096, 2.0**-19.5)))
def test_the_certificate_is_never_understated(index: IndexFile) -> None:
    wrote, read = index.certificate, unpack(pack(index)).certificate
    assert wrote.maximum <= read.maximum <= wrote.maximum * (1 + 2**-23) + 2**-149
    for before, after in (
        (wrote.mean, read.mean),
        (wrote.percentile_99, read.percentile_99),
    ):
        assert before <= after <= max(before * 1.0003386, 2.0**-19.99)
        assert (after == 0) == (before == 0)


def test_a_certificate_survives_packing_again() -> None:
    """Rounding up twice is rounding up once."""
    once = unpack(pack(SAMPLE))
    assert unpack(pack(once)).certificate.maximum == once.certificate.maximum


@given(st.floats(0.0, 3.4e38))
@example(0.1)
@example(0.0)
@example(1e-46)
def test_float32_above_is_the_least_not_below(value: float) -> None:
    up = float32_above(value)
    assert up >= value
    assert np.float32(up) == up
    if up > 0:
        assert float(np.nextafter(np.float32(up), np.float32(0))) < value


def test_every_single_flipped_bit_is_seen() -> None:
    data = pack(SAMPLE)
    for bit in range(8 * len(data)):
        hurt = bytearray(data)
        hurt[bit // 8] ^= 1 << bit % 8
        with pytest.raises((DamagedError, VersionError)):
            unpack(bytes(hurt))


@given(FILES, st.data())
def test_any_truncation_and_any_tail_are_seen(index: IndexFile, data: st.DataObject) -> None:
    whole = pack(index)
    cut = data.draw(st.integers(0, len(whole) - 1))
    with pytest.raises(DamagedError):
        unpack(whole[:cut])
    with pytest.raises(DamagedError):
        unpack(whole + data.draw(st.binary(min_size=1, max_size=9)))


@given(FILES, st.data())
def test_a_prefix_is_enough_for_the_preview(index: IndexFile, data: st.DataObject) -> None:
    assert index.residual is not None
    whole = pack(index)
    least = len(whole) - len(index.residual)
    prefix = whole[: data.draw(st.integers(least, len(whole)))]
    read = unpack(prefix, prefix_only=True)
    assert read == replace(unpack(whole), residual=None)
    with pytest.raises(DamagedError):
        unpack(whole[: data.draw(st.integers(0, least - 1))], prefix_only=True)


def test_flipped_bits_of_a_prefix_are_seen() -> None:
    data = pack(SAMPLE)
    prefix = len(data) - 48
    for bit in range(8 * prefix):
        if 8 <= bit // 8 < 12:  # the checksum of the layer that is not read
            continue
        hurt = bytearray(data[:prefix])
        hurt[bit // 8] ^= 1 << bit % 8
        with pytest.raises((DamagedError, VersionError)):
            unpack(bytes(hurt), prefix_only=True)


@given(st.binary(max_size=200))
@settings(max_examples=300)
def test_any_bytes_are_damage(data: bytes) -> None:
    for bytes_ in (data, MAGIC + bytes([VERSION]) + data):
        with pytest.raises((DamagedError, VersionError)):
            unpack(bytes_)


def forged(head: bytes, residual: bytes = b"") -> bytes:
    """A file of any head whose checksums are right."""
    return (
        struct.pack("<3sBII", b"MFI", 1, zlib.crc32(head), zlib.crc32(residual)) + head + residual
    )


@pytest.mark.parametrize(
    "head",
    [
        b"\xff" * 9,  # a number without end
        b"\x80" * 40,
        b"\x01\x01\x01\x01\xff\xff\xff\xff\xff\xff\xff\xff\x7f" + b"\0" * 8,  # 2^63 preview bytes
        b"\x01\x01\x81\x80\x80\x80\x01\x01\x00" + b"\0" * 8,  # 2^28 + 1 frames
        b"\x01\x01\x80\xa0\x94\xa5\x8d\x1d\x01\x00" + b"\0" * 8,  # 10^12 frames
        b"\x01\x01\x01\x01\x01" + b"\0" * 8,  # one byte of preview short
        b"",
    ],
)
def test_hostile_heads_are_damage(head: bytes) -> None:
    with pytest.raises(DamagedError):
        unpack(forged(head))


def test_hostile_heads_would_pass_if_they_were_sound() -> None:
    assert unpack(forged(b"\x01\x02\x03\x04\x00" + b"\0" * 8)).frames == 3


def test_versions_and_other_files_are_told_apart() -> None:
    data = pack(SAMPLE)
    with pytest.raises(VersionError, match="version 2"):
        unpack(data[:3] + b"\x02" + data[4:])
    with pytest.raises(DamagedError, match="not an index file"):
        unpack(b"PK\x03\x04" + data[4:])


def test_bytes_are_those_of_the_format() -> None:
    """Written out by hand from the description of the format."""
    code = math.ceil((math.log2(0.5) + 20) * 2048)
    head = bytes([1, 0, 0x80 | 300 % 128, 300 // 128, 5, 2]) + struct.pack("<fHH", 0.5, code, 0)
    head += b"pp"
    index = IndexFile(1, 0, 300, 5, Errors(0.5, 0.5, 0.0), b"pp", b"rrr")
    assert pack(index) == forged(head, b"rrr")
