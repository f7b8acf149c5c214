"""The words of motion: per kind of body part, patterns that a second of its movement is like.

There are two sorts. A *movement* describes how a part moves more than how far: windows are
scaled to almost the same size, so that a tired and a lively wave are one word. A *posture* is
where a part is at a moment, in centimetres: how an elderly and a youthful walk differ. A limb has
two postures, one of its upper and one of its lower half: two ends of a bone lie on spheres, which
few words cover closely. The arms share their words, and so do the legs, seen in a mirror; the
spine, the head and the root learn theirs from mirrored motion too. So every word has a mirror
image.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from ..codec.clip import FloatArray, IntArray
from .bodysignals import PARTS, Signals, mirror_signs

Words = npt.NDArray[np.uint8]

_POSTURE, _LOWER = "_posture", "_lower_posture"
_LIMBS = ("arm", "leg")
_KINDS = ("root", "spine", "head", *_LIMBS)
POSTURE_COLUMNS = (
    *(part + _POSTURE for part in PARTS),
    *(part + _LOWER for part in PARTS if part.endswith(_LIMBS)),
)
COLUMNS = (*PARTS, *POSTURE_COLUMNS)
"""What a moment has words for: the movement of each part, then its posture or its two."""
KINDS = (*_KINDS, *(kind + _POSTURE for kind in _KINDS), *(kind + _LOWER for kind in _LIMBS))
NO_WORD = 255
"""In the place of a word where the body lacks the part."""
WORDS = 64  # of a kind of movement, learned at first
POSTURES = 128  # of a kind of posture
POSTURE_SCALE = 50.0  # centimetres between postures that count like two movements at random
MOST_WORDS = 192  # of a kind, ever
WINDOW = 9  # samples: 0.9 seconds
STRENGTH = 0.25  # exponent of a window's size: 1 would keep it, 0 would drop it
USUAL_SIZE = 5.0  # centimetres
STILL = 0.5  # centimetres: less movement than this counts as rest
POSTURE = 0.1  # weight of where a part is, beside how it moves
NEIGHBOURS = 8  # words that a window counts for, with its own
SOFTNESS = 2.0  # of the weight's fall with squared distance, in usual distances
_SAMPLE = 30_000  # windows of a kind that words are learned from
_STRANGERS = 200  # windows unlike every word that new words are learned from, at least
_GROWTH = 16  # words that are added at a time


def kind_of(part: str) -> str:
    """Return the kind of one of `COLUMNS`: ``arm`` for ``left_arm``."""
    return part.removeprefix("left_").removeprefix("right_")


def part_of(column: str) -> str:
    """Return the part that one of `COLUMNS` is about: ``left_arm`` for ``left_arm_posture``."""
    return column.removesuffix(_LOWER).removesuffix(_POSTURE)


OWNERS = np.array([PARTS.index(part_of(column)) for column in COLUMNS])
"""(columns,) the number of the part that each column is about."""


def features_of(column: str, signal: FloatArray) -> FloatArray:
    """Return (samples, features) what words are made of, one of `COLUMNS`.

    ``signal``: (samples, channels) of the part, as by `bodysignals`; right sides are mirrored.
    Of a movement: what the part does in the window about each sample; beyond its ends a clip
    stands still. Of a posture: the signal; of a limb's two, its middle from its first joint, and
    its end from its middle.
    """
    part = part_of(column)
    if part.startswith("right_"):
        signal = signal * mirror_signs(part, signal.shape[1])
    if column.endswith(_LOWER):
        return signal[:, 3:] - signal[:, :3]
    if column != part:
        return signal[:, :3] if part.endswith(_LIMBS) else signal
    near = np.arange(WINDOW) - WINDOW // 2
    spans = signal[np.clip(np.arange(len(signal))[:, None] + near, 0, len(signal) - 1)]
    mean = spans.mean(axis=1, keepdims=True)
    if part == "root":  # its signal is a movement already, but for its height
        mean[..., :-1] = 0.0
    moves = (spans - mean).reshape(len(signal), -1) / np.sqrt(WINDOW)
    size = np.sqrt(np.square(moves).sum(axis=1, keepdims=True) + STILL**2)
    moves *= (size / USUAL_SIZE) ** STRENGTH * USUAL_SIZE / size
    return np.concatenate([POSTURE * mean[:, 0], moves], axis=1)


@dataclass(frozen=True, eq=False)
class Vocabulary:
    """The words of every kind of part.

    ``centres``: kind to (words, features). ``usual``: kind to the median squared distance of a
    window to its word; ``far``: to the one that hardly any window exceeded.
    """

    centres: Mapping[str, FloatArray]
    usual: Mapping[str, float]
    far: Mapping[str, float]

    @property
    def sizes(self) -> dict[str, int]:
        """The number of words of each kind."""
        return {kind: len(centres) for kind, centres in self.centres.items()}

    @cached_property
    def tables(self) -> dict[str, FloatArray]:
        """Per kind, the distances (words, words): of movements 1 for two at random."""
        found = {}
        for kind, centres in self.centres.items():
            square = _squares(centres, centres)
            mean = float(np.sqrt(square).mean()) or 1.0
            found[kind] = np.sqrt(square) / (POSTURE_SCALE if kind.endswith(_POSTURE) else mean)
        return found

    @cached_property
    def mirrors(self) -> dict[str, Words]:
        """Per kind, the mirror image of each word; sides are swapped, so limbs keep theirs."""
        found = {}
        for kind, centres in self.centres.items():
            image = np.arange(len(centres))
            if _central(kind):
                image = _squares(centres * _feature_signs(kind, centres), centres).argmin(axis=1)
            found[kind] = image.astype(np.uint8)
        return found

    def softness(self, kind: str, words: int) -> FloatArray:
        """Return (words, words) how much a window of a word counts for each; rows sum to 1.

        Only the first ``words`` words take part: what was there when a batch was indexed.
        """
        centres = self.centres[kind][:words]
        weights = np.exp(-_squares(centres, centres) / (SOFTNESS * self.usual[kind]))
        if words > NEIGHBOURS:
            least = np.sort(weights, axis=1)[:, -NEIGHBOURS, None]
            weights[weights < least] = 0.0
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))

    def words_of(self, signals: Signals) -> Words:
        """Return (samples, columns) the word of each of `COLUMNS` at each sample, or `NO_WORD`."""
        samples = max((len(signal) for signal in signals.values()), default=0)
        out = np.full((samples, len(COLUMNS)), NO_WORD, np.uint8)
        for number, column in enumerate(COLUMNS):
            signal = signals.get(part_of(column))
            centres = self.centres.get(kind_of(column))
            if signal is not None and centres is not None:
                gaps = _squares(features_of(column, signal), centres)
                out[:, number] = gaps.argmin(axis=1)
        return out

    def amplitudes(self, words: Words, starts: IntArray) -> npt.NDArray[np.float32]:
        """Return how far each part moves in each clip, centimetres, one of `POSTURE_COLUMNS` each.

        The root of the summed variances of the postures that ``words`` (samples, columns) name;
        clips begin at ``starts`` (clips + 1,). 0 where a clip lacks the part.
        """
        out = np.zeros((len(starts) - 1, len(POSTURE_COLUMNS)), np.float32)
        postures = np.arange(len(POSTURE_COLUMNS))
        for clip, (first, last) in enumerate(pairwise(starts.tolist())):
            said = words[first:last, len(PARTS) :]
            known = said != NO_WORD
            counts = np.maximum(known.sum(axis=0), 1)
            points = self._places[postures, said]
            points -= points.sum(axis=0) / counts[:, None]
            squares = np.einsum("spa,spa,sp->p", points, points, known)
            out[clip] = np.sqrt(squares / counts)
        return out

    @cached_property
    def _places(self) -> FloatArray:
        """(postures, 256, axes) the centre of every word of `POSTURE_COLUMNS`; 0 for no word."""
        found = [self.centres.get(kind_of(column), np.zeros((0, 0))) for column in POSTURE_COLUMNS]
        out = np.zeros((len(found), NO_WORD + 1, max(each.shape[1] for each in found)))
        for number, centres in enumerate(found):
            out[number, : len(centres), : centres.shape[1]] = centres
        return out

    def mirrored(self, words: Words) -> Words:
        """Return the words (samples, columns) of the mirror image of a motion."""
        swapped = {"left": "right", "right": "left"}
        out = np.full_like(words, NO_WORD)
        for number, column in enumerate(COLUMNS):
            side, _, limb = column.partition("_")
            other = f"{swapped[side]}_{limb}" if side in swapped else column
            source = words[:, COLUMNS.index(other)]
            known = source != NO_WORD
            if known.any():
                out[known, number] = self.mirrors[kind_of(column)][source[known]]
        return out

    def grown(self, bodies: Sequence[Signals], seed: int = 0) -> Vocabulary:
        """Return the vocabulary with words for motion that is far from all of its words.

        Words are only appended, a few at a time, so numbers keep their meaning.
        """
        from sklearn.cluster import KMeans

        centres, usual, far = dict(self.centres), dict(self.usual), dict(self.far)
        for kind, features in _by_kind(bodies).items():
            if kind not in centres:
                centres[kind], usual[kind], far[kind] = _learned(features, kind, seed)
                continue
            strange = features[_squares(features, centres[kind]).min(axis=1) > far[kind]]
            room = min(_GROWTH, MOST_WORDS - len(centres[kind]), len(strange) // 20)
            if len(strange) >= _STRANGERS and room > 0:
                new = KMeans(room, n_init=1, random_state=seed).fit(strange).cluster_centers_
                if _central(kind):
                    new = np.concatenate([new, new * _feature_signs(kind, new)])
                centres[kind] = np.concatenate([centres[kind], new.astype(np.float32)])
        return Vocabulary(centres, usual, far)

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return named arrays that `from_arrays` makes the vocabulary from."""
        out: dict[str, npt.NDArray[Any]] = {}
        for kind, centres in self.centres.items():
            out[f"{kind}_centres"] = centres.astype(np.float32)
            out[f"{kind}_reach"] = np.array([self.usual[kind], self.far[kind]])
        return out

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> Vocabulary:
        """Return the vocabulary that `to_arrays` took apart. Raises KeyError or ValueError."""
        kinds = [kind for kind in KINDS if f"{kind}_centres" in arrays]
        reach = {kind: [float(value) for value in arrays[f"{kind}_reach"]] for kind in kinds}
        return cls(
            {kind: np.asarray(arrays[f"{kind}_centres"], np.float64) for kind in kinds},
            {kind: reach[kind][0] for kind in kinds},
            {kind: reach[kind][1] for kind in kinds},
        )


def learn_vocabulary(bodies: Sequence[Signals], seed: int = 0) -> Vocabulary:
    """Return the words of some clips' signals. The same clips and seed give the same words."""
    return Vocabulary({}, {}, {}).grown(bodies, seed)


def _by_kind(bodies: Sequence[Signals]) -> dict[str, FloatArray]:
    found: dict[str, list[FloatArray]] = {}
    for signals in bodies:
        for column in COLUMNS:
            signal = signals.get(part_of(column))
            if signal is not None:
                found.setdefault(kind_of(column), []).append(features_of(column, signal))
    return {kind: np.concatenate(found[kind]) for kind in KINDS if kind in found}


def _learned(features: FloatArray, kind: str, seed: int) -> tuple[FloatArray, float, float]:
    """Return words learned from features (windows, features), their usual and far distance."""
    from sklearn.cluster import MiniBatchKMeans

    rng = np.random.default_rng(seed)
    if len(features) > _SAMPLE:
        features = features[np.sort(rng.choice(len(features), _SAMPLE, replace=False))]
    if _central(kind):
        features = np.concatenate([features, features * _feature_signs(kind, features)])
    wanted = POSTURES if kind.endswith(_POSTURE) else WORDS
    distinct = len(np.unique(features, axis=0)) if len(features) < 2 * wanted else len(features)
    count = min(wanted, distinct)
    model = MiniBatchKMeans(count, n_init=1, random_state=seed, batch_size=4096, max_iter=30)
    centres = model.fit(features).cluster_centers_.astype(np.float32).astype(np.float64)
    gaps = _squares(features, centres).min(axis=1)
    usual = max(float(np.median(gaps)), 1e-6)
    return centres, usual, max(2.0 * float(np.quantile(gaps, 0.999)), 4.0 * usual)


def _feature_signs(kind: str, features: FloatArray) -> FloatArray:
    times = 1 if kind.endswith(_POSTURE) else WINDOW + 1
    return np.tile(mirror_signs(part_of(kind), features.shape[1] // times), times)


def _central(kind: str) -> bool:
    """Return whether a kind has no sides, and so must hold the mirror images of its words."""
    return part_of(kind) not in _LIMBS


def _squares(some: FloatArray, others: FloatArray) -> FloatArray:
    """Return the squared distances (some, others) of points."""
    cross = some @ others.T
    gaps = np.square(some).sum(axis=1)[:, None] + np.square(others).sum(axis=1) - 2.0 * cross
    return np.asarray(np.maximum(gaps, 0.0))
