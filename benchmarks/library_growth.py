"""Does a larger library archive denser? float32 of the varying channels over the whole archive."""

from __future__ import annotations

import random
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from motion_sets import link_library
from targets import GROWTH_CLIPS

from motifold.pipeline.plan import Settings
from motifold.pipeline.run import archive_library

SMALL, LARGE = GROWTH_CLIPS
DRAWS = 5


def growth_sizes(clips: int) -> tuple[int, int]:
    """Return how many clips the small and the large library have, of so many that there are."""
    large = min(LARGE, clips)
    return min(SMALL, max(1, large // 10)), large


def measure_growth(
    files: Mapping[str, Path],
    settings: Sequence[Settings],
    out: Path,
    workers: int | None,
    seed: int,
) -> dict[str, Any]:
    """Return the ratios of a large library and of small ones drawn from it, as JSON values.

    ``settings``: one for each tolerance to try. The small libraries' ratio is that of their
    summed bytes.
    """
    small, large = growth_sizes(len(files))
    generator = random.Random(seed)
    most = sorted(generator.sample(sorted(files), large))
    draws = [sorted(generator.sample(most, small)) for _ in range(DRAWS)]
    figures = []
    for each in settings:
        few = [_ratio(files, draw, each, out, workers) for draw in draws]
        many = _ratio(files, most, each, out, workers)
        before = sum(numbers for numbers, _ in few) / sum(size for _, size in few)
        after = many[0] / many[1]
        ratios = [numbers / size for numbers, size in few]
        figures.append(
            {
                "tolerance": each.tolerance,
                "small_ratio": before,
                "small_least": min(ratios),
                "small_most": max(ratios),
                "large_ratio": after,
                "growth": after / before,
            }
        )
        print(f"growth at {each.tolerance * 10:g} mm: {figures[-1]}", file=sys.stderr, flush=True)
    return {"small": small, "large": large, "draws": DRAWS, "figures": figures}


def _ratio(
    files: Mapping[str, Path], stems: list[str], settings: Settings, out: Path, workers: int | None
) -> tuple[int, int]:
    """Return the float32 bytes and the archive bytes of a library of the clips ``stems``."""
    library, archive = out / "growth-library", out / "growth-archive"
    link_library({stem: files[stem] for stem in stems}, library)
    few = len(stems) <= SMALL  # starting processes takes longer than those
    report = archive_library(library, archive, settings, workers=0 if few else workers)
    if report.failures:
        raise SystemExit(f"{report.failures[0].name}: {report.failures[0].reason}")
    shutil.rmtree(library)
    shutil.rmtree(archive)
    return report.float32_bytes, report.archive_bytes
