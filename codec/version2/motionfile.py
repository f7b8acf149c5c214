"""The container of version 2: what one archived clip is, from magic to the last run.

Byte by byte in ``docs/format.md``. This module knows the envelope only: the coded streams are
opaque bytes here.
"""

from __future__ import annotations

import binascii
import math
import struct
from dataclasses import dataclass

from ..errors import DamagedError, VersionError
from ..geometry.metrics import Errors
from ..streams.envelope import FRAME_LIMIT, read_varint, varint

MAGIC = b"MF"
VERSION = 2
RUN_FRAMES = 1024  # longer clips are cut into runs that decode on their own
_FIXED = struct.Struct("<2sBHH")
_CERTIFICATE = struct.Struct("<HBB")
_RUNGS = 1024.0  # codes an octave of the largest error
_LEAST = -40.0  # log2 of the largest error, centimetres, that code 0 would stand for
_SHARE = 16.0  # codes an octave of the mean's and the percentile's share of the maximum


@dataclass(frozen=True)
class MotionFile:
    """The parts of an index file of version 2.

    ``rig``: number of the clip's rig in the store; ``generation``: that of the motion model it
    was coded with, 0 for the fixed one; ``step_code``: see `quantiser`; ``certificate``: the
    errors that the encoder measured on its own decode, centimetres, never understated (mean
    and percentile are kept as shares of the maximum, in sixteenths of an octave);
    ``cores`` and ``rests``: the streams of every run; the first core begins with the head, and
    is there even without a run. ``rests`` is None when only the prefix was read.
    """

    rig: int
    generation: int
    frames: int
    step_code: int
    certificate: Errors
    cores: tuple[bytes, ...]
    rests: tuple[bytes, ...] | None


def runs_of(frames: int) -> list[tuple[int, int]]:
    """Return (start, stop) of the runs of a clip."""
    return [(at, min(at + RUN_FRAMES, frames)) for at in range(0, frames, RUN_FRAMES)]


def pack_motion(file: MotionFile) -> bytes:
    """Return the bytes of a complete index file."""
    assert file.rests is not None, "a prefix cannot be packed"
    certificate = file.certificate
    largest = told(certificate.maximum)
    lengths = [*map(len, file.cores), *(len(rest) for rest in file.rests[:-1])]
    fields = (file.rig, file.generation, file.frames, file.step_code, *lengths)
    prefix = b"".join(varint(value) for value in fields)
    prefix += _CERTIFICATE.pack(
        _largest_code(certificate.maximum),
        _share_code(certificate.mean, largest),
        _share_code(certificate.percentile_99, largest),
    )
    prefix += b"".join(file.cores)
    rest = b"".join(file.rests)
    checks = binascii.crc_hqx(prefix, 0), binascii.crc_hqx(rest, 0)
    fixed = _FIXED.pack(MAGIC, VERSION, *checks)
    return fixed + prefix + rest


def unpack_motion(data: bytes, *, prefix_only: bool = False) -> MotionFile:
    """Return the parts of an index file of version 2, checked against its checksums.

    With ``prefix_only`` the rests are neither needed nor read, so ``data`` may be any prefix
    that covers the cores. Raises `DamagedError` or `VersionError`.
    """
    if len(data) < _FIXED.size:
        raise DamagedError("the index file ends in its header", place=f"byte {len(data)}")
    magic, version, prefix_crc, rest_crc = _FIXED.unpack_from(data)
    if magic != MAGIC:
        raise DamagedError("not an index file (no MF magic)", place="byte 0")
    if version != VERSION:
        raise VersionError(
            f"index file version {version}; this motifold reads versions 1 and 2",
            place="byte 2",
            advice="Use a newer motifold",
        )
    fields, at = _varints(data, _FIXED.size, 4)
    rig, generation, frames, step_code = fields
    if frames > FRAME_LIMIT or frames > RUN_FRAMES * len(data):
        raise DamagedError(f"claims {frames} frames", place=f"byte {_FIXED.size}")
    runs = len(runs_of(frames))
    cores = max(runs, 1)
    lengths, at = _varints(data, at, cores + max(runs - 1, 0))
    shares = at
    at += _CERTIFICATE.size
    cores_end = at + sum(lengths[:cores])
    if cores_end > len(data):
        raise DamagedError("the index file ends in its cores", place=f"byte {len(data)}")
    if binascii.crc_hqx(data[_FIXED.size : cores_end], 0) != prefix_crc:
        raise DamagedError("checksum of header and cores is wrong", place="byte 3")
    pieces = []
    for length in lengths[:cores]:
        pieces.append(data[at : at + length])
        at += length
    rests = None
    if not prefix_only:
        if binascii.crc_hqx(data[cores_end:], 0) != rest_crc:
            raise DamagedError("checksum of the rests is wrong", place=f"byte {cores_end}")
        rests = _cut(data, cores_end, lengths[cores:], runs)
    code, mean, percentile = _CERTIFICATE.unpack_from(data, shares)
    largest = _of_largest(code)
    certificate = Errors(largest, _of_share(mean, largest), _of_share(percentile, largest))
    return MotionFile(rig, generation, frames, step_code, certificate, tuple(pieces), rests)


def _cut(data: bytes, at: int, lengths: list[int], runs: int) -> tuple[bytes, ...]:
    """Return the rests, the last of which goes to the end of the file."""
    rests = []
    for length in lengths:
        rests.append(data[at : at + length])
        at += length
    if at > len(data):
        raise DamagedError("the index file ends in its rests", place=f"byte {len(data)}")
    return (*rests, data[at:]) if runs else ()


def _varints(data: bytes, at: int, count: int) -> tuple[list[int], int]:
    values = []
    for _ in range(count):
        value, at = read_varint(data, at)
        values.append(value)
    return values, at


def told(largest: float) -> float:
    """Return the largest error (centimetres) that a file certifies for a measured one.

    At most 0.07 % above it, never below it.
    """
    return _of_largest(_largest_code(largest))


def _largest_code(value: float) -> int:
    if value <= 0.0:
        return 0
    code = min(max(math.ceil((math.log2(value) - _LEAST) * _RUNGS), 1), 65535)
    return code + 1 if _of_largest(code) < value and code < 65535 else code


def _of_largest(code: int) -> float:
    return 0.0 if code == 0 else float(2.0 ** (code / _RUNGS + _LEAST))


def _share_code(value: float, largest: float) -> int:
    """Return a code of a length's share of ``largest``, whose value is never smaller."""
    if value <= 0.0 or largest <= 0.0:
        return 255
    code = min(max(math.floor(-_SHARE * math.log2(value / largest)), 0), 254)
    return code - 1 if code > 0 and _of_share(code, largest) < value else code


def _of_share(code: int, largest: float) -> float:
    return 0.0 if code == 255 else float(largest * 2.0 ** (-code / _SHARE))
