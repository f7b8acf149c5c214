"""Which passages hold which words: the inverted index of a batch of clips.

Clips are cut into passages of eight seconds, which overlap, so that no border hides a match.
A passage counts the words of each part softly: a window counts for the words next to its own,
too. What is kept are roots of shares, so that the product of two passages is the Bhattacharyya
coefficient of their words, and one frequent word does not drown the others. A word that few
passages hold weighs more (inverse document frequency; Salton and Buckley 1988).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..codec.clip import FloatArray, IntArray
from .bodysignals import PARTS
from .vocabulary import NO_WORD, Vocabulary, Words, kind_of

PASSAGE = 80  # samples
PASSAGE_STEP = 60
TERMS_A_PART = 256
TERMS = TERMS_A_PART * len(PARTS)
"""A term is a word of a part: the part's number times 256, and the word's."""
_FIRST_TERMS = np.arange(len(PARTS)) * TERMS_A_PART
LEAST_SHARE = 0.01  # of a part's words: what counts less is left out
SCALE = 255  # of stored weights
_CHUNK = 2048  # passages counted at a time


@dataclass(frozen=True, eq=False)
class Postings:
    """The passages of a batch by term, and the terms' weights in them.

    ``starts``: (terms + 1,) where each term's postings begin; ``passages``: the passages'
    numbers, ascending within a term; ``weights``: 255 times the root of the term's share of its
    part's words. ``norms``: (passages, parts) summed squares of weights times the terms'
    rareness.
    """

    starts: IntArray
    passages: npt.NDArray[np.unsignedinteger[Any]]
    weights: npt.NDArray[np.uint8]
    norms: npt.NDArray[np.float32]

    @property
    def frequencies(self) -> IntArray:
        """(terms,) how many passages hold each term."""
        return np.diff(self.starts)

    def add_scores(
        self, terms: IntArray, factors: npt.NDArray[np.float32], out: npt.NDArray[np.float32]
    ) -> None:
        """Add to each passage's score (passages,) its weight of each term, times the factor."""
        all_passages, all_weights = self.passages, self.weights
        for term, factor in zip(terms.tolist(), factors, strict=True):
            span = slice(self.starts[term], self.starts[term + 1])
            passages, weights = all_passages[span], all_weights[span]
            if passages.max(initial=0) >= len(out):  # a damaged file must not write elsewhere
                weights = weights[passages < len(out)]
                passages = passages[passages < len(out)]
            out[passages] += factor * weights  # a passage is there once a term


def passages_of(starts: IntArray) -> npt.NDArray[np.int32]:
    """Return (passages, 3) clip, first and last sample (exclusive) of all passages.

    ``starts``: (clips + 1,) where the samples of each clip begin. Samples are counted from the
    clip's first; the last passage of a clip ends with it. Every clip has one at least.
    """
    spans = []
    for clip, length in enumerate(np.diff(starts).tolist()):
        first = 0
        while first + PASSAGE < length:
            spans.append((clip, first, first + PASSAGE))
            first += PASSAGE_STEP
        spans.append((clip, max(0, length - PASSAGE), length))
    return np.array(spans, np.int32).reshape(-1, 3)


def rareness(frequencies: IntArray, passages: int) -> FloatArray:
    """Return (terms,) the inverse document frequency of terms."""
    return np.asarray(np.log((1.0 + passages) / (1.0 + frequencies)))


def shares(
    words: Words, firsts: IntArray, lasts: IntArray, softness: list[FloatArray]
) -> npt.NDArray[np.float32]:
    """Return (passages, terms) each term's share of its part's words, small ones left out.

    ``words``: (samples, columns), of which the movements count; ``firsts``, ``lasts``:
    (passages,) first and last sample (exclusive); ``softness``: per part, as by
    `Vocabulary.softness`.
    """
    counts = lasts - firsts
    owner = np.repeat(np.arange(len(counts)), counts)
    sample = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    sample += np.repeat(firsts, counts)
    place = owner[:, None] * TERMS + _FIRST_TERMS + words[sample, : len(PARTS)]
    hard = np.bincount(place.ravel(), minlength=len(counts) * TERMS)
    hard = hard.reshape(len(counts), len(PARTS), TERMS_A_PART)
    hard[:, :, NO_WORD] = 0
    totals = np.maximum(hard.sum(axis=2, keepdims=True), 1)
    out = np.zeros(hard.shape, np.float32)
    for part, soft in enumerate(softness):
        some = (hard[:, part, : len(soft)] / totals[:, part]) @ soft
        some[some < LEAST_SHARE] = 0.0
        out[:, part, : len(soft)] = some
    return out.reshape(len(counts), TERMS)


def softness_of(vocabulary: Vocabulary, sizes: dict[str, int]) -> list[FloatArray]:
    """Return, per part, how much words count for each other, of the first ``sizes`` words."""
    nothing = np.zeros((0, 0))
    return [
        vocabulary.softness(kind_of(part), sizes[kind_of(part)])
        if kind_of(part) in sizes
        else nothing
        for part in PARTS
    ]


def make_postings(
    words: Words,
    starts: IntArray,
    spans: npt.NDArray[np.int32],
    softness: list[FloatArray],
    before: tuple[IntArray, int],
) -> Postings:
    """Return the postings of the passages ``spans`` of clips.

    ``words``: (samples, columns) of all clips, which begin at ``starts``. ``before``: in how many
    passages of earlier batches each term is, and how many those are.
    """
    terms, passages, weights = [], [], []
    for low in range(0, len(spans), _CHUNK):
        some = spans[low : low + _CHUNK].astype(np.int64)
        begin = starts[some[:, 0]]
        share = shares(words, begin + some[:, 1], begin + some[:, 2], softness)
        weight = np.rint(SCALE * np.sqrt(share)).astype(np.uint8)
        passage, term = np.nonzero(weight)
        terms.append(term.astype(np.int16))
        passages.append((passage + low).astype(np.uint32))
        weights.append(weight[passage, term])
    term = np.concatenate(terms) if terms else np.zeros(0, np.int16)
    passage = np.concatenate(passages) if passages else np.zeros(0, np.uint32)
    weight = np.concatenate(weights) if weights else np.zeros(0, np.uint8)
    order = np.argsort(term, kind="stable")
    frequencies = np.bincount(term, minlength=TERMS)
    rare = rareness(frequencies + before[0], len(spans) + before[1])
    squares = np.square(weight / SCALE) * rare[term]
    place = passage * np.int64(len(PARTS)) + term // TERMS_A_PART
    norms = np.bincount(place, squares, minlength=len(spans) * len(PARTS))
    return Postings(
        np.concatenate([[0], np.cumsum(frequencies)]),
        passage[order].astype(np.min_scalar_type(len(spans))),
        weight[order],
        norms.reshape(-1, len(PARTS)).astype(np.float32),
    )
