"""From a clip to an index file of version 2 inside its limits, proved by decoding it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from ..blocks.leads import Lead, Leads, leads_of_run
from ..blocks.motionmodel import MotionModel
from ..blocks.nodes import Nodes
from ..blocks.offered import Reference
from ..blocks.runstream import Known, write_run
from ..clip import Clip, FloatArray, IntArray, MarkerClip
from ..errors import GuaranteeError
from ..figure.rig import Family, Rig
from ..figure.sliding import check_size
from ..geometry.limits import TEXT_MARGIN, Limits
from ..geometry.metrics import Errors, measure
from ..streams.entropy import SymbolWriter
from ..streams.quantiser import code_below
from .leadfinding import Hint, find_leads
from .motioncodec import CodedRun, clip_of, code_run, known_of
from .motiondecode import decode_states, step_units
from .motionfile import MotionFile, pack_motion, runs_of, told, unpack_motion
from .motiongoal import Goal, goal_of
from .motionhead import Head, Named, write_head

THRIFT = 0.13  # weight of bits against squared error in rounding: the slope of fine quantisers
LARGEST_STEP = 1.1  # of the largest limit; nodes and blocks refine it where they must
MOST_REFINED = 32.0  # times: less than what `blockcoder.MOST_FINE` allows
MEAN_STEP = 2.5  # steps over mean errors that mostly end near
MAXIMUM_OVER_MEAN = 4.0  # of errors, mostly
TRIALS = 12
NO_LIMIT = 1e3  # centimetres: of a clip of no frames
CLOSE_ENOUGH = 0.985  # of the mean error that is allowed
LEAST_MOTION = 1e-3  # of the motion that is usually worth coding: where too little was coded


@dataclass(frozen=True, eq=False)
class EncodedMotion:
    """An encoded clip: its index file, the certificate in it, and what others may refer to."""

    data: bytes
    certificate: Errors
    nodes: Nodes
    states: tuple[IntArray, ...]


@dataclass(frozen=True, eq=False)
class MotionEncoder:
    """Encodes clips of one rig family with one motion model.

    ``generation``: of the model, 0 for a fixed one; ``by_part``: whether each body part is in
    streams of its own.
    """

    family: Family
    model: MotionModel
    generation: int
    by_part: bool = False

    def encode(
        self,
        clip: Clip,
        rig: Rig,
        rig_number: int,
        limits: Limits,
        references: Sequence[tuple[Named, Reference]] = (),
        hints: Sequence[Hint] = (),
    ) -> EncodedMotion:
        """Return the index file of ``clip``, which is inside its ``limits``.

        ``references``: (what it is, decoded clip), ascending; ``hints``: where the clip may go
        as one of them does. Raises `GuaranteeError` if no step brings the clip inside,
        `UnsupportedError` for what cannot be coded.
        """
        check_size(clip)
        goal = goal_of(clip, rig, self.family, limits)
        try:
            made = self.encode_led(clip, rig, rig_number, limits, references, (), goal)
        except GuaranteeError:
            if isinstance(clip, MarkerClip):
                raise
            # what is too small to be coded in each of many joints may be too much in all of them
            goal = goal_of(clip, rig, self.family, limits, LEAST_MOTION)
            made = self.encode_led(clip, rig, rig_number, limits, references, (), goal)
        tracks = [reference.track for _, reference in references]
        mean = limits.least if limits.mean is None else MAXIMUM_OVER_MEAN * limits.mean
        tolerance = min(limits.least, mean)
        leads = find_leads(goal.path, goal.nodes, tracks, hints, self.model.span, tolerance)
        if leads:
            with suppress(GuaranteeError):  # where a reference was less exact than this is to be
                led = self.encode_led(clip, rig, rig_number, limits, references, leads, goal)
                made = min(made, led, key=lambda each: len(each.data))
        return made

    def encode_led(
        self,
        clip: Clip,
        rig: Rig,
        rig_number: int,
        limits: Limits,
        references: Sequence[tuple[Named, Reference]],
        leads: tuple[Lead, ...],
        goal: Goal | None = None,
    ) -> EncodedMotion:
        """Return the index file of a clip that follows ``leads``, whether it is like them or not.

        ``goal``: of the clip, if it is known. Raises as `encode` does.
        """
        goal = goal or goal_of(clip, rig, self.family, limits)
        margin = min(TEXT_MARGIN, limits.least / 30.0)
        decoded_from = [reference for _, reference in references]
        streams = len(rig.parts) if self.by_part else 1
        known = known_of(goal.nodes, rig, self.family, self.model, decoded_from, streams)
        head = Head(
            tuple(named for named, _ in references),
            goal.still,
            goal.sliding,
            clip.seen if isinstance(clip, MarkerClip) else None,
            goal.fines,
            leads,
        )
        tracks = [reference.track for reference in decoded_from]
        rows, span = self.model.rows, self.model.span
        followed = [
            leads_of_run(leads, tracks, goal.nodes, rows, span, low, high)
            for low, high in runs_of(clip.frames)
        ]
        tightness = 1.0
        for trial in range(TRIALS):
            aimed = _tightened(goal, limits, margin, tightness)
            mean = None if limits.mean is None else limits.mean * min(tightness, 1.0)
            code, runs = self._search(known, aimed, mean, followed)
            file = self._file(
                head, rig, rig_number, clip.frames, code, known, runs, streams, followed
            )
            data = pack_motion(file)
            decoded = decode_states(unpack_motion(data), rig, self.family, self.model, decoded_from)
            found = clip_of(rig, decoded.nodes, decoded.states, decoded.head.seen)
            certificate = measure(clip, found)
            excess = self._excess(clip, found, certificate, limits)
            if excess <= 1.0:
                data = pack_motion(replace(file, certificate=certificate))
                told = unpack_motion(data).certificate
                return EncodedMotion(data, told, decoded.nodes, decoded.states)
            # faster and faster: what a hinge loses may show in no step for a while
            tightness *= (0.98 / excess) ** (1 + trial)
        raise GuaranteeError(
            f"no quantiser step brings the clip inside {limits.least:g} cm",
            advice="Ask for a larger tolerance",
        )

    def _excess(self, clip: Clip, found: Clip, certificate: Errors, limits: Limits) -> float:
        """Return how far the decoded clip is outside its limits; 1 and less are inside."""
        excess = told(certificate.maximum) / limits.least if limits.uniform else 0.0
        if not limits.uniform:
            excess = limits.excess(clip, found)
        if limits.mean is not None:
            excess = max(excess, certificate.mean / limits.mean)
        return excess

    def _search(
        self, known: Known, goal: Goal, mean_limit: float | None, followed: list[Leads]
    ) -> tuple[int, list[CodedRun]]:
        """Return a step's code and the runs coded at it."""
        least = min(_loosest(goal.yardstick.joint_limits), _loosest(goal.yardstick.frame_limits))
        if mean_limit is None:
            code = code_below(LARGEST_STEP * least)
            return code, self._coded(known, goal, code, followed)
        aim = mean_limit
        code = code_below(min(MEAN_STEP * aim, LARGEST_STEP * least))
        best: tuple[int, list[CodedRun]] | None = None
        for _ in range(TRIALS):
            runs = self._coded(known, goal, code, followed)
            mean = _mean_of(runs)
            if mean <= aim and (best is None or code > best[0]):
                best = code, runs
            if mean <= 0.0 or (CLOSE_ENOUGH * aim <= mean <= aim):
                break
            factor = min(max(0.995 * aim / mean, 0.25), 4.0)
            better = code_below(min(factor * _step(code), LARGEST_STEP * least))
            if better == code or (best is not None and better <= best[0]):
                break
            code = better
        if best is None:
            raise GuaranteeError(
                f"no quantiser step brings the mean error inside {aim:g} cm",
                advice="Ask for a larger tolerance",
            )
        return best

    def _coded(self, known: Known, goal: Goal, code: int, followed: list[Leads]) -> list[CodedRun]:
        step = step_units(code)
        frames = len(goal.path)
        return [
            code_run(known, *goal.run(low, high), step, THRIFT, True, leads)
            for (low, high), leads in zip(runs_of(frames), followed, strict=True)
        ]

    def _file(
        self,
        head: Head,
        rig: Rig,
        rig_number: int,
        frames: int,
        code: int,
        known: Known,
        runs: list[CodedRun],
        streams: int,
        followed: list[Leads],
    ) -> MotionFile:
        cores = [SymbolWriter() for _ in runs] or [SymbolWriter()]
        write_head(cores[0], head, rig, self.model.still, self.model.sliding)
        step = step_units(code)
        rests = [
            rest
            for run, core, leads in zip(runs, cores, followed, strict=False)
            for rest in write_run(
                *(known, step, run.start, run.motifs, run.walk, core, streams),
                led=leads.first is not None,
            )
        ]
        return MotionFile(
            rig_number,
            self.generation,
            frames,
            code,
            Errors(0.0, 0.0, 0.0),
            tuple(core.to_bytes() for core in cores),
            tuple(rests),
            streams,
            bool(head.leads) and not head.mirrored,
            head.mirrored,
        )


def _loosest(limits: FloatArray) -> float:
    """Return the largest of some limits, or what refinement can bring down to the smallest."""
    least = float(limits.min(initial=NO_LIMIT))
    return min(float(limits.max(initial=0.0)) or NO_LIMIT, MOST_REFINED * least)


def _mean_of(runs: list[CodedRun]) -> float:
    """Return the mean error of all runs, centimetres."""
    if not runs:
        return 0.0
    weights = [len(run.walk.state) for run in runs]
    return float(np.average([run.walk.mean for run in runs], weights=weights))


def _step(code: int) -> float:
    return step_units(code) / float(1 << 24)


def _tightened(goal: Goal, limits: Limits, margin: float, tightness: float) -> Goal:
    """Return the goal with its limits a little narrower."""
    measure = replace(
        goal.yardstick,
        joint_limits=(limits.joints - margin) * tightness,
        frame_limits=(limits.frames - margin) * tightness,
    )
    return replace(goal, yardstick=measure)
