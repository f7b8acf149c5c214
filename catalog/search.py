"""Where else in the library does somebody move like this?

The postings give the passages that share the query's words; the best few hundred clips are
compared with it word by word, by dynamic time warping over the distances between patterns.
Only the catalog is read, never a frame of motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from ..codec.clip import FloatArray, IntArray
from ..codec.errors import UsageError
from .bodysignals import PARTS, RATE
from .catalogfolder import Catalog
from .postings import SCALE, TERMS_A_PART, Postings, shares
from .vocabulary import NO_WORD, OWNERS, WINDOW, Vocabulary, Words
from .wordwarp import (
    NOTHING_BESIDE,
    Surroundings,
    slid_inside,
    surroundings,
    warped,
    warped_inside,
    warped_path,
)

Mode = Literal["whole", "windows"]
Rerank = Literal["dtw", "none"]

CANDIDATES = 300  # clips that are compared word by word
LOOKED_UP = 0.7  # of what the query's words tell; the rest is in the longest lists
WARP_WEIGHT = 0.4  # of the warped distance, in medians of the candidates, beside the postings
AMPLITUDE = 75.0  # centimetres of difference in how far parts move that cost a score of 1
POSTURE_SHARE: Mapping[tuple[Mode, Rerank], float] = {
    ("whole", "dtw"): 0.9,  # a little movement says which way a body moves through a posture
    ("whole", "none"): 0.5,
    ("windows", "dtw"): 0.9,
    ("windows", "none"): 1.0,
}
"""Of a distance; the rest is movement."""
MOST_SAMPLES = 600  # longer clips are compared at every second, third … sample


@dataclass(frozen=True, eq=False)
class Query:
    """What is searched for.

    ``words``: (samples, columns). ``weights``: how much each part counts; parts that are not
    named count nothing. ``own``: number of the clip that it is from, which is left out of the
    hits. ``beside``: words before and after, see `Surroundings`; of a span, not of a clip.
    """

    words: Words
    weights: Mapping[str, float] = field(default_factory=lambda: dict.fromkeys(PARTS, 1.0))
    own: int | None = None
    beside: Surroundings = NOTHING_BESIDE

    def mirrored(self, vocabulary: Vocabulary) -> Query:
        """Return the query for its mirror image, which may be in the same clip."""
        before, after = map(vocabulary.mirrored, self.beside)
        words = vocabulary.mirrored(self.words)
        return replace(self, words=words, own=None, beside=Surroundings(before, after))


@dataclass(frozen=True)
class Hit:
    """A clip where somebody moves like the query, from ``start`` to ``stop`` (seconds).

    ``score``: higher is better; comparable within one search. ``parts``: per part of the
    query, 1 for the same movement, 0 for one as unlike as two at random.
    """

    clip: str
    start: float
    stop: float
    score: float
    parts: dict[str, float]


def cut_query(words: Words, start: float | None, stop: float | None) -> Query:
    """Return the query for what a clip's words say between two times in seconds.

    A movement is what happens in the window about a sample; so those near the ends, which look
    beyond them, are left out where the span is long enough. Raises `UsageError` for an empty
    span.
    """
    if start is None and stop is None:
        return Query(words)
    first = 0 if start is None else round(start * RATE)
    last = len(words) if stop is None else min(round(stop * RATE) + 1, len(words))
    if first < 0 or first >= last:
        lasts = max(len(words) - 1, 0) / RATE
        raise UsageError(
            f"from {start or 0:g} s to {lasts if stop is None else stop:g} s there is nothing: "
            f"the clip lasts {lasts:g} s",
            advice="Choose another --from and --to",
        )
    span = np.array(words[first:last])
    margin = WINDOW // 2
    if len(span) > 3 * margin:
        span[:margin, : len(PARTS)] = span[-margin:, : len(PARTS)] = NO_WORD
    return Query(span, beside=surroundings(words, first, last))


def search(
    catalog: Catalog,
    query: Query,
    *,
    top: int = 10,
    mode: Mode = "whole",
    rerank: Rerank = "dtw",
) -> list[Hit]:
    """Return the ``top`` best hits, best first, one a clip.

    ``whole``: clips that are like the query from end to end; ``windows``: clips with a span
    that is like it; among spans equally alike, those whose surroundings are, too. ``rerank``:
    ``dtw``, or ``none`` for the order of the postings (for windows: of spans compared without
    warping). Raises `UsageError` for a query without words.
    """
    parts = part_weights(query)
    weights = column_weights(parts, POSTURE_SHARE[mode, rerank])
    scores = clip_scores(catalog, query, parts, mode)
    clips, order = best_clips(
        scores, max(CANDIDATES, top) if rerank == "dtw" or mode == "windows" else top
    )
    spans: dict[int, tuple[int, int]] = {}
    if mode == "windows":
        find = warped_inside if rerank == "dtw" else slid_inside
        said = [catalog.words(clip) for clip in clips.tolist()]
        distances, firsts, lasts = find(query.words, said, catalog.table, weights, query.beside)
        order = -distances
        spans = dict(
            zip(clips.tolist(), zip(firsts.tolist(), lasts.tolist(), strict=True), strict=True)
        )
    elif rerank == "dtw" and len(clips):
        order = order - warp_costs(catalog, query, clips, weights)
    found = np.argsort(-order, kind="stable")[:top]
    found = found[np.isfinite(order[found])]
    return _hits(catalog, query, weights, clips[found], order[found], spans)


def warp_costs(catalog: Catalog, query: Query, clips: IntArray, weights: FloatArray) -> FloatArray:
    """Return (clips,) what time warping takes from the scores of clips, from end to end."""
    said = [catalog.words(clip) for clip in clips.tolist()]
    gaps = np.empty(len(said))
    for which, some, others in _thinned_alike(query.words, said):
        gaps[which] = warped(some, others, catalog.table, weights)
    return np.asarray(WARP_WEIGHT * gaps / max(float(np.median(gaps)), 1e-9))


def part_weights(query: Query) -> FloatArray:
    """Return how much each of `PARTS` counts (parts,), summing to 1. Raises `UsageError`."""
    unknown = sorted(set(query.weights) - set(PARTS))
    if unknown:
        raise UsageError(f"there is no part {unknown[0]!r}", advice=f"Parts: {', '.join(PARTS)}")
    has = (query.words[:, : len(PARTS)] != NO_WORD).any(axis=0)
    weights = np.array([float(query.weights.get(part, 0.0)) for part in PARTS]) * has
    if not (np.isfinite(weights).all() and (weights >= 0.0).all() and weights.sum() > 0.0):
        raise UsageError(
            "the query has no motion of the parts that count",
            advice=f"Parts that are searched: {', '.join(PARTS)}",
        )
    return np.asarray(weights / weights.sum())


def column_weights(weights: FloatArray, share: float) -> FloatArray:
    """Return how much movements and postures count (columns,), from the weights of parts.

    ``share``: how much of a part's weight its postures have.
    """
    movements = OWNERS[: len(PARTS)]
    postures = OWNERS[len(PARTS) :]
    shared = (weights / np.bincount(postures))[postures]  # by all postures of a part
    return np.concatenate([(1.0 - share) * weights[movements], share * shared])


def clip_scores(catalog: Catalog, query: Query, weights: FloatArray, mode: Mode) -> FloatArray:
    """Return every clip's score (clips,) from the postings alone; -inf for the query's own.

    The cosine of the weighted words: of a whole clip the mean over its passages, of windows the
    best passage, and there not divided by all else that happens in it. Movements are almost free
    of amplitude, in which styles differ; so of whole clips, differences in it are taken off.
    """
    out = np.empty(len(catalog))
    length = np.array([len(query.words)])
    share = shares(query.words, np.zeros(1, np.int64), length, catalog.softness)[0]
    terms = np.flatnonzero(share)
    part = terms // TERMS_A_PART
    worth = share[terms] * catalog.rareness[terms] * weights[part] ** 2
    own = np.sqrt(worth.sum())
    kept = worthwhile(worth, catalog.frequencies[terms])
    terms, part = terms[kept], part[kept]
    factors = np.sqrt(share[terms]) * catalog.rareness[terms] * weights[part] ** 2 / SCALE
    amplitudes = catalog.vocabulary.amplitudes(query.words, np.array([0, len(query.words)]))
    for number, batch in enumerate(catalog.batches):
        scores = np.zeros(len(batch.spans), np.float32)
        _add_scores(catalog, batch.postings, terms, factors.astype(np.float32), scores)
        scores /= own
        if mode == "whole":
            scores /= batch.norms(weights)
        firsts = batch.first_passages
        if mode == "windows":
            clips = np.maximum.reduceat(scores, firsts)
        elif len(scores) == len(firsts):
            clips = scores
        else:
            clips = np.add.reduceat(scores, firsts) / batch.passage_counts
        if mode == "whole":
            counted = len(PARTS) * weights[OWNERS[len(PARTS) :]]
            clips = clips - batch.amplitude_gaps(amplitudes[0], counted) / AMPLITUDE
        out[catalog.offset(number) : catalog.offset(number + 1)] = clips
    out[~catalog.current] = -np.inf
    if query.own is not None:
        out[query.own] = -np.inf
    return out


def worthwhile(worth: FloatArray, frequencies: IntArray) -> IntArray:
    """Return which terms are looked up: those that tell the most for the length of their lists.

    Together they are worth `LOOKED_UP` of the query with itself.
    """
    order = np.argsort(-worth / np.maximum(frequencies, 1), kind="stable")
    told = np.cumsum(worth[order])
    return np.sort(order[: int(np.searchsorted(told, LOOKED_UP * told[-1])) + 1])


def best_clips(scores: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
    """Return the numbers and scores of the best clips, best first; equal ones by number."""
    count = min(count, int(np.isfinite(scores).sum()))
    if count == 0:
        return np.zeros(0, np.int64), np.zeros(0)
    least = np.partition(scores, len(scores) - count)[len(scores) - count]
    some = np.flatnonzero(scores >= least)
    some = some[np.argsort(-scores[some], kind="stable")][:count]
    return some, scores[some]


def thinned(query: Words, clip: Words) -> tuple[Words, Words]:
    """Return two motions at every nth sample, so that neither is longer than can be warped."""
    step = -(-max(len(query), len(clip)) // MOST_SAMPLES)
    return np.ascontiguousarray(query[::step]), np.ascontiguousarray(clip[::step])


def _thinned_alike(
    query: Words, clips: Sequence[Words]
) -> Iterator[tuple[list[int], Words, list[Words]]]:
    """Yield the numbers of clips that are `thinned` alike, and the query and them, thinned."""
    pairs = [thinned(query, clip) for clip in clips]
    for samples in sorted({len(some) for some, _ in pairs}):
        which = [place for place, (some, _) in enumerate(pairs) if len(some) == samples]
        yield which, pairs[which[0]][0], [pairs[place][1] for place in which]


def _add_scores(
    catalog: Catalog,
    postings: Postings,
    terms: IntArray,
    factors: npt.NDArray[np.float32],
    out: npt.NDArray[np.float32],
) -> None:
    if not catalog.many:
        postings.add_scores(terms, factors, out)
        return
    from .kernels import add_scores  # takes longer to import than a search

    add_scores(postings.starts, postings.passages, postings.weights, terms, factors, out)


def _hits(
    catalog: Catalog,
    query: Query,
    weights: FloatArray,
    clips: IntArray,
    scores: FloatArray,
    spans: dict[int, tuple[int, int]],
) -> list[Hit]:
    counted = np.bincount(OWNERS, weights)
    said = [catalog.words(clip)[slice(*spans.get(clip, (None, None)))] for clip in clips.tolist()]
    gaps = np.empty((len(said), len(weights)))
    for which, some, others in _thinned_alike(query.words, said):
        gaps[which] = warped_path(some, others, catalog.table, weights)
    out = []
    for place, (clip, score) in enumerate(zip(clips.tolist(), scores.tolist(), strict=True)):
        seconds = catalog.seconds(clip)
        apart = np.bincount(OWNERS, gaps[place] * weights) / np.maximum(counted, 1e-9)
        parts = {
            part: round(float(np.clip(1.0 - apart[number], 0.0, 1.0)), 3)
            for number, part in enumerate(PARTS)
            if counted[number] > 0
        }
        start, stop = 0.0, seconds
        if clip in spans:
            first, last = spans[clip]
            start, stop = first / RATE, min(seconds, (last - 1) / RATE)
        name = catalog.names[clip]
        out.append(Hit(name, round(start, 3), round(stop, 3), round(score, 4), parts))
    return out
