"""What index files of every version are wrapped in: magic, numbers in headers, and sanity."""

from __future__ import annotations

from typing import Protocol, overload

from ..errors import DamagedError

FRAME_LIMIT = 1 << 28
LEAST_BITS = 0.02


class Readable(Protocol):
    """Bytes, or what reads them from a file when they are asked for."""

    def __len__(self) -> int: ...

    @overload
    def __getitem__(self, index: int, /) -> int: ...
    @overload
    def __getitem__(self, index: slice, /) -> bytes: ...


def varint(value: int) -> bytes:
    """Return a whole number in seven bits a byte, the lowest first."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def read_varint(data: Readable, at: int) -> tuple[int, int]:
    """Return the number at byte ``at`` and where it ends. Raises `DamagedError`."""
    value = 0
    for shift in range(0, 63, 7):
        if at >= len(data):
            raise DamagedError("the index file ends in its header", place=f"byte {at}")
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise DamagedError("a number in the header is too long", place=f"byte {at}")


def check_room(frames: int, channels: int, layer_bytes: int) -> None:
    """Raise `DamagedError` if so many numbers cannot come from so few bytes.

    Keeps time and memory in proportion to the file, whatever its header claims.
    """
    if frames * channels * LEAST_BITS > 8 * (layer_bytes + 16):
        raise DamagedError(f"claims {frames} frames, more than its {layer_bytes} bytes can hold")
