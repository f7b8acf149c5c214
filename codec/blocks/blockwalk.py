"""The encoder's way through a clip: every block inside its limits, at the least bits.

The walk follows the decoder exactly. Where a decoded block is outside its limits, the block is
coded again with a finer step, so that one hard moment does not raise the price of the others.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..arithmetic.compiled import compiled
from ..clip import BoolArray, FloatArray, IntArray
from ..streams.sizeclasses import bits_of, class_costs
from .aiming import aim
from .blockcoder import MOST_FINE, choose, expect, fine_step, settle, wanted
from .blockcontext import pose
from .leads import Leads, no_leads
from .motionmodel import SIGNS, MotionModel
from .nodes import FINE, FOLLOWER, KIND, ROW, Nodes
from .recall import FollowArray, KeyArray, Memory, own_memory, own_stride, remember_next
from .yardstick import Yardstick, errors_at

STEP_BITS = 24  # steps: 2^-24 cm
LED_THRIFT = 3.0  # times: a copy need not be better than what it is a copy of


@dataclass(frozen=True, eq=False)
class Walk:
    """What a walk chose.

    ``state``: (frames or more, nodes, 4) as the decoder will see it; ``quantised`` and
    ``classes``: (blocks, nodes, channels); ``signs``: (blocks, nodes, 10) what the classes were
    chosen by, see `blockcoder.expect`; ``fines``: (blocks,) refinements; ``costs``: (nodes,)
    about how many bits each node costs; ``largest``: the largest error, as a share of its limit;
    ``mean``: mean error, centimetres.
    """

    state: IntArray
    quantised: IntArray
    classes: IntArray
    signs: IntArray
    fines: IntArray
    costs: FloatArray
    largest: float
    mean: float


def walk(
    goal: IntArray,
    first: IntArray,
    nodes: Nodes,
    model: MotionModel,
    memory: Memory,
    yardstick: Yardstick,
    step: int,
    thrift: float,
    refine: bool = True,
    leads: Leads | None = None,
) -> Walk:
    """Return the choices for a clip whose first pose is decoded already.

    ``goal``: (frames, nodes, 4) turns × 2^30 and places in 2^-20 cm; ``first``: (nodes, 4) the
    decoded first pose; ``step``: 2^-24 cm; ``thrift``: weight of bits against squared error
    when rounding; ``refine``: whether blocks outside their limits are coded again; ``leads``:
    what the clip follows.
    """
    frames, count = len(goal), nodes.count
    blocks = -(-(frames - 1) // model.span) if frames else 0
    padded = 1 + blocks * model.span
    full = np.concatenate([goal, np.repeat(goal[-1:], max(padded - frames, 0), axis=0)])
    state = np.zeros((padded, count, 4), np.int64)
    state[:1] = first
    quantised = np.zeros((blocks, count, model.channels), np.int64)
    classes = np.zeros((blocks, count, model.channels), np.int64)
    signs = np.zeros((blocks, count, SIGNS), np.int64)
    fines = np.zeros(blocks, np.int64)
    costs = np.zeros(count)
    own = own_memory(frames, model.rows, model.span)
    leads = leads or no_leads(nodes, frames, model.span)
    largest, total, measured = _walk(
        full,
        state,
        frames,
        nodes.table,
        nodes.top,
        nodes.path,
        model.span,
        model.lags,
        model.up,
        model.weights,
        model.basis,
        model.analysis,
        model.base,
        model.senses,
        memory.keys,
        memory.follows,
        own.keys,
        own.follows,
        *yardstick.arrays,
        step,
        thrift,
        refine,
        leads.which,
        leads.states,
        leads.has,
        *class_costs(),
        quantised,
        classes,
        signs,
        fines,
        costs,
    )
    return Walk(state, quantised, classes, signs, fines, costs, largest, total / max(measured, 1))


@compiled
def _walk(
    goal: IntArray,
    state: IntArray,
    frames: int,
    table: IntArray,
    top: int,
    path: int,
    span: int,
    lags: IntArray,
    up: int,
    weights: IntArray,
    basis: IntArray,
    analysis: FloatArray,
    base: IntArray,
    senses: IntArray,
    keys: KeyArray,
    follows: FollowArray,
    own_keys: KeyArray,
    own_follows: FollowArray,
    true_world: FloatArray,
    true_points: FloatArray,
    skeleton: IntArray,
    offsets: FloatArray,
    mends: FloatArray,
    counted: FloatArray,
    joint_limits: FloatArray,
    frame_limits: FloatArray,
    step: int,
    thrift: float,
    refine: bool,
    which: IntArray,
    led_states: IntArray,
    has: BoolArray,
    zeros: FloatArray,
    ones: FloatArray,
    more: FloatArray,
    quantised: IntArray,
    classes: IntArray,
    signs: IntArray,
    fines: IntArray,
    costs: FloatArray,
) -> tuple[float, float, float]:
    blocks, nodes, channels = quantised.shape
    signals = np.zeros((nodes, span, 3), np.int64)
    activity = np.zeros((3, nodes), np.int64)
    prediction = np.empty(channels, np.int64)
    aims = np.empty((span, 4), np.int64)
    goals = np.empty(channels, np.int64)
    rest = np.empty(channels)
    errors = np.empty(true_points.shape[1])
    block_costs = np.zeros(nodes)
    largest, total, measured, own = 0.0, 0.0, 0.0, 0
    for frame in range(min(frames, 1)):
        errors_at(state, frame, true_world, true_points, skeleton, offsets, errors)
        for j in range(len(errors)):
            total += errors[j] * counted[frame, j]
            measured += counted[frame, j]
            share = errors[j] * counted[frame, j] / min(joint_limits[j], frame_limits[frame])
            largest = max(largest, share)
    for block in range(blocks):
        start = 1 + block * span
        fine, best_share = 0, 0.0
        led = which[block]
        saved = thrift if led < 0 else LED_THRIFT * thrift
        if led >= 0:
            led_states[led, 0] = state[start - 1]
        while True:
            block_costs[:] = 0.0
            for node in range(nodes):
                if table[node, KIND] == FOLLOWER:
                    pose(state, table, node, start, span, signals)
                    continue
                expect(
                    state, table, node, start, span, lags, up, weights, base, senses,
                    keys, follows, own_keys, own_follows, own, signals, activity, top, path,
                    step, fine, led_states, has, led,
                    prediction, classes[block, node], signs[block, node],
                )  # fmt: skip
                aim(state, goal, table, node, start, true_points, skeleton, offsets, mends, aims)
                wanted(state, aims, table, node, start, goals)
                for c in range(channels):
                    goals[c] -= prediction[c]
                size = fine_step(step, fine + table[node, FINE])
                choose(
                    goals, rest, basis[table[node, ROW]], analysis[table[node, ROW]], size,
                    classes[block, node], ones, more, saved / (1.0 + fine),
                    quantised[block, node],
                )  # fmt: skip
                for c in range(channels):
                    kind = classes[block, node, c]
                    size = abs(quantised[block, node, c])
                    block_costs[node] += bits_of(kind, size, zeros, ones, more)
                settle(
                    state, table, node, start, span, basis, prediction, quantised[block, node],
                    step, fine, signals, activity,
                )  # fmt: skip
            best_share, block_total, block_measured = 0.0, 0.0, 0.0
            for frame in range(start, min(start + span, frames)):
                errors_at(state, frame, true_world, true_points, skeleton, offsets, errors)
                for j in range(len(errors)):
                    block_total += errors[j] * counted[frame, j]
                    block_measured += counted[frame, j]
                    share = errors[j] * counted[frame, j]
                    share /= min(joint_limits[j], frame_limits[frame])
                    best_share = max(best_share, share)
            if not refine or best_share <= 1.0 or fine >= MOST_FINE:
                break
            fine = min(fine + max(1, int(math.log2(best_share) * 2.0)), MOST_FINE)
        costs += block_costs
        total += block_total
        measured += block_measured
        largest = max(largest, best_share)
        fines[block] = fine
        activity[2] = activity[1]
        activity[1] = activity[0]
        own = remember_next(
            state, start + span, table, span, lags, up, weights, own_stride(span),
            own_keys, own_follows, own,
        )  # fmt: skip
    return largest, total, measured
