"""Archives of one set of clips at many settings, each measured on what it decodes to."""

from __future__ import annotations

import random
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
from job_settings import settings_for
from oracle import shell_error
from oracle_files import joint_distances, read_pair
from parallel import in_processes
from rate_curves import Bound, Run

from motifold.codec.clip import SkeletonClip
from motifold.codec.formats.files import read_clip
from motifold.codec.geometry.kinematics import world_positions, world_rotations
from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import SerialExecutor
from motifold.pipeline.restore import restore_clips
from motifold.pipeline.run import archive_library

ORACLE_CLOSE = 1e-5  # centimetres; restored texts have six decimals


class ArchiveRuns:
    """Makes the archives of a library that are asked for, each once.

    ``sources``: clip name to file, all in one folder; ``out``: a folder for what is made,
    which is removed again; ``check``: how many clips of each archive are restored as files and
    read by the tests' independent code; ``changes``: to the settings. SystemExit if a clip fails
    or is not what it should be.
    """

    def __init__(
        self,
        sources: Mapping[str, Path],
        out: Path,
        workers: int | None,
        check: int = 4,
        changes: Mapping[str, Any] | None = None,
    ) -> None:
        self.sources = sources
        self.library = next(iter(sources.values())).parent
        self.out = out
        self.workers = workers
        self.check = check
        self.changes = changes
        self._made: dict[tuple[Bound, float], Run] = {}

    def at(self, bound: Bound, centimetres: float) -> Run:
        """Return the run of a setting."""
        key = bound, centimetres
        if key not in self._made:
            self._made[key] = self._run(bound, centimetres)
            print(_described(self._made[key]), file=sys.stderr, flush=True)
        return self._made[key]

    def _run(self, bound: Bound, centimetres: float) -> Run:
        folder = self.out / f"{bound}-{centimetres:.9g}"
        settings = settings_for(bound, centimetres, self.changes)
        report = archive_library(self.library, folder, settings, workers=self.workers)
        if report.failures:
            raise SystemExit(f"{report.failures[0].name}: {report.failures[0].reason}")
        with Archive(folder) as archive:
            names = sorted(self.sources)
            if sorted(archive) != names:
                raise SystemExit(f"{folder} does not hold the clips that went in")
            self._check(archive, names, folder / "restored")
            tasks = [(archive, name, self.sources[name]) for name in names]
            sums = np.array(in_processes(joint_errors, tasks, self.workers))
            sizes = [float(archive[name].path.stat().st_size) for name in names]
            largest = [archive[name].certificate.maximum for name in names]
        shutil.rmtree(folder)
        return Run(
            bound,
            centimetres,
            np.array(sizes),
            np.array(largest),
            report.archive_bytes,
            report.float32_bytes,
            report.source_bytes,
            float(sums[:, 0].sum() / sums[:, 1].sum()),
        )

    def _check(self, archive: Archive, names: list[str], folder: Path) -> None:
        """Let code that is not motifold's read some restored files; it must say the same."""
        some = random.Random(0).sample(names, min(self.check, len(names)))
        done = restore_clips(archive, some, folder, engine=SerialExecutor())
        if done.failures:
            raise SystemExit(f"{done.failures[0].name}: {done.failures[0].reason}")
        for name, path in done.files.items():
            clip = archive[name]
            source = self.sources[name]
            pair = read_pair(source, Path(path), clip.rig.layout.centimetres)
            distances = joint_distances(*pair)
            total, count = joint_errors((archive, name, source))
            largest = float(shell_error(*pair).max(initial=0.0))
            told_above = ORACLE_CLOSE + 7e-4 * largest  # certificates are rounded up
            if (
                distances.size != count
                or abs(float(distances.mean()) - total / count) > ORACLE_CLOSE
                or not -ORACLE_CLOSE < clip.certificate.maximum - largest < told_above
            ):
                raise SystemExit(
                    f"{name}: restored and read by independent code, its joints are "
                    f"{distances.mean():.7g} cm off in the mean and {largest:.7g} cm at most "
                    f"(shell); motifold says {total / count:.7g} and {clip.certificate.maximum:.7g}"
                )


def joint_errors(task: tuple[Archive, str, Path]) -> tuple[float, int]:
    """Return the summed displacement (centimetres) of a clip's joints, and of how many."""
    archive, name, source = task
    before, after = (joint_positions(clip) for clip in (read_clip(source), archive[name].decode()))
    distances = np.linalg.norm(after - before, axis=2)
    return float(distances.sum()), distances.size


def joint_positions(clip: object) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the joints' world positions (frames, joints, 3), centimetres."""
    assert isinstance(clip, SkeletonClip)
    world = world_rotations(clip.skeleton, clip.rotations)
    return world_positions(clip.skeleton, world, clip.translations)


def _described(run: Run) -> str:
    return (
        f"{run.bound} {run.value * 10:.4g} mm: archive {run.archive_bytes:,} B, of which "
        f"{run.shared_bytes:,.0f} B are shared; mean joint error {run.joint_mean:.6f} cm"
    )
