"""Archive a real library at several tolerances, restore it, and check every restored file.

python benchmarks/real_library.py FOLDER [--tolerances 1mm,5mm,2cm] [--check N|all] [--markdown]

The restored files and their sources are read and compared by the independent code of the tests
(tests/oracle*.py), which shares nothing with motifold. Exit code 1 if any file is outside its
tolerance, fails, or verify finds a problem.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from memory import PeakMemory
from oracle_files import file_errors
from tables import print_table

from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import executor
from motifold.pipeline.plan import Settings
from motifold.pipeline.report import Report
from motifold.pipeline.restore import restore_clips
from motifold.pipeline.run import archive_library
from motifold.pipeline.verify import verify_archive
from motifold.workflows.quantities import parse_length, show_bytes

HEADER = (
    "tolerance",
    "clips",
    "source",
    "float32",
    "archive",
    "source : archive",
    "float32 : archive",
    "mean error",
    "max error",
    "files checked",
    "archive",
    "peak memory",
    "verify",
    "restore",
)


@dataclass(frozen=True)
class Check:
    """What the independent code says of one restored file; errors in centimetres."""

    name: str
    largest: float = 0.0
    total: float = 0.0
    count: int = 0
    problem: str = ""


@dataclass
class Run:
    """One tolerance's figures."""

    report: Report
    checks: list[Check]
    problems: list[str]
    memory: int = 0
    seconds: dict[str, float] = field(default_factory=dict)


def main() -> int:
    """Run the benchmark; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tolerances", default="1mm,5mm,2cm")
    parser.add_argument("--workers", type=int, help="worker processes; default: one a core")
    parser.add_argument("--out", type=Path, help="keep archives and restored files here")
    parser.add_argument("--check", default="all", help="how many clips to restore and check")
    parser.add_argument("--markdown", action="store_true")
    options = parser.parse_args()
    rows: list[tuple[str, ...]] = [HEADER]
    failed = False
    with _folder(options.out) as out:
        for text in options.tolerances.split(","):
            run = measure(options.folder, out / text, parse_length(text), options)
            rows.append(_row(text, run))
            failed |= bool(run.problems)
            for problem in run.problems:
                print(f"{text}: {problem}", flush=True)
            _print_extremes(text, parse_length(text), run, out / text / "archive")
            if options.out is None:
                shutil.rmtree(out / text)
    print_table(rows, markdown=options.markdown)
    if options.markdown:
        print(f"\n`python {' '.join(sys.argv)}` on {os.cpu_count()} cores")
    return int(failed)


def measure(folder: Path, out: Path, tolerance: float, options: argparse.Namespace) -> Run:
    """Archive, verify, restore and check one folder; ``tolerance`` in centimetres."""
    run = Run(Report(), [], [])
    with PeakMemory() as memory, _timed(run, "archive"):
        settings = Settings(tolerance=tolerance)
        run.report = archive_library(folder, out / "archive", settings, workers=options.workers)
    run.memory = memory.bytes
    run.problems += [f"{failure.name}: {failure.reason}" for failure in run.report.failures]
    with Archive(out / "archive") as archive:
        with _timed(run, "verify"), executor(options.workers) as engine:
            found = verify_archive(archive, engine=engine, decode=True, library=folder)
        run.problems += found.problems
        names = list(archive)
        if options.check != "all":
            names = sorted(random.Random(0).sample(names, min(int(options.check), len(names))))
        with _timed(run, "restore"), executor(options.workers) as engine:
            done = restore_clips(archive, names, out / "restored", engine=engine)
        run.problems += [f"{failure.name}: {failure.reason}" for failure in done.failures]
        tasks = [
            (name, folder / name, Path(path), archive[name].rig.layout.centimetres)
            for name, path in done.files.items()
        ]
    with ProcessPoolExecutor(options.workers or os.cpu_count(), get_context("spawn")) as pool:
        run.checks = list(pool.map(check, tasks, chunksize=8))
    for result in run.checks:
        if result.problem or not result.largest <= tolerance:
            where = result.problem or f"is {result.largest:.9g} cm off, outside {tolerance:g} cm"
            run.problems.append(f"{result.name}: {where}")
    return run


def check(task: tuple[str, Path, Path, float]) -> Check:
    """Compare one restored file with its source."""
    name, source, restored, centimetres = task
    try:
        errors = file_errors(source, restored, centimetres)
    except (AssertionError, ValueError, KeyError, IndexError, OSError) as problem:
        return Check(name, problem=f"cannot be compared ({type(problem).__name__}: {problem})")
    return Check(name, float(errors.max(initial=0.0)), float(errors.sum()), errors.size)


def _row(tolerance: str, run: Run) -> tuple[str, ...]:
    report, checks = run.report, run.checks
    mean = sum(c.total for c in checks) / max(1, sum(c.count for c in checks))
    return (
        tolerance,
        f"{report.clips:,}",
        show_bytes(report.source_bytes),
        show_bytes(report.float32_bytes),
        show_bytes(report.archive_bytes),
        f"{report.source_bytes / report.archive_bytes:.1f}",
        f"{report.float32_bytes / report.archive_bytes:.1f}",
        f"{mean * 10:.3g} mm",
        f"{max((c.largest for c in checks), default=0.0) * 10:.5g} mm",
        f"{len(checks):,}",
        f"{run.seconds['archive']:.0f} s",
        show_bytes(run.memory),
        f"{run.seconds['verify']:.0f} s",
        f"{run.seconds['restore']:.0f} s",
    )


def _print_extremes(text: str, tolerance: float, run: Run, folder: Path) -> None:
    """Print what stands out: files nearest to the bound, and clips that shrink least."""
    stages = ", ".join(f"{stage} {value:.1f} s" for stage, value in run.report.seconds.items())
    store = run.report.archive_bytes - run.report.index_bytes
    print(f"{text}: {stages}; {run.report.patterns:,} patterns; all but index files {store:,} B")
    for result in sorted(run.checks, key=lambda c: -c.largest)[:3]:
        print(
            f"{text}: nearest to the bound: {result.largest / tolerance:.6f} of it, {result.name}"
        )
    with Archive(folder) as archive:
        ratios = sorted(
            (clip.row.source_bytes / clip.path.stat().st_size, name)
            for name, clip in archive.items()
        )
    for ratio, name in ratios[:3]:
        print(f"{text}: shrinks least: {ratio:.1f} : 1, {name}", flush=True)


@contextmanager
def _timed(run: Run, stage: str) -> Iterator[None]:
    start = time.perf_counter()
    yield
    run.seconds[stage] = time.perf_counter() - start


@contextmanager
def _folder(wanted: Path | None) -> Iterator[Path]:
    if wanted is not None:
        yield wanted
        return
    with tempfile.TemporaryDirectory(prefix="motifold-") as made:
        yield Path(made)


if __name__ == "__main__":
    sys.exit(main())
