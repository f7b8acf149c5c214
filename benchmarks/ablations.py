"""What each part of the encoder is worth: archive bytes with it changed or left out.

python benchmarks/ablations.py DATA [--set bandai|cmu] [--sample N] [--variants NAME ...]
    [--tolerances 1mm,1cm] [--bound max|mean] [--json]

A variant is a name and what it changes in the settings; all others are compared with the
first, also at equal mean error of the joints, because a variant may buy one with the other.
"No patterns" also takes away a clip's memory of itself. That is no setting, since every decoder
has it: here it is taken from encoder and decoder alike, in this process.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Any
from unittest.mock import patch

from archive_runs import ArchiveRuns
from motion_sets import SETS, chosen, clip_files, link_library
from tables import print_table

from motifold.codec.blocks import blockwalk, runstream
from motifold.codec.blocks.recall import Memory, empty_memory
from motifold.codec.learned import gathering
from motifold.workflows.quantities import parse_length

VARIANTS: dict[str, Mapping[str, Any]] = {
    "default": {},
    "no patterns": {"references": 0},
    "no learned basis": {"without": ("basis",)},
    "no parent prediction": {"without": ("parents",)},
    "plain entropy tables": {"without": ("contexts",)},
    "local orientations": {"without": ("world",)},
    "no references": {"references": 0},
    "2 references": {"references": 2},
    "8 references": {"references": 8},
    "no mirror images": {"without": ("mirrors",)},
    "prediction not learned": {"model": "basis"},
    "nothing learned": {"model": "fixed"},
    "neither": {"references": 0, "model": "fixed"},
}
"""Name to changed settings; a dot goes into nested rules: ``clusters.radius_coefficient``."""

FORGETFUL = ("no patterns",)
"""Variants in which a clip is no reference of its own."""

SLOPE = 0.4  # bytes go with the mean error to the power of -0.4: see docs/codec.md

HEADER = (
    *("variant", "tolerance", "archive", "index files", "the rest", "/ first", "mean error"),
    "/ first at equal error",
)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, help="folder of the unpacked real motion")
    parser.add_argument("--set", choices=list(SETS), default="bandai")
    parser.add_argument("--sample", type=int, default=200, help="random clips; 0: all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--variants", nargs="+", choices=list(VARIANTS), default=list(VARIANTS))
    parser.add_argument("--tolerances", default="1mm,1cm")
    parser.add_argument("--bound", choices=("max", "mean"), default="max")
    parser.add_argument("--workers", type=int, help="worker processes; default: one a core")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    options = parser.parse_args()
    files = chosen(clip_files(SETS[options.set], options.data), options.sample, options.seed)
    figures: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="motifold-") as folder:
        sources = link_library(files, Path(folder, "library"))
        for name in options.variants:
            changes = VARIANTS[name]
            forgets = name in FORGETFUL
            workers = 0 if forgets else options.workers
            archives = ArchiveRuns(sources, Path(folder), workers, changes=changes)
            for text in options.tolerances.split(","):
                with forgetful() if forgets else nullcontext():
                    run = archives.at(options.bound, parse_length(text))
                figures.append(
                    {
                        "variant": name,
                        "tolerance": text,
                        "archive_bytes": run.archive_bytes,
                        "index_bytes": int(run.index_bytes.sum()),
                        "joint_mean": run.joint_mean,
                    }
                )
    if options.json:
        print(json.dumps(figures, indent=1))
    else:
        print_table([HEADER, *rows(figures)])


@contextmanager
def forgetful() -> Iterator[None]:
    """Take from encoder, decoder and learning what a clip remembers of itself."""

    def nothing(frames: int, rows: int, span: int) -> Memory:
        del frames
        return empty_memory(rows, 3 * span)

    def never(*known: Any) -> gathering.Moments:
        keys, features, signals = own_moments(*known)
        return gathering.Moments(keys[:, :0], features[:, :0], signals[:, :0])

    own_moments = gathering.own_moments
    with (
        patch.object(gathering, "own_moments", never),
        patch.object(blockwalk, "own_memory", nothing),
        patch.object(runstream, "own_memory", nothing),
    ):
        yield


def rows(figures: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return the table's rows; each is compared with the first of the same tolerance."""
    first = {entry["tolerance"]: entry for entry in reversed(figures)}

    def share(entry: dict[str, Any], slope: float) -> str:
        other = first[entry["tolerance"]]
        worse = (entry["joint_mean"] / other["joint_mean"]) ** slope
        return f"{entry['archive_bytes'] / other['archive_bytes'] * worse:.4f}"

    return [
        (
            entry["variant"],
            entry["tolerance"],
            f"{entry['archive_bytes']:,}",
            f"{entry['index_bytes']:,}",
            f"{entry['archive_bytes'] - entry['index_bytes']:,}",
            share(entry, 0.0),
            f"{entry['joint_mean'] * 10:.4g} mm",
            share(entry, SLOPE),
        )
        for entry in figures
    ]


if __name__ == "__main__":
    main()
