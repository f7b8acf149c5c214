"""From a clip to an index file that is inside its tolerance, proved by decoding it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..clip import BoolArray, Clip, FloatArray, IntArray, MarkerClip
from ..errors import GuaranteeError
from ..figure.rig import Rig
from ..figure.sliding import check_size
from ..geometry.limits import TEXT_MARGIN
from ..geometry.metrics import (
    Errors,
    measure,
)
from ..patterns.nearest import NearestPatterns
from ..patterns.patterns import Codebook
from ..patterns.segments import SegmentRules, Segments, clip_segments, most_frames
from ..streams.quantiser import CODES, code_below, step_of
from .decode import decode, pattern_course
from .index_file import IndexFile, float32_above, pack, unpack
from .layers import (
    ORDERS,
    PartIndex,
    Preview,
    part_starts,
    predicted,
    write_preview,
    write_rest,
)
from .subject import Subject

FIRST_GUESS = 0.55  # step over tolerance that mostly ends just inside
AIM = 0.985  # of the tolerance
CLOSE_ENOUGH = 0.97  # of the tolerance: the search for a larger step stops there
NEIGHBOURS = 2  # codes, about 1 %: closer than that is not worth a trial
TRIALS = 24  # mostly four; many only where the error does not follow the step
LEAST_STEP = 1e-9  # centimetres


@dataclass(frozen=True, eq=False)
class Encoded:
    """An encoded clip: the bytes of its index file and the certificate that is in them."""

    data: bytes
    certificate: Errors
    used_patterns: tuple[IntArray, ...]  # per part: the pattern of every segment, -1 for none


@dataclass(frozen=True, eq=False)
class Encoder:
    """Encodes clips of one rig family against one generation of its patterns.

    ``tolerance``: the largest error allowed, centimetres; ``rules``: how clips are cut;
    ``radius``: how far (RMS centimetres) a segment may be from its pattern. Pickles small:
    the look-up of patterns is built where it is first used.
    """

    codebook: Codebook
    generation: int
    tolerance: float
    radius: float
    rules: SegmentRules

    @cached_property
    def searchers(self) -> tuple[NearestPatterns, ...]:
        """The patterns of each part, for look-up."""
        return tuple(NearestPatterns(points) for points in self.codebook.centimetres)

    def __getstate__(self) -> dict[str, object]:
        state = dict(self.__dict__)
        state.pop("searchers", None)
        return state

    def encode(self, clip: Clip, rig: Rig, rig_number: int) -> Encoded:
        """Return the index file of ``clip``, whose error is inside the tolerance.

        ``rig``: the clip's rig, ``rig_number``: its number in the store. Raises
        `GuaranteeError` if no quantiser step brings the clip inside, `UnsupportedError` for
        positions that no tolerance can be kept for.
        """
        check_size(clip)
        segments = clip_segments(clip, self.codebook.family, self.rules)
        index = tuple(
            None if part is None else _indexed(part, searcher, self.radius)
            for part, searcher in zip(segments, self.searchers, strict=True)
        )
        subject = Subject.of(clip, rig, self.codebook, index, self.tolerance)
        bound = self.tolerance - min(TEXT_MARGIN, self.tolerance / 30.0)
        code = _search_step(subject, bound)
        data = _packed(subject, rig_number, self.generation, code, self.tolerance)
        used = tuple(np.zeros(0, np.int64) if part is None else part.patterns for part in index)
        return Encoded(data, unpack(data).certificate, used)


def _indexed(part: Segments, searcher: NearestPatterns, radius: float) -> PartIndex:
    numbers, _ = searcher.within(part.points, radius)
    return PartIndex(part.borders, numbers, np.zeros(len(numbers), bool))


def _search_step(subject: Subject, tolerance: float) -> int:
    """Return the code of the largest step found whose error is inside ``tolerance``.

    The error is close to proportional to the step, so each trial scales the step by what the
    last one missed, but stays between the largest step known to be inside and the smallest
    known to be outside; the search ends when those are neighbours, or the error is close.
    """
    code = code_below(FIRST_GUESS * tolerance)
    if subject.clip.frames == 0:
        return code
    best, outside = -1, CODES
    for trial in range(TRIALS):
        _, error = subject.quantised(step_of(code))
        if error <= tolerance:
            best = code
            if error >= CLOSE_ENOUGH * tolerance or error <= 0.0:
                break
        else:
            outside = code
        if outside - best <= NEIGHBOURS or (best < 0 and step_of(code) < LEAST_STEP):
            break
        factor = AIM * tolerance / max(error, 1e-12)
        code = code_below(step_of(code) * min(max(factor, 0.05), 4.0))
        if not best < code < outside:
            code = (best + outside) // 2 if best >= 0 else max(0, outside - (1 << trial))
    if best < 0:
        raise GuaranteeError(
            f"no quantiser step brings the clip inside {tolerance:g} cm",
            advice="Ask for a larger tolerance",
        )
    return best


def _packed(
    subject: Subject, rig_number: int, generation: int, code: int, tolerance: float
) -> bytes:
    """Return the index file at a step, certified by decoding exactly what is returned."""
    step = step_of(code)
    integers, _ = subject.quantised(step)
    chosen, lefts = _choose_predictors(subject, integers, step)
    longest = most_frames(subject.rig.frame_time)
    index = IndexFile(
        rig_number,
        generation,
        subject.clip.frames,
        code,
        Errors(0.0, 0.0, 0.0),
        write_preview(subject.rig, subject.codebook, chosen, longest, lefts[0]),
        write_rest(lefts[1:]),
    )
    decoded = decode(unpack(pack(index)), subject.rig, subject.codebook)
    certificate = measure(subject.clip, decoded)
    if isinstance(decoded, MarkerClip) and (decoded.seen != subject.preview.seen).any():
        raise GuaranteeError("the gaps of the decoded clip differ from the original's")
    if float32_above(certificate.maximum) > tolerance:
        raise GuaranteeError(
            f"the decoded clip is {certificate.maximum:g} cm off, outside {tolerance:g} cm"
        )
    return pack(replace(index, certificate=certificate))


def _choose_predictors(
    subject: Subject, integers: list[IntArray], step: float
) -> tuple[Preview, list[IntArray]]:
    """Return the preview with predictors chosen by cost, and each part's prediction residual."""
    preview = subject.preview
    orders, parts, lefts = [], [], []
    for number, (part, values) in enumerate(
        zip(subject.codebook.family.parts, integers, strict=True)
    ):
        starts = part_starts(preview, part.joints, values.shape[1])
        best: tuple[float, int, PartIndex | None, IntArray] | None = None
        for order in ORDERS:
            index, left = _use_patterns(subject, number, values, step, order, starts)
            cost = float(_cost(left).sum())
            if best is None or cost < best[0]:
                best = cost, order, index, left
        assert best is not None
        orders.append(best[1])
        parts.append(best[2])
        lefts.append(best[3])
    return replace(preview, orders=tuple(orders), parts=tuple(parts)), lefts


def _use_patterns(
    subject: Subject, number: int, values: IntArray, step: float, order: int, starts: BoolArray
) -> tuple[PartIndex | None, IntArray]:
    """Return a part's index with patterns predicting where that is cheaper, and what is left."""
    index = subject.preview.parts[number]
    plain = predicted(values, None, None, starts, order)
    if index is None or not len(index.patterns):
        return index, plain
    course = np.rint(pattern_course(subject.codebook, subject.preview, number) / step)
    course = course.astype(np.int64)
    all_used = replace(index, predicts=index.patterns >= 0)
    helped = predicted(values, course, all_used, starts, order)
    gain = np.add.reduceat(_cost(plain) - _cost(helped), index.borders[:-1])
    chosen = replace(index, predicts=(gain > 0) & (index.patterns >= 0))
    return chosen, predicted(values, course, chosen, starts, order)


def _cost(left: IntArray) -> FloatArray:
    """Return about how many bits each frame's residual (frames, channels) costs."""
    return np.asarray(np.log2(1.0 + 2.0 * np.abs(left)).sum(axis=1))
