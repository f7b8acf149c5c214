"""Nearest patterns within a radius, at a cost that hardly grows with the store.

Points are looked up by a few of their coordinates in an orthonormal basis (their slowest
courses in time). Distances in those never exceed the true distance, so the short list that a
k-d tree gives for a radius misses nothing, and the exact distances decide.
"""

from __future__ import annotations

from math import isqrt

import numpy as np
from scipy.spatial import cKDTree

from ..clip import FloatArray, IntArray
from .patterns import PATTERN_FRAMES, distance_scale

_SLOWEST = 2  # cosine courses per channel that the short list is made from
_PENDING_LEAST = 256


def slow_coordinates(points: FloatArray) -> FloatArray:
    """Return the coordinates (n, 2 × channels) of points (n, 16, channels) in slow cosines."""
    time = (np.arange(PATTERN_FRAMES) + 0.5) * np.pi / PATTERN_FRAMES
    basis = np.stack([np.cos(order * time) for order in range(_SLOWEST)])
    basis /= np.sqrt(np.square(basis).sum(axis=1, keepdims=True))
    return np.asarray(np.einsum("ot,ntc->noc", basis, points).reshape(len(points), -1))


class NearestPatterns:
    """Points in pattern space that can be searched and added to; never renumbered.

    Added points wait in a short list that is searched in full, until it has four times the
    root of the tree's size; then the tree is built anew. Both costs per added point grow with
    the root of the store at the most.
    """

    def __init__(self, points: FloatArray) -> None:
        self._scale = distance_scale(points.shape[2])
        self._points = points
        self._pending: list[FloatArray] = []
        self._build()

    def __len__(self) -> int:
        return len(self._points) + len(self._pending)

    def _build(self) -> None:
        if self._pending:
            self._points = np.concatenate([self._points, np.array(self._pending)])
            self._pending = []
        self._tree = cKDTree(slow_coordinates(self._points)) if len(self._points) else None

    def add(self, point: FloatArray) -> int:
        """Add a point (16, channels); return its number."""
        self._pending.append(point)
        if len(self._pending) >= max(_PENDING_LEAST, 4 * isqrt(len(self._points))):
            self._build()
        return len(self) - 1

    def within(self, points: FloatArray, radius: float) -> tuple[IntArray, FloatArray]:
        """Return (number, distance) of the nearest point within ``radius`` of each of ``points``.

        ``points``: (n, 16, channels); ``radius`` and distances: RMS centimetres. Number -1 and
        distance inf where there is none; of equally near ones the lowest number.
        """
        found = np.full(len(points), -1, np.int64)
        distances = np.full(len(points), np.inf)
        if not len(self) or not len(points):
            return found, distances
        slow = slow_coordinates(points)
        reach = radius * self._scale * (1.0 + 1e-9)
        lists = (
            self._tree.query_ball_point(slow, reach, return_sorted=True)
            if self._tree is not None
            else [[]] * len(points)
        )
        pending = np.array(self._pending) if self._pending else None
        for row, short in enumerate(lists):
            if short:
                self._nearer(
                    points[row], self._points[short], np.array(short), row, found, distances
                )
            if pending is not None:
                numbers = len(self._points) + np.arange(len(pending))
                self._nearer(points[row], pending, numbers, row, found, distances)
        outside = distances > radius
        found[outside], distances[outside] = -1, np.inf
        return found, distances

    def _nearer(
        self,
        point: FloatArray,
        candidates: FloatArray,
        numbers: IntArray,
        row: int,
        found: IntArray,
        distances: FloatArray,
    ) -> None:
        gaps = (candidates - point).reshape(len(candidates), -1)
        square = np.einsum("ij,ij->i", gaps, gaps)
        best = int(square.argmin())
        distance = float(np.sqrt(square[best])) / self._scale
        if distance < distances[row]:
            found[row], distances[row] = numbers[best], distance
