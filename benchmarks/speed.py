"""Speed of archiving and of decoding BVH files, on one core.

python benchmarks/speed.py FOLDER [--clips N] [--tolerance 1mm] [--profile]

A random part of the folder is archived in this process. Every stage is compared with a plain
NumPy parse of the same files in the same run (``np.array(text.split(), float)`` of the motion
block), which makes the figures comparable between machines; the stages' times are wall time, with
nothing else running. Decoding is measured twice: all clips one after the other, as verifying or
restoring an archive does, and single clips each in an archive just opened, whose references must
be decoded first. ``--profile`` shows where decoding spends its time.
"""

from __future__ import annotations

import argparse
import cProfile
import os
import pstats
import random
import tempfile
import time
from pathlib import Path

import numpy as np
from motion_sets import link_library
from tables import print_table
from threadpoolctl import threadpool_limits

from motifold.pipeline.archive import Archive
from motifold.pipeline.discover import discover
from motifold.pipeline.plan import Settings
from motifold.pipeline.run import archive_library
from motifold.workflows.quantities import parse_length

PROFILED_LINES = 18
COLD_CLIPS = 20


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--clips", type=int, default=200, help="random clips, seed 0")
    parser.add_argument("--tolerance", default="1mm")
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    found = discover(options.folder, ["*.bvh"])
    chosen = random.Random(0).sample(found, min(options.clips, len(found)))
    sources = {source.name: Path(source.path).resolve() for source in chosen}
    settings = Settings(tolerance=parse_length(options.tolerance))
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")
    with threadpool_limits(1), tempfile.TemporaryDirectory(prefix="motifold-") as folder:
        library = link_library(sources, Path(folder, "library"))
        _warm(library[min(library)], Path(folder, "warm"), settings)
        measure(library, Path(folder), settings, options.profile)


def measure(library: dict[str, Path], folder: Path, settings: Settings, profile: bool) -> None:
    """Archive a library and decode it, and print what took how long."""
    plain = _plain_seconds(library)
    report = archive_library(folder / "library", folder / "archive", settings, workers=0)
    if report.failures:
        raise SystemExit(f"{report.failures[0].name}: {report.failures[0].reason}")
    seconds = dict(report.seconds)
    seconds["archive job"] = sum(seconds.values())
    text = report.source_bytes / 1e6
    profiler = cProfile.Profile()
    motion = 0.0
    with Archive(folder / "archive") as archive:
        start = time.perf_counter()
        if profile:
            profiler.enable()
        for name in sorted(archive):
            clip = archive[name]
            clip.decode()
            motion += clip.frames * clip.frame_time
        profiler.disable()
        seconds["decode all"] = time.perf_counter() - start
    cold = cold_motion = 0.0
    for name in random.Random(1).sample(sorted(library), min(COLD_CLIPS, len(library))):
        start = time.perf_counter()
        with Archive(folder / "archive") as archive:
            clip = archive[name]
            clip.decode()
            cold += time.perf_counter() - start
            cold_motion += clip.frames * clip.frame_time
    print(
        f"{len(library)} clips, {text:.1f} MB of text, {motion / 60:.1f} min of motion, tolerance "
        f"{settings.tolerance * 10:g} mm, archive {report.archive_bytes / 1e6:.3f} MB"
    )
    rows = [("stage", "MB/s of text", "times the plain parse")]
    for stage, value in seconds.items():
        rows.append((stage, f"{text / value:.1f}", f"{value / plain:.2f}"))
    print_table(rows)
    print(f"decoding all runs {motion / seconds['decode all']:,.0f} times faster than real time")
    print(f"a clip of an archive just opened, {cold_motion / cold:,.0f} times")
    if profile:
        pstats.Stats(profiler).strip_dirs().sort_stats("tottime").print_stats(PROFILED_LINES)


def _warm(path: Path, folder: Path, settings: Settings) -> None:
    """Let everything be compiled and imported that will be."""
    library = link_library({path.name: path.resolve()}, folder / "library")
    archive_library(folder / "library", folder / "archive", settings, workers=0)
    with Archive(folder / "archive") as archive:
        archive[min(library)].decode()


def _plain_seconds(library: dict[str, Path]) -> float:
    """Parse the motion blocks of the files without looking at anything, as a yardstick."""
    total = 0.0
    for path in library.values():
        content = path.read_bytes()
        start = time.perf_counter()
        text = content.decode().partition("Frame Time:")[2].partition("\n")[2]
        np.array(text.split(), float)
        total += time.perf_counter() - start
    return total


if __name__ == "__main__":
    main()
