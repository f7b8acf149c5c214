"""Reading sizes off measured curves: bytes at an error between those that were tried."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bound = Literal["max", "mean"]

LEAST_ERROR = 1e-9  # centimetres; a clip without any error has a logarithm too
MEAN_TRIALS = 4
MEAN_CLOSE = 0.02  # of the wanted mean, as a logarithm
MEAN_STEP = 1.1
MEAN_START = 1.5  # what is bounded is the mean shell error; that of joints is smaller


@dataclass(frozen=True)
class Run:
    """One archive of a set of clips; per-clip values are in the order of the clips' names.

    ``bound`` and ``value`` (centimetres): the setting that it was made with. ``index_bytes``
    (clips,): sizes of the index files; ``largest`` (clips,): certified largest shell errors,
    centimetres. ``archive_bytes``: the whole folder. ``joint_mean``: mean displacement of the
    joints over all frames of all clips, centimetres.
    """

    bound: Bound
    value: float
    index_bytes: Floats
    largest: Floats
    archive_bytes: int
    float32_bytes: int
    source_bytes: int
    joint_mean: float

    @property
    def shared_bytes(self) -> float:
        """Bytes of the archive that are no clip's own: store, ledger, commit."""
        return float(self.archive_bytes - self.index_bytes.sum())


def interpolated(at: float, x: Floats, y: Floats) -> float:
    """Return y at ``at``, linear in the logarithms of all three; the outermost lines go on.

    ``x``, ``y``: (points,) positive, in any order. Of points with the same x the smallest y
    counts; one point alone gives its y. Raises ValueError for none.
    """
    if not len(x):
        raise ValueError("no points to interpolate between")
    order = np.lexsort((y, x))
    keep = np.ones(len(x), bool)
    keep[1:] = np.diff(x[order]) > 0
    logs, values = np.log(x[order][keep]), np.log(y[order][keep])
    if len(logs) == 1:
        return float(np.exp(values[0]))
    right = int(np.clip(np.searchsorted(logs, math.log(at)), 1, len(logs) - 1))
    slope = (values[right] - values[right - 1]) / (logs[right] - logs[right - 1])
    return float(np.exp(values[right - 1] + slope * (math.log(at) - logs[right - 1])))


def bytes_at_maximum(runs: Sequence[Run], wanted: Floats) -> tuple[float, int]:
    """Return the archive's bytes at each clip's own largest shell error, and how many guessed.

    ``wanted``: (clips,) centimetres. Per clip the size of its index file is read off its own
    curve; the sum gets all other bytes of the run whose value is nearest to the median wanted.
    The second number counts the clips whose error is outside their curve.
    """
    largest = np.maximum([run.largest for run in runs], LEAST_ERROR)
    sizes = np.array([run.index_bytes for run in runs])
    own = sum(
        interpolated(float(limit), largest[:, clip], sizes[:, clip])
        for clip, limit in enumerate(wanted)
    )
    outside = int(((wanted < largest.min(axis=0)) | (wanted > largest.max(axis=0))).sum())
    typical = math.log(float(np.median(wanted)))
    nearest = min(runs, key=lambda run: abs(math.log(run.value) - typical))
    return own + nearest.shared_bytes, outside


def bytes_at_mean(runs: Sequence[Run], wanted: float) -> tuple[float, bool]:
    """Return the archive's bytes at a mean joint error (centimetres), and whether guessed."""
    means = np.array([run.joint_mean for run in runs])
    sizes = np.array([float(run.archive_bytes) for run in runs])
    size = interpolated(wanted, means, sizes)
    return size, not means.min() <= wanted <= means.max()


def runs_near_mean(at: Callable[[float], Run], wanted: float) -> list[Run]:
    """Return at least two runs, one of which has about the ``wanted`` mean joint error.

    ``at`` makes the archive for a value of the setting, whose effect is taken to be in
    proportion to it: each trial is scaled by what the last one missed.
    """
    runs = [at(MEAN_START * wanted)]
    while len(runs) < MEAN_TRIALS:
        missed = wanted / max(runs[-1].joint_mean, LEAST_ERROR)
        close = abs(math.log(missed)) < MEAN_CLOSE
        if close and len(runs) > 1:
            break
        factor = missed if not close else MEAN_STEP if missed > 1.0 else 1.0 / MEAN_STEP
        runs.append(at(runs[-1].value * factor))
    return runs
