"""Clustering in steps: segments of a clip first, then across clips into one growing store.

Gu et al. 2009 (Section 3.3) restart K-means with more and more clusters until the largest
distance to a cluster's mean, MaxError (Eq. 2), is small enough: quadratic in the library, and
every restart renumbers. Here patterns are only ever added. Step one leaves one representative
for segments of a clip that are closer than a quarter of the radius; step two gives a
representative to a known pattern within three quarters of the radius, and lets the others
found new ones. By the triangle inequality every segment is within the radius of its pattern,
so MaxError holds, at a cost per clip that does not grow with the store.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
from sklearn.cluster import MiniBatchKMeans

from ..codec.clip import FloatArray, IntArray
from ..codec.errors import UsageError
from ..codec.patterns.nearest import NearestPatterns
from ..codec.patterns.patterns import distance_scale, to_centimetres, to_coefficients

WITHIN_CLIP = 0.25  # of the radius; the rest is left for the step across clips


@dataclass(frozen=True)
class ClusterRules:
    """How alike segments must be to share a pattern.

    ``bound``: ``max`` bounds every segment's distance from its pattern (MaxError, Eq. 2),
    ``average`` only their mean square (AveError, Eq. 1), with fewer patterns.
    ``radius_coefficient``: the bound in head diagonals; it is never less than
    ``least_tolerances`` times the tolerance, below which patterns would only describe noise.
    """

    bound: Literal["max", "average"] = "max"
    radius_coefficient: float = 0.6
    least_tolerances: float = 4.0

    def __post_init__(self) -> None:
        if self.bound not in ("max", "average"):
            raise UsageError(f"unknown cluster bound {self.bound!r}", advice="Use max or average")
        if not 0.0 <= self.radius_coefficient < math.inf:
            raise UsageError(
                f"a cluster radius of {self.radius_coefficient:g} head diagonals",
                advice="Choose a number from 0 up",
            )

    def radius(self, head_diagonal: float, tolerance: float) -> float:
        """Return the bound in RMS centimetres for a body size and a tolerance in centimetres."""
        return max(self.radius_coefficient * head_diagonal, self.least_tolerances * tolerance)


@dataclass(frozen=True, eq=False)
class Representatives:
    """What step one leaves of a clip's part: ``points`` (n, 16, channels) in centimetres,
    each for ``counts`` (n,) segments.
    """

    points: npt.NDArray[np.float32]
    counts: IntArray


def within_clip(points: FloatArray, radius: float) -> Representatives:
    """Step one: return the representatives of one clip's segments (n, 16, channels).

    Each segment joins the nearest earlier representative within ``radius`` × `WITHIN_CLIP`
    (RMS centimetres), or becomes one.
    """
    scale = distance_scale(points.shape[2])
    chosen: list[int] = []
    counts: list[int] = []
    flat = points.reshape(len(points), points.shape[1] * points.shape[2])
    for number, point in enumerate(flat):
        if chosen:
            gaps = np.sqrt(np.square(flat[chosen] - point).sum(axis=1)) / scale
            best = int(gaps.argmin())
            if gaps[best] <= radius * WITHIN_CLIP:
                counts[best] += 1
                continue
        chosen.append(number)
        counts.append(1)
    return Representatives(points[chosen].astype(np.float32), np.array(counts, np.int64))


def grow(
    searcher: NearestPatterns,
    groups: list[Representatives],
    radius: float,
    rules: ClusterRules,
    seed: int = 0,
) -> npt.NDArray[np.int16]:
    """Step two: add the patterns that the clips of a round need; return them as stored.

    ``searcher`` holds the known patterns and receives the new ones. ``groups``: the clips'
    representatives, in the clips' order, which alone decides the numbering. ``seed``: of
    K-means, which only clustering by average error uses.
    """
    points = np.concatenate([group.points for group in groups]).astype(np.float64)
    weights = np.concatenate([group.counts for group in groups])
    reach = radius * (1.0 - WITHIN_CLIP)
    unknown = searcher.within(points, reach)[0] < 0
    points, weights = points[unknown], weights[unknown]
    average = rules.bound == "average"
    means = _averaged(points, weights, reach, seed) if average else _means(points, weights, reach)
    for pattern in to_centimetres(means):
        searcher.add(pattern)
    if average:
        return means
    # a mean can be farther from a member than its first segment was: those found their own
    return np.concatenate([means, _leaders(searcher, points, reach)])


def _means(points: FloatArray, weights: IntArray, reach: float) -> npt.NDArray[np.int16]:
    """Return the weighted means of the clusters that leaders within ``reach`` gather."""
    leaders = NearestPatterns(points[:0])
    member = np.zeros(len(points), np.int64)
    for number in range(len(points)):
        nearest = int(leaders.within(points[number : number + 1], reach)[0][0])
        member[number] = leaders.add(points[number]) if nearest < 0 else nearest
    sums = np.zeros((len(leaders), *points.shape[1:]))
    np.add.at(sums, member, points * weights[:, None, None])
    totals = np.bincount(member, weights, len(leaders))
    return to_coefficients(sums / totals[:, None, None])


def _leaders(searcher: NearestPatterns, points: FloatArray, reach: float) -> npt.NDArray[np.int16]:
    """Make every point that has no pattern within ``reach`` one; return the new ones."""
    found = []
    for number in np.flatnonzero(searcher.within(points, reach)[0] < 0):
        if searcher.within(points[number : number + 1], reach)[0][0] < 0:
            found.append(to_coefficients(points[number : number + 1]))
            searcher.add(to_centimetres(found[-1])[0])
    return np.concatenate([to_coefficients(points[:0]), *found])


def _averaged(
    points: FloatArray, weights: IntArray, reach: float, seed: int
) -> npt.NDArray[np.int16]:
    """Return the K-means centres with the least K, by doubling, that keep AveError in reach."""
    flat = points.reshape(len(points), points.shape[1] * points.shape[2])
    clusters = 1
    while clusters < len(points):
        means = MiniBatchKMeans(clusters, random_state=seed, n_init=1, batch_size=1024)
        means.fit(flat, sample_weight=weights)
        gaps = np.square(flat - means.cluster_centers_[means.labels_]).sum(axis=1)
        error = np.sqrt(np.average(gaps, weights=weights)) / distance_scale(points.shape[2])
        if error <= reach:
            return to_coefficients(means.cluster_centers_.reshape(-1, *points.shape[1:]))
        clusters *= 2
    return to_coefficients(points)
