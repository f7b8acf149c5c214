"""How dense an archive gets as its library grows.

From the archive's own ledger, a point a job, or by archiving random subsets of the library
again. The whole store is counted, and error stands beside ratio. Clips whose source files are
equal, byte by byte, count once: what is stored twice for nothing proves nothing.
"""

from __future__ import annotations

import random
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from ..codec.errors import InputError, UsageError
from ..codec.version2.motionfile import MotionFile
from ..codec.version2.motionhead import read_references
from ..pipeline.archive import Archive
from ..pipeline.archived_clip import ArchivedClip
from ..pipeline.discover import Source, discover
from ..pipeline.durable import digest, folder_bytes
from ..pipeline.layout import index_path
from ..pipeline.ledger import Row, ledger_path
from ..pipeline.plan import Settings
from ..pipeline.run import archive_library
from ..pipeline.store import NAME as STORE

TEXT_BYTES = 10  # of a number as text: "-12.34567 ", as the papers' text files hold them


@dataclass(frozen=True)
class GrowthPoint:
    """An archive at one size.

    ``clips``: distinct ones; ``duplicates``: clips left out because another one's source is
    equal. Bytes: ``archive`` is everything but the search catalog; the others are the three
    baselines. Errors in centimetres: the largest, and the mean over frames of the certified
    means, which are never understated. ``patterns``: in the store (index files of version 1);
    ``predicted``: share of the clips that are predicted from other ones, by patterns or
    references. ``added_100``: what 100 clips added since the point before, bytes.
    """

    clips: int
    duplicates: int
    tolerance: float
    source_bytes: int
    text_bytes: int
    float32_bytes: int
    archive_bytes: int
    max_error: float
    mean_error: float
    patterns: int
    predicted: float
    added_100: float
    seconds: float = 0.0

    @property
    def ratios(self) -> dict[str, float]:
        """How many times smaller the archive is than each baseline."""
        size = max(self.archive_bytes, 1)
        return {
            "source": self.source_bytes / size,
            "text": self.text_bytes / size,
            "float32": self.float32_bytes / size,
        }


def ledger_growth(archive: Archive) -> list[GrowthPoint]:
    """Return a point for every job of an archive. Raises `DamagedError`."""
    points: list[GrowthPoint] = []
    seen: dict[tuple[str, int], Row] = {}
    files: set[str] = set()
    size = duplicates = predicted = 0
    error_sum = largest = 0.0
    for job in archive.commit.jobs:
        ledger = archive.ledgers[job.generation]
        size += folder_bytes(archive.path / STORE / f"{job.generation:06d}")
        size += ledger_path(archive.path, job.generation).stat().st_size
        for row in ledger.rows:
            if row.index not in files:
                files.add(row.index)
                size += index_path(archive.path, row.index).stat().st_size
            if row.content in seen:
                duplicates += 1
                continue
            seen[row.content] = row
            index = ArchivedClip(archive, row, job.generation).index(prefix_only=True)
            largest = max(largest, index.certificate.maximum)
            error_sum += index.certificate.mean * row.frames
            if isinstance(index, MotionFile):
                predicted += bool(read_references(index))
            else:
                predicted += bool(sum(map(sum, job.patterns.values())))
        rows = list(seen.values())
        numbers = sum(row.numbers for row in rows)
        before = points[-1] if points else None
        new = len(rows) - (before.clips if before else 0)
        points.append(
            GrowthPoint(
                len(rows),
                duplicates,
                float(ledger.settings["tolerance"]),
                sum(row.source_bytes for row in rows),
                TEXT_BYTES * numbers,
                4 * numbers,
                size,
                largest,
                error_sum / max(sum(row.frames for row in rows), 1),
                sum(sum(counts) for counts in job.patterns.values()),
                predicted / max(len(rows), 1),
                _per_100(size - (before.archive_bytes if before else 0), new),
            )
        )
    return points


def replay(
    library: Path,
    sizes: Sequence[int],
    settings: Settings,
    *,
    workers: int | None = None,
    seed: int = 0,
    progress: Callable[[str, int, int], None] | None = None,
) -> list[GrowthPoint]:
    """Return a point for each size, by archiving random subsets of a library's files.

    Each subset holds the smaller ones, and only clips of distinct content. Raises `UsageError`
    if the library has fewer, and `InputError` if a file cannot be archived.
    """
    sources = _distinct(discover(library))
    wanted = sorted(set(sizes))
    if not wanted or wanted[0] < 1 or wanted[-1] > len(sources):
        raise UsageError(
            f"{library} has {len(sources):,} distinct clips",
            advice=f"Replay sizes from 1 to {len(sources)}",
        )
    random.Random(seed).shuffle(sources)
    points: list[GrowthPoint] = []
    for size in wanted:
        with tempfile.TemporaryDirectory(prefix="motifold-growth-") as folder:
            part = Path(folder) / "library"
            _link(sources[:size], part)
            report = archive_library(
                part,
                Path(folder) / "archive",
                settings,
                workers=workers if size > 32 else 0,
                progress=_told(progress, size),
            )
            if report.failures:
                failure = report.failures[0]
                raise InputError(failure.reason, file=failure.name, advice="Leave it out")
            with Archive(Path(folder) / "archive") as archive:
                point = ledger_growth(archive)[-1]
            shutil.rmtree(part)
        if points:
            added = point.archive_bytes - points[-1].archive_bytes
            point = replace(point, added_100=_per_100(added, size - points[-1].clips))
        points.append(replace(point, seconds=sum(report.seconds.values())))
    return points


def _told(progress: Callable[[str, int, int], None] | None, size: int) -> Callable[[object], None]:
    def tell(step: object) -> None:
        if progress:
            stage, done, clips = (getattr(step, name) for name in ("stage", "done", "clips"))
            progress(f"{size} clips: {stage}", done, clips)

    return tell


def _distinct(sources: list[Source]) -> list[Source]:
    """Return the sources of distinct content, the first of each, by name."""
    found: dict[str, Source] = {}
    for source in sources:
        found.setdefault(digest(Path(source.path).read_bytes()), source)
    return sorted(found.values())


def _link(sources: Sequence[Source], folder: Path) -> None:
    """Make a library of links to some sources, and to the skeletons that lie beside them."""
    for source in sources:
        path = Path(source.path)
        place = folder / source.name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.symlink_to(path.resolve())
        for skeleton in path.parent.glob("*.asf"):
            link = place.parent / skeleton.name
            if not link.is_symlink():
                link.symlink_to(skeleton.resolve())


def _per_100(size: int, clips: int) -> float:
    return 100.0 * size / clips if clips else 0.0


def growth_record(points: Sequence[GrowthPoint]) -> list[dict[str, object]]:
    """Return points as JSON values, with their ratios."""
    return [{**asdict(point), "ratios": point.ratios} for point in points]
