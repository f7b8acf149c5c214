"""What streams per body part cost, and what a part of a clip then takes to read and decode.

python benchmarks/part_access.py LIBRARY [--tolerances 1mm,1cm] [--part left_arm] [--clips N]

The library is archived with and without streams per part, in this process. Then random clips are
decoded, whole and one part of each: *first* in an archive just opened, whose models are read and
whose references are not, *like* when all that the clip is predicted from is at hand. Times are of
the processor, means a clip. Bytes are those of index files: the clip's own, and with all that it
is predicted from, and what they are predicted from.
"""

from __future__ import annotations

import argparse
import random
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tables import print_table
from threadpoolctl import threadpool_limits

from motifold.codec.figure.partial import with_ancestors
from motifold.codec.version2.motionfile import MotionFile
from motifold.codec.version2.motionhead import read_references
from motifold.codec.version2.pieces import Pieces
from motifold.pipeline.archive import Archive
from motifold.pipeline.indexreader import read_index
from motifold.pipeline.layout import index_path
from motifold.pipeline.plan import Settings
from motifold.pipeline.run import archive_library
from motifold.workflows.quantities import parse_length

WAYS = ("runs", "whole clip"), ("parts", "whole clip"), ("parts", "the part")


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("library", type=Path)
    parser.add_argument("--tolerances", default="1mm,1cm")
    parser.add_argument("--part", default="left_arm")
    parser.add_argument("--clips", type=int, default=20, help="random clips to decode, seed 0")
    parser.add_argument("--repeat", type=int, default=3, help="the fastest of so many counts")
    parser.add_argument("--markdown", action="store_true")
    options = parser.parse_args()
    rows: list[Sequence[str]] = [
        ("tolerance", "streams", "archive", "decoded", "own bytes", "all bytes", "first", "like")
    ]
    for text in options.tolerances.split(","):
        with threadpool_limits(1), tempfile.TemporaryDirectory(prefix="motifold-") as folder:
            for streams, what in WAYS:
                path = Path(folder, streams)
                if what == "whole clip":
                    settings = Settings(parse_length(text), streams=streams)  # type: ignore[arg-type]
                    size = archive_library(options.library, path, settings, workers=0).archive_bytes
                parts = None if what == "whole clip" else [options.part]
                figures = measure(path, parts, options.clips, options.repeat)
                rows.append((text, streams, f"{size:,}", what, *figures))
    print_table(rows, markdown=options.markdown)


def measure(path: Path, parts: list[str] | None, clips: int, repeat: int) -> tuple[str, ...]:
    """Return bytes and milliseconds a clip, as texts."""
    with Archive(path) as archive:
        names = random.Random(0).sample(sorted(archive), min(clips, len(archive)))
        own = sum(needed_bytes(archive, archive[name].path, parts) for name in names)
        every = sum(
            needed_bytes(archive, file, parts)
            for name in names
            for file in family_of(archive, archive[name].path)
        )
        archive[names[0]].decode(parts=parts)  # compiles
    first, like = [], []
    for name in names:
        first.append(min(seconds_of(path, name, parts, False) for _ in range(repeat)))
        like.append(min(seconds_of(path, name, parts, True) for _ in range(repeat)))
    counts = own / len(names), every / len(names)
    seconds = sum(first) / len(names), sum(like) / len(names)
    return *(f"{count:,.0f}" for count in counts), *(f"{1000 * s:.1f} ms" for s in seconds)


def seconds_of(path: Path, name: str, parts: list[str] | None, at_hand: bool) -> float:
    """Return how long a clip takes in an archive just opened, or with its references at hand."""
    with Archive(path) as archive:
        clip = archive[name]
        _ = archive.shelf.model(clip.rig, 1) if archive.store.models else None
        if at_hand:
            clip.decode(parts=parts, stop=1)  # a run at the most, and all that it refers to
        began = time.process_time()
        clip.decode(parts=parts)
        return time.process_time() - began


def family_of(archive: Archive, path: Path) -> set[Path]:
    """Return the index files that one needs: itself, its references, and theirs."""
    found, waiting = set(), [path]
    while waiting:
        file = waiting.pop()
        if file not in found:
            found.add(file)
            index = read_index(file, piecewise=True)
            assert isinstance(index, MotionFile)
            named = read_references(index)
            waiting += [index_path(archive.path, archive.numbered[n].index) for n, _ in named]
    return found


def needed_bytes(archive: Archive, path: Path, names: list[str] | None) -> int:
    """Return how many bytes of an index file are read for some parts; None means all."""
    index = read_index(path, piecewise=True)
    assert isinstance(index, MotionFile)
    size = path.stat().st_size
    if names is None or not isinstance(index.rests, Pieces):
        return size
    rig = archive.rig(index.rig)
    wanted = with_ancestors(rig.parts, rig.skeleton, names)
    pieces = enumerate(index.rests.where)
    return size - sum(p.stop - p.start for n, p in pieces if n % index.streams not in wanted)


if __name__ == "__main__":
    main()
