"""What a clip costs while the store grows: does the 2,000th take longer than the 100th?

python benchmarks/growth_cost.py FOLDER [--sizes 100,300,1000,2400] [--tolerance 1mm] [--seed 0]

A random part of the folder is archived step by step into one archive, in one process. Times are
milliseconds per clip that is new; a job also compares the digests of all old ones (survey).
"""

from __future__ import annotations

import argparse
import random
import tempfile
from pathlib import Path

from tables import print_table

from motifold.pipeline.discover import discover
from motifold.pipeline.plan import Settings
from motifold.pipeline.run import archive_library
from motifold.workflows.quantities import parse_length

STAGES = ("survey", "sketch", "learn", "encode", "publish")
HEADER = (
    "clips",
    "new",
    *(f"{stage} ms" for stage in STAGES),
    "all ms",
    "archive bytes/clip",
    "source : archive",
)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sizes", default="100,300,1000,2400")
    parser.add_argument("--tolerance", default="1mm")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    sources = discover(options.folder, ["*.bvh"])
    random.Random(options.seed).shuffle(sources)
    settings = Settings(tolerance=parse_length(options.tolerance))
    rows: list[tuple[str, ...]] = [HEADER]
    clips = source_bytes = 0
    with tempfile.TemporaryDirectory(prefix="motifold-") as folder:
        library, archive = Path(folder, "library"), Path(folder, "archive")
        for size in map(int, options.sizes.split(",")):
            for source in sources[clips:size]:
                link = library / source.name
                link.parent.mkdir(parents=True, exist_ok=True)
                link.symlink_to(Path(source.path).resolve())
            report = archive_library(library, archive, settings, workers=0)
            if report.failures:
                raise SystemExit(f"{report.failures[0].name}: {report.failures[0].reason}")
            new, clips = report.clips, report.clips + report.unchanged
            source_bytes += report.source_bytes
            stages = [1000 * report.seconds.get(stage, 0.0) / new for stage in STAGES]
            rows.append(
                (
                    f"{clips:,}",
                    f"{new:,}",
                    *[f"{value:.1f}" for value in (*stages, sum(stages))],
                    f"{report.archive_bytes / clips:,.0f}",
                    f"{source_bytes / report.archive_bytes:.2f}",
                )
            )
    print_table(rows)


if __name__ == "__main__":
    main()
