"""A motion model as bytes: its integers, entropy-coded, each kind at the precision that it has."""

from __future__ import annotations

import math

import numpy as np

from .blockcontext import feature_count
from .clip import IntArray
from .entropy import SymbolReader, SymbolWriter
from .errors import DamagedError
from .motionmodel import GROUPS, SIGNS, MotionModel, usual_lags
from .sizeclasses import CLASSES, LEAST_OCTAVE, PER_OCTAVE

WEIGHT_SHIFT_LIMIT = 16
MOST_ROWS = 1 << 14


def write_model(model: MotionModel) -> bytes:
    """Return the bytes of a model."""
    writer = SymbolWriter()
    for value in (model.span, model.up, model.rows, len(model.still), *model.still):
        writer.number(int(value))
    writer.number(len(model.sliding))
    for joint in model.sliding:
        writer.number(joint)
    for row in range(model.rows):
        for values in (model.folded_weights[row], model.folded_basis[row]):
            shifts = _trailing_zeros(values)
            writer.uniform(shifts, WEIGHT_SHIFT_LIMIT)
            _write_block(writer, values >> shifts[:, None])
        _write_block(writer, model.base[row, None])
        _write_block(writer, model.senses[row])
        _write_block(writer, model.starts[row])
    return writer.to_bytes()


def read_model(data: bytes) -> MotionModel:
    """Return the model of `write_model`'s bytes. Raises `DamagedError`."""
    reader = SymbolReader(data)
    span, up, rows = reader.number(), reader.number(), reader.number()
    if span not in (4, 8, 16, 32) or up > 2 or rows > MOST_ROWS:
        raise DamagedError(f"claims blocks of {span} frames in {rows} rows")
    still = tuple(reader.number() for _ in range(_few(reader.number(), rows)))
    sliding = tuple(reader.number() for _ in range(_few(reader.number(), rows)))
    features, channels = feature_count(span), 3 * span
    weights: list[IntArray] = []
    basis: list[IntArray] = []
    base: list[IntArray] = []
    senses: list[IntArray] = []
    starts: list[IntArray] = []
    for _ in range(rows):
        for shape, kept in (((features, channels), weights), ((channels, channels), basis)):
            shifts = reader.uniform(shape[0], WEIGHT_SHIFT_LIMIT)
            kept.append(_read_block(reader, shape) << shifts[:, None])
        base.append(_read_block(reader, (1, channels))[0])
        senses.append(_read_block(reader, (GROUPS, SIGNS)))
        starts.append(_read_block(reader, (2, 3)))
    return MotionModel(
        span,
        usual_lags(span),
        up,
        np.array(weights, np.int64).reshape(rows, features, channels),
        np.array(basis, np.int64).reshape(rows, channels, channels),
        np.array(base, np.int64).reshape(rows, channels),
        np.array(senses, np.int64).reshape(rows, GROUPS, SIGNS),
        np.array(starts, np.int64).reshape(rows, 2, 3),
        still,
        sliding,
    )


def _few(count: int, most: int) -> int:
    if count > most:
        raise DamagedError(f"claims {count} joints of {most}")
    return count


def _trailing_zeros(values: IntArray) -> IntArray:
    """Return how many low bits are zero in all of each row (rows, n)."""
    together = np.bitwise_or.reduce(values, axis=1)
    lowest = together & -together
    found = [int(bit).bit_length() - 1 if bit else 0 for bit in lowest.tolist()]
    return np.minimum(np.array(found, np.int64), WEIGHT_SHIFT_LIMIT - 1)


def _class_for(mean: float) -> int:
    level = math.log2(max(mean, 2.0**LEAST_OCTAVE)) - LEAST_OCTAVE
    return min(int(level * PER_OCTAVE), CLASSES - 1)


def _write_block(writer: SymbolWriter, values: IntArray) -> None:
    """Write a table, each line with the class that its mean size asks for."""
    classes = np.array([_class_for(float(np.abs(line).mean())) for line in values], np.int64)
    writer.uniform(classes, CLASSES)
    writer.sized(values.ravel(), np.repeat(classes, values.shape[1]))


def _read_block(reader: SymbolReader, shape: tuple[int, int]) -> IntArray:
    classes = reader.uniform(shape[0], CLASSES)
    return reader.sized(np.repeat(classes, shape[1])).reshape(shape)
