"""Clips that a motion model is learned from, walked as the encoder walks."""

from __future__ import annotations

from dataclasses import dataclass

from ..blocks.blockwalk import Walk, walk
from ..blocks.motionmodel import MotionModel
from ..blocks.nodes import Nodes
from ..blocks.recall import Memory
from ..blocks.yardstick import Yardstick
from ..clip import IntArray


@dataclass(frozen=True, eq=False)
class Sample:
    """One clip to learn from: what `blockwalk.walk` takes."""

    goal: IntArray
    first: IntArray
    nodes: Nodes
    yardstick: Yardstick


@dataclass(frozen=True)
class Manner:
    """How samples are walked: ``step`` (2^-24 cm) and ``thrift``; see `blockwalk.walk`."""

    step: int
    thrift: float


def walked(sample: Sample, model: MotionModel, memory: Memory, manner: Manner) -> Walk:
    """Return the walk through a sample without refinement."""
    return walk(
        sample.goal,
        sample.first,
        sample.nodes,
        model,
        memory,
        sample.yardstick,
        manner.step,
        manner.thrift,
        False,
    )
