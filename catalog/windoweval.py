"""How well search finds spans: a random piece of a clip, and the same phase of other takes.

A hit counts if its clip has the labels of the query's, and its span covers at least half of the
frames that dynamic time warping over joint positions puts onto the query's. Of a movement that
repeats itself, such as walking, only one repetition counts, so figures understate.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..codec.clip import FloatArray, IntArray
from .bodysignals import RATE, resampled
from .catalogfolder import Catalog
from .evaluate import Figures, ranking_figures
from .framewarp import warped_span, warping_path
from .search import Rerank, cut_query, search
from .wordwarp import NOTHING_BESIDE

Motions = Sequence[npt.NDArray[np.float32]]
Found = list[tuple[int, float, float]]  # clips, best first, with the span in seconds


@dataclass(frozen=True)
class Piece:
    """A span of a clip (a number among the labelled ones), seconds."""

    clip: int
    start: float
    stop: float


def random_pieces(
    lengths: Sequence[float], seconds: float, count: int, seed: int = 0
) -> list[Piece]:
    """Return spans of ``seconds`` at random from clips that are long enough, one a clip."""
    rng = np.random.default_rng(seed)
    enough = [clip for clip, length in enumerate(lengths) if length >= seconds]
    chosen = rng.permutation(len(enough))[:count]
    starts = [float(rng.uniform(0.0, lengths[enough[each]] - seconds)) for each in chosen]
    return [
        Piece(enough[each], start, start + seconds)
        for each, start in zip(chosen.tolist(), starts, strict=True)
    ]


def compare_windows(
    catalog: Catalog,
    numbers: IntArray,
    motions: Motions,
    frame_times: Sequence[float],
    groups: Sequence[Any],
    pieces: Sequence[Piece],
    progress: Callable[[int, int], None] | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Return the figures of every method for finding pieces, as JSON values.

    ``groups``: per clip, what must be equal for one to be another take of the other.
    """
    place = {catalog.names[number]: clip for clip, number in enumerate(numbers.tolist())}
    slow = [
        resampled(motion.astype(np.float64), dt)
        for motion, dt in zip(motions, frame_times, strict=True)
    ]
    flat = [motion.reshape(len(motion), -1) for motion in motions]
    rng = np.random.default_rng(seed)

    def from_index(rerank: Rerank, *, beside: bool = True) -> Callable[[Piece], Found]:
        def find(piece: Piece) -> Found:
            own = int(numbers[piece.clip])
            query = replace(cut_query(catalog.words(own), piece.start, piece.stop), own=own)
            if not beside:
                query = replace(query, beside=NOTHING_BESIDE)
            hits = search(catalog, query, top=100, mode="windows", rerank=rerank)
            return [(place[hit.clip], hit.start, hit.stop) for hit in hits if hit.clip in place]

        return find

    def from_moments(piece: Piece) -> Found:
        own = slow[piece.clip][round(piece.start * RATE) : round(piece.stop * RATE) + 1]
        found = [(*_nearest_window(own, other), clip) for clip, other in enumerate(slow)]
        found = [each for each in found if each[2] != piece.clip]
        return [(clip, at / RATE, (at + len(own) - 1) / RATE) for _, at, clip in sorted(found)]

    def from_frames(piece: Piece) -> Found:
        step = frame_times[piece.clip]
        own = flat[piece.clip][round(piece.start / step) : round(piece.stop / step) + 1]
        found = [(*warped_span(own, other), clip) for clip, other in enumerate(flat)]
        return [
            (clip, first * frame_times[clip], (last - 1) * frame_times[clip])
            for _, first, last, clip in sorted(found)
            if clip != piece.clip
        ]

    def by_chance(piece: Piece) -> Found:
        found = []
        for clip in rng.permutation(len(flat)).tolist():
            lasts = len(flat[clip]) * frame_times[clip]
            at = float(rng.uniform(0.0, max(lasts - (piece.stop - piece.start), 0.0)))
            found.append((clip, at, at + piece.stop - piece.start))
        return [each for each in found if each[0] != piece.clip]

    phases = _Phases(flat, frame_times)
    methods = {
        "index only": from_index("none"),
        "index, re-ranked": from_index("dtw"),
        "index only, span alone": from_index("none", beside=False),
        "re-ranked, span alone": from_index("dtw", beside=False),
        "mean and deviation": from_moments,
        "time warping over joints": from_frames,
        "chance": by_chance,
    }
    figures = []
    for number, (method, find) in enumerate(methods.items()):
        figures.append(_measured(method, find, pieces, groups, phases))
        if progress:
            progress(number + 1, len(methods))
    return {
        "task": f"spans of {pieces[0].stop - pieces[0].start:.3g} s, same phase of other takes",
        "clips": len(numbers),
        "same_random_queries": [asdict(each) for each in figures],
    }


class _Phases:
    """Which span of another take is the same phase as a piece; found once each."""

    def __init__(self, flat: Motions, frame_times: Sequence[float]) -> None:
        self._flat, self._times = flat, frame_times
        self._spans: dict[tuple[Piece, int], tuple[float, float]] = {}

    def covers(self, piece: Piece, clip: int, start: float, stop: float) -> bool:
        """Return whether a span covers half of the phase of a clip that is the piece's."""
        if (piece, clip) not in self._spans:
            path = warping_path(self._flat[piece.clip], self._flat[clip])
            own = path[:, 0] * self._times[piece.clip]
            inside = path[(own >= piece.start) & (own <= piece.stop), 1] * self._times[clip]
            self._spans[piece, clip] = float(inside.min()), float(inside.max())
        first, last = self._spans[piece, clip]
        return min(stop, last) - max(start, first) >= 0.5 * (last - first)


def _measured(
    method: str,
    find: Callable[[Piece], Found],
    pieces: Sequence[Piece],
    groups: Sequence[Any],
    phases: _Phases,
) -> Figures:
    values, seconds = [], []
    find(pieces[0])  # loads what is compiled
    for piece in pieces:
        takes = sum(group == groups[piece.clip] for group in groups) - 1
        if not takes:
            continue
        start = time.perf_counter()
        found = find(piece)
        seconds.append(time.perf_counter() - start)
        right = np.array(
            [
                groups[clip] == groups[piece.clip] and phases.covers(piece, clip, first, last)
                for clip, first, last in found
            ],
            bool,
        )
        values.append(_figures(right, takes))
    means = np.mean(values, axis=0)
    times = float(np.mean(seconds)), float(np.median(seconds))
    first, ten, average, gain = (float(mean) for mean in means)
    return Figures(method, len(values), first, ten, average, gain, *times)


def _figures(right: npt.NDArray[np.bool_], takes: int) -> tuple[float, float, float, float]:
    """Return the figures of a ranking, of which ``takes`` could be right; see `evaluate`."""
    if not right.any():
        return 0.0, 0.0, 0.0, 0.0
    first, ten, average, _ = ranking_figures(right)
    gain = (1.0 / np.log2(np.flatnonzero(right) + 2)).sum()
    ideal = (1.0 / np.log2(np.arange(2, takes + 2))).sum()
    return first, ten, average * float(right.sum()) / takes, float(gain / ideal)


def _nearest_window(own: FloatArray, other: FloatArray) -> tuple[float, int]:
    """Return distance and first sample of the window that is most like it in its moments."""
    wide = min(len(own), len(other))
    flat = other.reshape(len(other), -1)
    sums = np.cumsum(np.vstack([np.zeros(flat.shape[1]), flat]), axis=0)
    squares = np.cumsum(np.vstack([np.zeros(flat.shape[1]), flat**2]), axis=0)
    mean = (sums[wide:] - sums[:-wide]) / wide
    deviation = np.sqrt(np.maximum((squares[wide:] - squares[:-wide]) / wide - mean**2, 0.0))
    target = own.reshape(len(own), -1)
    gaps = np.square(mean - target.mean(axis=0)).sum(axis=1)
    gaps += np.square(deviation - target.std(axis=0)).sum(axis=1)
    return float(gaps.min()), int(gaps.argmin())


def groups_of(labels: Sequence[Mapping[str, str]]) -> list[tuple[str, ...]]:
    """Return what must be equal for two clips to be takes of the same: all labels."""
    return [tuple(each.values()) for each in labels]
