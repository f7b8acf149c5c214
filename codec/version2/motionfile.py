"""The container of versions 2 to 5: what one archived clip is, from magic to the last run.

Version 3 is version 2 with the rest of every run in one stream a body part; version 4 is a
clip with leads, in one stream or several, sealed as in version 3; version 5 is like version 4, of
a clip that refers to the mirror images of others.

Byte by byte in ``docs/format.md``. This module knows the envelope only: the coded streams are
opaque bytes here.
"""

from __future__ import annotations

import binascii
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

from ..errors import DamagedError, VersionError
from ..geometry.metrics import Errors
from ..streams.envelope import FRAME_LIMIT, Readable, read_varint, varint
from .pieces import Piece, Pieces, sealed

MAGIC = b"MF"
PLAIN, BY_PART, LED, MIRRORED = VERSIONS = 2, 3, 4, 5
RUN_FRAMES = 1024  # longer clips are cut into runs that decode on their own
_FIXED = struct.Struct("<2sBHH")
_CERTIFICATE = struct.Struct("<HBB")
_RUNGS = 1024.0  # codes an octave of the largest error
_LEAST = -40.0  # log2 of the largest error, centimetres, that code 0 would stand for
_SHARE = 16.0  # codes an octave of the mean's and the percentile's share of the maximum


@dataclass(frozen=True)
class MotionFile:
    """The parts of an index file of versions 2 to 5.

    ``rig``: number of the clip's rig in the store; ``generation``: that of the motion model it
    was coded with, 0 for the fixed one; ``step_code``: see `quantiser`; ``certificate``: the
    errors that the encoder measured on its own decode, centimetres, never understated (mean
    and percentile are kept as shares of the maximum, in sixteenths of an octave);
    ``cores`` and ``rests``: the streams of every run; the first core begins with the head, and
    is there even without a run. ``rests``: those of the first run, then those of the second …;
    None when only the prefix was read. ``streams``: how many the rest of a run has: 1, or one a
    body part. A file that is read piecewise checks them when they are asked for.
    ``led``: whether the head has leads; ``mirrored``: whether it may say that references are
    mirrored, and have leads.
    """

    rig: int
    generation: int
    frames: int
    step_code: int
    certificate: Errors
    cores: Sequence[bytes]
    rests: Sequence[bytes] | None
    streams: int = 1
    led: bool = False
    mirrored: bool = False

    def rests_of(self, run: int) -> Sequence[bytes] | None:
        """Return the streams of a run's rest, or None when only the prefix was read."""
        if self.rests is None:
            return None
        return self.rests[run * self.streams : (run + 1) * self.streams]


def runs_of(frames: int) -> list[tuple[int, int]]:
    """Return (start, stop) of the runs of a clip."""
    return [(at, min(at + RUN_FRAMES, frames)) for at in range(0, frames, RUN_FRAMES)]


def pack_motion(file: MotionFile) -> bytes:
    """Return the bytes of a complete index file."""
    assert file.rests is not None, "a prefix cannot be packed"
    cores, rests, streams = [*file.cores], [*file.rests], []
    version = BY_PART if file.streams > 1 else PLAIN
    version = MIRRORED if file.mirrored else LED if file.led else version
    if version > PLAIN:
        cores[1:], rests = map(sealed, cores[1:]), [*map(sealed, rests)]
        streams = [file.streams]
    certificate = file.certificate
    largest = told(certificate.maximum)
    lengths = [*map(len, cores), *map(len, rests[:-1])]
    fields = (file.rig, file.generation, file.frames, file.step_code, *streams, *lengths)
    prefix = b"".join(varint(value) for value in fields)
    prefix += _CERTIFICATE.pack(
        _largest_code(certificate.maximum),
        _share_code(certificate.mean, largest),
        _share_code(certificate.percentile_99, largest),
    )
    first = 1 if streams else len(cores)
    prefix += b"".join(cores[:first])
    rest = b"".join((*cores[first:], *rests))
    checks = _checksum(prefix, version), _checksum(rest, version)
    return _FIXED.pack(MAGIC, version, *checks) + prefix + rest


def unpack_motion(
    data: Readable, *, prefix_only: bool = False, piecewise: bool = False
) -> MotionFile:
    """Return the parts of an index file of versions 2 to 5, checked against its checksums.

    With ``prefix_only`` the rests are neither needed nor read, so ``data`` may be any prefix
    that covers the cores. With ``piecewise`` the streams of versions from 3 on, but the first, are
    read and checked one by one when they are asked for. Raises `DamagedError` or `VersionError`.
    """
    if len(data) < _FIXED.size:
        raise DamagedError("the index file ends in its header", place=f"byte {len(data)}")
    magic, version, prefix_crc, rest_crc = _FIXED.unpack(data[: _FIXED.size])
    if magic != MAGIC:
        raise DamagedError("not an index file (no MF magic)", place="byte 0")
    if version not in VERSIONS:
        raise VersionError(
            f"index file version {version}; this motifold reads versions 1 to {VERSIONS[-1]}",
            place="byte 2",
            advice="Use a newer motifold",
        )
    apart = version > PLAIN
    fields, at = _varints(data, _FIXED.size, 5 if apart else 4)
    rig, generation, frames, step_code = fields[:4]
    streams = fields[4] if apart else 1
    if streams < 1 + (version == BY_PART):
        raise DamagedError(f"claims {streams} streams a run", place=f"byte {_FIXED.size}")
    if frames > FRAME_LIMIT or frames > RUN_FRAMES * len(data):
        raise DamagedError(f"claims {frames} frames", place=f"byte {_FIXED.size}")
    runs = len(runs_of(frames))
    cores = max(runs, 1)
    lengths, at = _varints(data, at, cores + max(runs * streams - 1, 0))
    shares, at = at, at + _CERTIFICATE.size
    first = 1 if apart else cores  # cores that the first checksum is of
    borders = [at, *(at + end for end in accumulate(lengths))]
    checked, cores_end = borders[first], borders[cores]
    if cores_end > len(data):
        raise DamagedError("the index file ends in its cores", place=f"byte {len(data)}")
    if _checksum(data[_FIXED.size : checked], version) != prefix_crc:
        raise DamagedError("checksum of header and cores is wrong", place="byte 3")
    if not prefix_only:
        whole = not (apart and piecewise)
        if whole and _checksum(data[checked : len(data)], version) != rest_crc:
            what = "streams" if apart else "rests"
            raise DamagedError(f"checksum of the {what} is wrong", place=f"byte {checked}")
        if borders[-1] > len(data):
            raise DamagedError("the index file ends in its rests", place=f"byte {len(data)}")
    if runs:
        borders.append(len(data))
    pieces = [
        Piece(start, stop, apart and number > 0)
        for number, (start, stop) in enumerate(pairwise(borders))
    ]
    in_cores: Sequence[bytes] = Pieces(data, tuple(pieces[:cores]))
    in_rests: Sequence[bytes] | None = Pieces(data, tuple(pieces[cores:]))
    if prefix_only:
        in_rests = None
    if not (apart and piecewise):
        in_cores, in_rests = tuple(in_cores), None if in_rests is None else tuple(in_rests)
    code, mean, percentile = _CERTIFICATE.unpack(data[shares:at])
    largest = _of_largest(code)
    certificate = Errors(largest, _of_share(mean, largest), _of_share(percentile, largest))
    found = rig, generation, frames, step_code, certificate, in_cores, in_rests, streams
    return MotionFile(*found, led=version == LED, mirrored=version == MIRRORED)


def _checksum(data: bytes, version: int) -> int:
    """Return a CRC-16 that no file of the other version has of the same bytes."""
    return binascii.crc_hqx(data, 0 if version == PLAIN else version)


def _varints(data: Readable, at: int, count: int) -> tuple[list[int], int]:
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
