"""How well search finds what a person would call the same: retrieval against labels, measured.

Leave-one-out: every clip is a query, or a span of it is, and the others are ranked. Beside the
catalog stand what it should beat, on decoded motion: a simple baseline (nearest neighbour on
mean and deviation of joint positions), dynamic time warping over joint positions, and chance.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ..codec.clip import BoolArray, FloatArray, IntArray
from ..codec.errors import UsageError
from .catalogfolder import Catalog
from .framewarp import warped_frames
from .search import (
    POSTURE_SHARE,
    Query,
    best_clips,
    clip_scores,
    column_weights,
    part_weights,
    warp_costs,
)

RERANKED = 600
"""Candidates that are re-ranked here: more than in `search`, because labels leave some out."""

Ranks = Callable[[int], FloatArray]
"""From the number of a query to the scores (clips,) of all clips, higher ones better."""


@dataclass(frozen=True)
class Figures:
    """Means over the queries: precision at 1 and 10, average precision, nDCG, and seconds each."""

    method: str
    queries: int
    precision_1: float
    precision_10: float
    mean_average_precision: float
    ndcg: float
    seconds: float
    median_seconds: float


@dataclass(frozen=True, eq=False)
class Task:
    """What counts as found: per query, which clips compete, and which of them are relevant."""

    name: str
    competes: Callable[[int], BoolArray]
    relevant: Callable[[int], BoolArray]


def read_labels(names: Sequence[str], pattern: str) -> dict[str, dict[str, str]]:
    """Return the labels of the clips whose names match, from the pattern's named groups.

    Raises `UsageError` for a pattern that is none, has no named group, or matches no clip.
    """
    try:
        expression = re.compile(pattern)
    except re.error as problem:
        raise UsageError(f"{pattern!r} is no pattern ({problem})") from problem
    if not expression.groupindex:
        raise UsageError(f"{pattern!r} has no named group", advice="Write (?P<content>[^_]+)")
    found = {name: match.groupdict("") for name in names if (match := expression.search(name))}
    if len(found) < 2:
        raise UsageError(f"{pattern!r} fits {len(found)} clips of {len(names)}")
    return found


def label_task(
    labels: Sequence[Mapping[str, str]],
    relevant: Sequence[str],
    exclude_same: Sequence[str] = (),
    within: Sequence[str] = (),
) -> Task:
    """Return the task of finding clips with equal labels.

    ``relevant``: labels that must agree for a clip to be found; ``exclude_same``: clips that
    agree in one of these do not compete; ``within``: only those that agree in all of these do.
    Raises `UsageError` for a label that there is not.
    """
    columns = {}
    for name in (*relevant, *exclude_same, *within):
        if any(name not in each for each in labels):
            known = ", ".join(labels[0]) if labels else "none"
            raise UsageError(f"there is no label {name!r}", advice=f"Labels: {known}")
        columns[name] = np.array([each[name] for each in labels])

    def equal(name: str, query: int) -> BoolArray:
        return np.asarray(columns[name] == columns[name][query])

    def competes(query: int) -> BoolArray:
        allowed = np.ones(len(labels), bool)
        allowed[query] = False
        for name in exclude_same:
            allowed &= ~equal(name, query)
        for name in within:
            allowed &= equal(name, query)
        return allowed

    def found(query: int) -> BoolArray:
        return np.asarray(np.all([equal(name, query) for name in relevant], axis=0))

    text = " and ".join(relevant)
    text += f", own {' and '.join(exclude_same)} excluded" if exclude_same else ""
    text += f", within one {' and '.join(within)}" if within else ""
    return Task(text, competes, found)


def measure(method: str, rank: Ranks, task: Task, queries: Iterable[int]) -> Figures:
    """Return the figures of a method; queries without anything relevant are left out."""
    values, seconds = [], []
    for query in queries:
        allowed = task.competes(query)
        right = task.relevant(query) & allowed
        if not right.any():
            continue
        start = time.perf_counter()
        scores = rank(query)
        seconds.append(time.perf_counter() - start)
        order = np.argsort(-scores, kind="stable")
        values.append(ranking_figures(right[order[allowed[order]]]))
    means = np.mean(values, axis=0) if values else np.zeros(4)
    first, ten, average, gain = (float(mean) for mean in means)
    return Figures(
        method,
        len(values),
        first,
        ten,
        average,
        gain,
        float(np.mean(seconds)) if seconds else 0.0,
        float(np.median(seconds)) if seconds else 0.0,
    )


def ranking_figures(right: BoolArray) -> tuple[float, float, float, float]:
    """Return precision at 1 and 10, average precision and nDCG of a ranking (clips,).

    At least one must be right (Manning, Raghavan and Schütze 2008, Section 8.4).
    """
    ranks = np.flatnonzero(right) + 1
    average = float((np.arange(1, len(ranks) + 1) / ranks).mean())
    gain = (1.0 / np.log2(ranks + 1)).sum() / (1.0 / np.log2(np.arange(2, len(ranks) + 2))).sum()
    return float(right[0]), float(right[:10].mean()), average, float(gain)


def chance_figures(task: Task, queries: Sequence[int], seed: int = 0) -> Figures:
    """Return the figures of random rankings."""
    rng = np.random.default_rng(seed)
    count = len(task.competes(0))
    return measure("chance", lambda _: rng.random(count), task, queries)


def index_ranks(catalog: Catalog, numbers: IntArray, rerank: bool) -> Ranks:
    """Return how the catalog ranks its clips ``numbers``: by postings alone, or re-ranked.

    Re-ranked, the clips beyond the candidates follow in the order of the postings.
    """

    def rank(query: int) -> FloatArray:
        asked = Query(catalog.words(int(numbers[query])), own=int(numbers[query]))
        parts = part_weights(asked)
        weights = column_weights(parts, POSTURE_SHARE["whole", "dtw"])
        scores = clip_scores(catalog, asked, parts, "whole")[numbers]
        if not rerank:
            return scores
        clips, order = best_clips(scores, RERANKED)
        out = scores - 10.0
        out[clips] = order - warp_costs(catalog, asked, numbers[clips], weights)
        return out

    return rank


def moments(motion: npt.NDArray[np.float32]) -> FloatArray:
    """Return means and deviations of joint positions (frames, joints, 3), the latter doubled.

    Doubled, they tell contents better than plain or standardised ones: the baseline is meant to
    be hard to beat.
    """
    return np.concatenate([motion.mean(axis=0).ravel(), 2.0 * motion.std(axis=0).ravel()])


def baseline_ranks(described: Sequence[FloatArray]) -> Ranks:
    """Return how near clips are in their `moments`."""
    points = np.stack(described)

    def rank(query: int) -> FloatArray:
        return -np.asarray(np.square(points - points[query]).sum(axis=1))

    return rank


def frame_ranks(motions: Sequence[npt.NDArray[np.float32]]) -> Ranks:
    """Return how near clips are by dynamic time warping over joint positions at full rate."""
    flat = [np.ascontiguousarray(motion.reshape(len(motion), -1)) for motion in motions]

    def rank(query: int) -> FloatArray:
        return -np.array([warped_frames(flat[query], other) for other in flat])

    return rank


@dataclass(frozen=True, eq=False)
class Remembered:
    """Scores of some queries, computed once for several tasks, and the seconds each took."""

    scores: Mapping[int, FloatArray]
    seconds: Mapping[int, float]

    def measured(self, method: str, task: Task, queries: Iterable[int]) -> Figures:
        """Return the figures of the method for a task."""
        found = measure(method, self.scores.__getitem__, task, queries)
        times = list(self.seconds.values())
        return replace(found, seconds=float(np.mean(times)), median_seconds=float(np.median(times)))


def remember(
    rank: Ranks, queries: Sequence[int], progress: Callable[[int, int], None] | None = None
) -> Remembered:
    """Return the scores of a method for some queries, and how long each took."""
    scores, seconds = {}, {}
    rank(queries[0])  # loads what is compiled
    for number, query in enumerate(queries, 1):
        start = time.perf_counter()
        scores[query] = rank(query)
        seconds[query] = time.perf_counter() - start
        if progress:
            progress(number, len(queries))
    return Remembered(scores, seconds)


def compare(
    methods: Mapping[str, Remembered], task: Task, clips: int, seed: int = 0
) -> dict[str, Any]:
    """Return the figures of every method for a task, as JSON values.

    ``clips``: how many there are. Methods that know all of them as queries are measured on all,
    and every method on those that all methods know.
    """
    some = sorted(set.intersection(*(set(each.scores) for each in methods.values())))
    record: dict[str, Any] = {"task": task.name, "clips": clips}
    for key, queries in (("all_queries", list(range(clips))), ("same_random_queries", some)):
        figures = [
            each.measured(method, task, queries)
            for method, each in methods.items()
            if len(each.scores) >= len(queries)
        ]
        record[key] = [asdict(each) for each in (*figures, chance_figures(task, queries, seed))]
    return record
