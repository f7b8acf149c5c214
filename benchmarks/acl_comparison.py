"""Bytes against the Animation Compression Library (ACL 2.1) on the same clips, same error.

Largest error matched: per clip, the size of its index file as a function of its certified
largest shell error is read at ACL's largest shell error of that clip; the sum gets everything
else of an archive. motifold's error covers end sites too, ACL's only joints. Mean error
matched: the archive's size as a function of the mean displacement of the joints over all
frames is read at ACL's, over the same clips.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from archive_runs import ArchiveRuns
from job_settings import bounds_mean
from rate_curves import Bound, Floats, Run, bytes_at_maximum, bytes_at_mean, runs_near_mean


@dataclass(frozen=True)
class AclPrecision:
    """What ACL did to some clips at one precision; arrays are (clips,), errors centimetres."""

    precision: str
    sizes: Floats
    frames: Floats
    joints: Floats
    joint_means: Floats
    shell_largest: Floats

    @property
    def bytes(self) -> int:
        """Bytes of all clips."""
        return int(self.sizes.sum())

    @property
    def joint_mean(self) -> float:
        """Mean displacement of the joints over all frames, centimetres."""
        return float(np.average(self.joint_means, weights=self.frames * self.joints))

    @property
    def joint_frames(self) -> int:
        """Frames times joints of all clips."""
        return int((self.frames * self.joints).sum())


def read_acl(path: Path, clips: Iterable[str]) -> dict[str, AclPrecision]:
    """Return ACL's figures for ``clips``, in their order, by precision as the file writes it.

    ``path``: a CSV with a row per clip and precision. SystemExit where it lacks one.
    """
    if not path.is_file():
        raise SystemExit(f"{path} is not there: no figures of ACL to compare with (see --peers)")
    rows: dict[str, dict[str, dict[str, str]]] = {}
    with path.open(newline="") as handle:
        for row in csv.DictReader(handle):
            rows.setdefault(row["precision_cm"], {})[row["clip"]] = row
    names = list(clips)
    found = {}
    for precision, by_clip in rows.items():
        if missing := [name for name in names if name not in by_clip]:
            raise SystemExit(f"{path} has no row for {missing[0]} at {precision} cm")
        columns = [
            np.array([float(by_clip[name][column]) for name in names])
            for column in ("bytes", "frames", "joints", "joint_mean_cm", "shell_max_cm")
        ]
        found[precision] = AclPrecision(precision, *columns)
    return found


def compare_acl(
    archives: ArchiveRuns,
    acl: dict[str, AclPrecision],
    precisions: Sequence[str],
    tolerances: Sequence[float],
    bound: Bound,
) -> dict[str, Any]:
    """Return the figures against ACL at ``precisions``, and both curves, as JSON values.

    ``tolerances``: of the archives to make, centimetres. With ``bound`` "mean", archives that
    are matched by their mean error are made with a bound on it, where motifold has one.
    """
    if unknown := [precision for precision in precisions if precision not in acl]:
        raise SystemExit(f"ACL has no figures at {unknown[0]} cm, only at {', '.join(acl)}")
    runs = [archives.at("max", tolerance) for tolerance in sorted(tolerances)]
    by_mean = list(runs)
    if bound == "mean" and bounds_mean():
        by_mean = []
        for precision in precisions:
            wanted = acl[precision].joint_mean
            by_mean += runs_near_mean(lambda value: archives.at("mean", value), wanted)
    joint_frames = next(iter(acl.values())).joint_frames
    return {
        "figures": [figure(acl[precision], runs, by_mean) for precision in precisions],
        "joint_frames": joint_frames,
        "mean_setting": by_mean[0].bound,
        "curve": sorted((run.joint_mean, run.archive_bytes) for run in by_mean),
        "acl_curve": sorted((entry.joint_mean, entry.bytes) for entry in acl.values()),
    }


def figure(acl: AclPrecision, runs: Sequence[Run], by_mean: Sequence[Run]) -> dict[str, Any]:
    """Return one precision's figures: bytes at ACL's errors, and their ratios to ACL's."""
    at_maximum, outside = bytes_at_maximum(runs, acl.shell_largest)
    at_mean, beyond = bytes_at_mean(by_mean, acl.joint_mean)
    notes = [f"{outside} of {len(acl.sizes)} clips extrapolated"] if outside else []
    notes += ["mean extrapolated"] if beyond else []
    if any(run.bound == "mean" and run.joint_mean > run.value for run in by_mean):
        notes += ["motifold does not keep the mean error it was asked for"]
    return {
        "precision": acl.precision,
        "acl_bytes": acl.bytes,
        "acl_joint_mean": acl.joint_mean,
        "max_bytes": round(at_maximum),
        "max_ratio": at_maximum / acl.bytes,
        "mean_bytes": round(at_mean),
        "mean_ratio": at_mean / acl.bytes,
        "notes": notes,
    }
