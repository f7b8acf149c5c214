"""The container of one archived clip, an *index file*: header, preview layer, residual layer.

Byte by byte in ``docs/format.md``. This module knows the envelope only: magic, version,
checksums, the certificate and the two entropy-coded layers as opaque bytes.
"""

from __future__ import annotations

import math
import struct
import zlib
from dataclasses import dataclass

from ..errors import DamagedError, VersionError
from ..geometry.metrics import Errors
from ..streams.envelope import FRAME_LIMIT, read_varint, varint

MAGIC = b"MFI"
VERSION = 1
_FIXED = struct.Struct("<3sBII")
_CERTIFICATE = struct.Struct("<fHH")


@dataclass(frozen=True)
class IndexFile:
    """The parts of an index file.

    ``rig``: number of the clip's rig in the store; ``generation``: the generation of the store
    whose patterns it may name; ``step_code``: see `quantiser`; ``certificate``: the errors that
    the encoder measured on its own decode, centimetres, never understated; ``preview`` and
    ``residual``: the two coded layers. ``residual`` is None when only the prefix was read.
    """

    rig: int
    generation: int
    frames: int
    step_code: int
    certificate: Errors
    preview: bytes
    residual: bytes | None


def pack(index: IndexFile) -> bytes:
    """Return the bytes of a complete index file."""
    assert index.residual is not None, "a prefix cannot be packed"
    certificate = index.certificate
    fields = (index.rig, index.generation, index.frames, index.step_code, len(index.preview))
    head = b"".join(varint(value) for value in fields)
    head += _CERTIFICATE.pack(
        float32_above(certificate.maximum),
        _log_code(certificate.mean),
        _log_code(certificate.percentile_99),
    )
    head += index.preview
    fixed = _FIXED.pack(MAGIC, VERSION, zlib.crc32(head), zlib.crc32(index.residual))
    return fixed + head + index.residual


def unpack(data: bytes, *, prefix_only: bool = False) -> IndexFile:
    """Return the parts of an index file, checked against its checksums.

    With ``prefix_only`` the residual layer is neither needed nor read, so ``data`` may be any
    prefix that covers the preview layer. Raises `DamagedError` or `VersionError`.
    """
    if len(data) < _FIXED.size:
        raise DamagedError("the index file ends in its header", place=f"byte {len(data)}")
    magic, version, head_crc, residual_crc = _FIXED.unpack_from(data)
    if magic != MAGIC:
        raise DamagedError("not an index file (no MFI magic)", place="byte 0")
    if version != VERSION:
        raise VersionError(
            f"index file version {version}; this motifold reads versions 1 to 4",
            place="byte 3",
            advice="Use a newer motifold",
        )
    at = _FIXED.size
    fields = []
    for _ in range(5):
        value, at = read_varint(data, at)
        fields.append(value)
    rig, generation, frames, step_code, preview_bytes = fields
    end = at + _CERTIFICATE.size + preview_bytes
    if end > len(data):
        raise DamagedError("the index file ends in its preview layer", place=f"byte {len(data)}")
    if zlib.crc32(data[_FIXED.size : end]) != head_crc:
        raise DamagedError("checksum of header and preview layer is wrong", place="byte 4")
    if frames > FRAME_LIMIT:
        raise DamagedError(f"claims {frames} frames", place=f"byte {_FIXED.size}")
    maximum, mean, percentile = _CERTIFICATE.unpack_from(data, at)
    residual = None if prefix_only else data[end:]
    if residual is not None and zlib.crc32(residual) != residual_crc:
        raise DamagedError("checksum of the residual layer is wrong", place=f"byte {end}")
    certificate = Errors(maximum, _from_log_code(mean), _from_log_code(percentile))
    preview = data[at + _CERTIFICATE.size : end]
    return IndexFile(rig, generation, frames, step_code, certificate, preview, residual)


def float32_above(value: float) -> float:
    """Return the least float32 that is not below ``value``."""
    near = struct.unpack("<f", struct.pack("<f", value))[0]
    if near >= value:
        return float(near)
    bits = struct.unpack("<I", struct.pack("<f", near))[0]
    return float(struct.unpack("<f", struct.pack("<I", bits + 1))[0])


def _log_code(value: float) -> int:
    """Return a 16-bit logarithmic code of a length >= 0, rounded up by at most 0.034 %."""
    if value <= 0.0:
        return 0
    code = min(max(math.ceil((math.log2(value) + 20.0) * 2048.0), 1), 65535)
    return code + 1 if _from_log_code(code) < value and code < 65535 else code


def _from_log_code(code: int) -> float:
    return 0.0 if code == 0 else 2.0 ** (code / 2048.0 - 20.0)
