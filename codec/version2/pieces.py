"""The streams of an index file as pieces of its bytes, cut out and checked when asked for.

In version 3 every stream but the first has a check byte before it, so that a reader who needs
some of the streams neither reads the others nor trusts bytes that it has not checked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import overload

from ..errors import DamagedError
from ..streams.envelope import Readable

_POLYNOMIAL = 0x07


@dataclass(frozen=True)
class Piece:
    """Where a stream is: its first byte, the byte after its last, and whether it is sealed.

    Of a sealed piece that is not empty the first byte is the check byte of the others.
    """

    start: int
    stop: int
    sealed: bool

    @property
    def size(self) -> int:
        """Bytes of the stream alone."""
        return max(self.stop - self.start - self.sealed, 0)

    def cut(self, data: Readable) -> bytes:
        """Return the stream. Raises `DamagedError`."""
        found = data[self.start : self.stop]
        if len(found) != self.stop - self.start:
            raise DamagedError("the index file ends in its streams", place=f"byte {len(data)}")
        if not self.sealed or not found:
            return found
        if check_byte(found[1:]) != found[0]:
            raise DamagedError("checksum of a stream is wrong", place=f"byte {self.start}")
        return found[1:]


@dataclass(frozen=True, eq=False)
class Pieces(Sequence[bytes]):
    """Streams of an index file; asking for one raises `DamagedError` if it is damaged."""

    data: Readable
    where: tuple[Piece, ...]

    def __len__(self) -> int:
        return len(self.where)

    @overload
    def __getitem__(self, index: int) -> bytes: ...
    @overload
    def __getitem__(self, index: slice) -> Pieces: ...
    def __getitem__(self, index: int | slice) -> bytes | Pieces:
        if isinstance(index, slice):
            return Pieces(self.data, self.where[index])
        return self.where[index].cut(self.data)


def size_of(streams: Sequence[bytes]) -> int:
    """Return the bytes of some streams, without reading those that are still in a file."""
    if isinstance(streams, Pieces):
        return sum(piece.size for piece in streams.where)
    return sum(map(len, streams))


def sealed(stream: bytes) -> bytes:
    """Return a stream with its check byte before it; nothing stays nothing."""
    return bytes([check_byte(stream)]) + stream if stream else b""


def check_byte(data: bytes) -> int:
    """Return the CRC-8 of some bytes: polynomial 0x07, from 0 ("123456789" gives 0xF4)."""
    table, value = _table(), 0
    for byte in data:
        value = table[value ^ byte]
    return value


@cache
def _table() -> tuple[int, ...]:
    values = []
    for byte in range(256):
        value = byte
        for _ in range(8):
            value = (value << 1) ^ (_POLYNOMIAL if value & 0x80 else 0)
            value &= 0xFF
        values.append(value)
    return tuple(values)
