"""Bytes against the Animation Compression Library (ACL 2.1) on the same clips, same error.

python benchmarks/peers.py FOLDER [--sample 200] [--csv ../shared/peers/acl_bandai.csv]

ACL's figures come from a CSV with a row per clip and precision. The clips are archived at
several tolerances as a library of their own, so that the store and everything else that an
archive needs is counted in full, and not scaled: a smaller sample is a dearer one.

Maximum error matched: per clip, the size of its index file as a function of its certified
largest shell error (log-log interpolation over the tolerances) is read at ACL's largest shell
error of that clip and precision; the sum gets everything else of the archive whose tolerance
is nearest. motifold's error covers end sites too, ACL's only joints.

Mean error matched: archive size as a function of the frame-weighted mean displacement of the
joints (restored files measured by tests/oracle.py) is read at ACL's mean over the same clips.
"""

from __future__ import annotations

import argparse
import csv
import random
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
import numpy.typing as npt
from oracle_files import joint_distances, read_pair
from tables import print_table

from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import executor
from motifold.pipeline.plan import Settings
from motifold.pipeline.restore import restore_clips
from motifold.pipeline.run import archive_library
from motifold.workflows.quantities import parse_length

Floats = npt.NDArray[np.float64]
ACL = Path(__file__).resolve().parents[2] / "shared" / "peers" / "acl_bandai.csv"
TOLERANCES = "0.09mm,0.15mm,0.3mm,0.6mm,1.2mm,2.5mm,5mm,10mm,20mm,40mm"
Rows = dict[str, dict[str, dict[str, str]]]  # precision, clip, column


@dataclass(frozen=True)
class Run:
    """The clips at one tolerance: bytes and certified maximum (cm) per clip, and the rest."""

    tolerance: float
    index_bytes: Floats
    largest: Floats
    archive_bytes: int
    joint_mean: float

    @property
    def shared_bytes(self) -> float:
        """Bytes of the archive that are no clip's own: store, ledger, commit."""
        return float(self.archive_bytes - self.index_bytes.sum())


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, help="folder of the BVH files named in the CSV")
    parser.add_argument("--sample", type=int, default=200, help="random clips; 0: all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--csv", type=Path, default=ACL)
    parser.add_argument("--tolerances", default=TOLERANCES)
    parser.add_argument("--precisions", default="0.01,0.03,0.1,0.3,1.0", help="of ACL, cm")
    parser.add_argument("--workers", type=int)
    options = parser.parse_args()
    if not options.csv.is_file():
        raise SystemExit(f"{options.csv} is not there: no figures of ACL to compare with")
    acl = _read(options.csv)
    clips = sorted(
        clip for clip in next(iter(acl.values())) if (options.folder / f"{clip}.bvh").is_file()
    )
    if options.sample:
        clips = sorted(random.Random(options.seed).sample(clips, min(options.sample, len(clips))))
    runs = []
    with tempfile.TemporaryDirectory(prefix="motifold-") as folder:
        library = Path(folder, "library")
        library.mkdir()
        for clip in clips:
            (library / f"{clip}.bvh").symlink_to((options.folder / f"{clip}.bvh").resolve())
        for text in options.tolerances.split(","):
            runs.append(_run(library, Path(folder, text), parse_length(text), options.workers))
            print(_described(runs[-1]), flush=True)
    rows: list[tuple[str, ...]] = [
        ("ACL precision", "ACL bytes", "max matched", "/ ACL", "mean matched", "/ ACL", "note")
    ]
    for precision in options.precisions.split(","):
        rows.append(_compare(precision, [acl[precision][clip] for clip in clips], runs))
    print_table(rows)


def _read(path: Path) -> Rows:
    rows: Rows = {}
    with path.open(newline="") as handle:
        for row in csv.DictReader(handle):
            rows.setdefault(row["precision_cm"], {})[row["clip"]] = row
    return rows


def _run(library: Path, out: Path, tolerance: float, workers: int | None) -> Run:
    report = archive_library(
        library, out / "archive", Settings(tolerance=tolerance), workers=workers
    )
    if report.failures:
        raise SystemExit(f"{report.failures[0].name}: {report.failures[0].reason}")
    total = count = 0.0
    with Archive(out / "archive") as archive, executor(workers) as engine:
        done = restore_clips(archive, list(archive), out / "restored", engine=engine)
        sizes = [float(clip.path.stat().st_size) for clip in archive.values()]
        largest = [clip.certificate.maximum for clip in archive.values()]
        units = {name: clip.rig.layout.centimetres for name, clip in archive.items()}
    for name, path in done.files.items():
        distances = joint_distances(*read_pair(library / name, Path(path), units[name]))
        total += float(distances.sum())
        count += distances.size
    return Run(tolerance, np.array(sizes), np.array(largest), report.archive_bytes, total / count)


def _described(run: Run) -> str:
    return (
        f"tolerance {run.tolerance * 10:g} mm: archive {run.archive_bytes:,} B, of which "
        f"{run.shared_bytes:,.0f} B are shared; mean joint error {run.joint_mean:.6f} cm"
    )


def _compare(precision: str, acl: list[dict[str, str]], runs: list[Run]) -> tuple[str, ...]:
    """Return a table row: bytes at ACL's errors of one precision, and their ratios to ACL's."""
    peer = sum(int(row["bytes"]) for row in acl)
    wanted = np.array([float(row["shell_max_cm"]) for row in acl])
    largest = np.log([run.largest for run in runs])
    sizes = np.log([run.index_bytes for run in runs])
    at_maximum = [
        float(np.exp(_interpolated(np.log(limit), largest[:, clip], sizes[:, clip])))
        for clip, limit in enumerate(wanted)
    ]
    outside = int(((np.log(wanted) < largest[0]) | (np.log(wanted) > largest[-1])).sum())
    typical = np.log(np.median(wanted))
    nearest = min(runs, key=lambda run: abs(np.log(run.tolerance) - typical))
    by_maximum = sum(at_maximum) + nearest.shared_bytes

    frames = np.array([float(row["frames"]) for row in acl])
    mean = float(np.average([float(row["joint_mean_cm"]) for row in acl], weights=frames))
    means = np.log([run.joint_mean for run in runs])
    totals = np.log([float(run.archive_bytes) for run in runs])
    by_mean = float(np.exp(_interpolated(np.log(mean), means, totals)))
    notes = [f"{outside} clips extrapolated"] if outside else []
    if not means[0] <= np.log(mean) <= means[-1]:
        notes.append("mean extrapolated")
    return (
        f"{precision} cm",
        f"{peer:,}",
        f"{by_maximum:,.0f}",
        f"{by_maximum / peer:.3f}",
        f"{by_mean:,.0f}",
        f"{by_mean / peer:.3f}",
        "; ".join(notes),
    )


def _interpolated(at: float, x: Floats, y: Floats) -> float:
    """Interpolate between points of increasing ``x``; outside, the outermost line goes on."""
    right = int(np.clip(np.searchsorted(x, at), 1, len(x) - 1))
    slope = (y[right] - y[right - 1]) / (x[right] - x[right - 1])
    return float(y[right - 1] + slope * (at - x[right - 1]))


if __name__ == "__main__":
    main()
