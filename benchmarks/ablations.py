"""What each part of the encoder is worth: archive bytes with it changed or left out.

python benchmarks/ablations.py DATA [--set bandai|cmu] [--sample N] [--variants NAME ...]
    [--tolerances 1mm,1cm] [--bound max|mean] [--json]

A variant is a name and what it changes in the settings; all others are compared with the
first. The mean joint error stands beside the bytes, because a variant may buy one with the other.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from archive_runs import ArchiveRuns
from motion_sets import SETS, chosen, clip_files, link_library
from tables import print_table

from motifold.workflows.quantities import parse_length

VARIANTS: dict[str, Mapping[str, Any]] = {
    "default": {},
    "no references": {"references": 0},
    "2 references": {"references": 2},
    "8 references": {"references": 8},
    "prediction not learned": {"model": "basis"},
    "nothing learned": {"model": "fixed"},
    "neither": {"references": 0, "model": "fixed"},
}
"""Name to changed settings; a dot goes into nested rules: ``clusters.radius_coefficient``."""

HEADER = ("variant", "tolerance", "archive", "index files", "the rest", "/ first", "mean error")


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
            archives = ArchiveRuns(sources, Path(folder), options.workers, changes=changes)
            for text in options.tolerances.split(","):
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


def rows(figures: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return the table's rows; each is compared with the first of the same tolerance."""
    first = {entry["tolerance"]: entry["archive_bytes"] for entry in reversed(figures)}
    return [
        (
            entry["variant"],
            entry["tolerance"],
            f"{entry['archive_bytes']:,}",
            f"{entry['index_bytes']:,}",
            f"{entry['archive_bytes'] - entry['index_bytes']:,}",
            f"{entry['archive_bytes'] / first[entry['tolerance']]:.4f}",
            f"{entry['joint_mean'] * 10:.4g} mm",
        )
        for entry in figures
    ]


if __name__ == "__main__":
    main()
