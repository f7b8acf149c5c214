"""What general compressors make of the source text: zip's deflate and xz, file by file."""

from __future__ import annotations

import lzma
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from archive_runs import ArchiveRuns
from parallel import in_processes


def text_sizes(source: Path) -> tuple[int, int, int]:
    """Return the bytes of a file as it is, deflated (level 9) and as xz (preset 9, extreme)."""
    data = source.read_bytes()
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    deflated = len(packer.compress(data)) + len(packer.flush())
    return len(data), deflated, len(lzma.compress(data, preset=9 | lzma.PRESET_EXTREME))


def compare_text(
    archives: ArchiveRuns, sources: Mapping[str, Path], tolerances: list[float]
) -> dict[str, Any]:
    """Return bytes of text, zip and xz, and of archives at ``tolerances`` (centimetres).

    ASF files, which several trials share, count with the text once.
    """
    shared = sorted(archives.library.glob("*.asf"))
    files = [*(sources[name] for name in sorted(sources)), *shared]
    text, deflated, xz = (
        sum(sizes) for sizes in zip(*in_processes(text_sizes, files, archives.workers), strict=True)
    )
    return {
        "text_bytes": text,
        "zip_bytes": deflated,
        "xz_bytes": xz,
        "float32_bytes": archives.at("max", tolerances[0]).float32_bytes,
        "figures": [
            {"tolerance": tolerance, "archive_bytes": archives.at("max", tolerance).archive_bytes}
            for tolerance in tolerances
        ],
    }
