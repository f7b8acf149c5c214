"""A motion model as bytes: its integers, entropy-coded, each kind at the precision that it has.

Rows, or parts of rows, that are as in the fixed model take three bits.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..blocks.motionmodel import MotionModel, fixed_model
from ..clip import FloatArray, IntArray
from ..errors import DamagedError
from ..streams.entropy import SymbolReader, SymbolWriter
from ..streams.sizeclasses import CLASSES, LEAST_OCTAVE, PER_OCTAVE

WEIGHT_SHIFT_LIMIT = 16
_LARGEST = 1 << 18  # rows × span²: what a damaged file can make a reader set aside


def can_store(rows: int, span: int) -> bool:
    """Return whether a model of so many rows is one that `read_model` reads."""
    return rows * span * span <= _LARGEST


def write_model(model: MotionModel) -> bytes:
    """Return the bytes of a model."""
    writer = SymbolWriter()
    for value in (model.span, model.up, model.rows, len(model.still), *model.still):
        writer.number(int(value))
    writer.number(len(model.sliding))
    for joint in model.sliding:
        writer.number(joint)
    fixed = fixed_model(model.rows, model.span, model.up, model.hinged)
    for row in range(model.rows):
        _write_row(writer, model, row, fixed)
    return writer.to_bytes()


def row_sizes(model: MotionModel) -> FloatArray:
    """Return how many bytes each row (rows,) takes."""
    fixed = fixed_model(model.rows, model.span, model.up, model.hinged)
    sizes = np.zeros(model.rows)
    for row in range(model.rows):
        writer = SymbolWriter()
        _write_row(writer, model, row, fixed)
        sizes[row] = len(writer.to_bytes())
    return np.asarray(sizes)


def _write_row(writer: SymbolWriter, model: MotionModel, row: int, fixed: MotionModel) -> None:
    """Write what of a row is not as in the fixed model, after three flags that say so."""
    tables = (model.folded_weights[row], model.folded_basis[row])
    own = [
        not np.array_equal(values, usual[row])
        for values, usual in zip(tables, (fixed.folded_weights, fixed.folded_basis), strict=True)
    ]
    sizes = (model.base[row, None], model.senses[row], model.starts[row])
    usual_sizes = (fixed.base[row, None], fixed.senses[row], fixed.starts[row])
    own.append(not all(map(np.array_equal, sizes, usual_sizes)))
    writer.uniform([int(flag) for flag in own], 2)
    for values, written in zip(tables, own, strict=False):
        if written:
            shifts = _trailing_zeros(values)
            writer.uniform(shifts, WEIGHT_SHIFT_LIMIT)
            _write_block(writer, values >> shifts[:, None])
    if own[2]:
        for values in sizes:
            _write_block(writer, values)


def read_model(data: bytes, hinged: tuple[int, ...] = ()) -> MotionModel:
    """Return the model of `write_model`'s bytes; ``hinged``: joints of its rig family.

    Raises `DamagedError`.
    """
    reader = SymbolReader(data)
    span, up, rows = reader.number(), reader.number(), reader.number()
    if span not in (4, 8, 16, 32) or up > 2 or not can_store(rows, span):
        raise DamagedError(f"claims blocks of {span} frames in {rows} rows")
    still = tuple(reader.number() for _ in range(_few(reader.number(), rows)))
    sliding = tuple(reader.number() for _ in range(_few(reader.number(), rows)))
    if any(2 * joint >= rows for joint in hinged):
        raise DamagedError(f"has {rows} rows, which are not those of its rig family")
    model = replace(fixed_model(rows, span, up, hinged), still=still, sliding=sliding)
    for row in range(rows):
        own = reader.uniform(3, 2)
        for values, written in zip((model.folded_weights, model.folded_basis), own, strict=False):
            if written:
                shifts = reader.uniform(values.shape[1], WEIGHT_SHIFT_LIMIT)
                values[row] = _read_block(reader, values.shape[1:]) << shifts[:, None]
        if own[2]:
            model.base[row] = _read_block(reader, (1, model.channels))[0]
            model.senses[row] = _read_block(reader, model.senses.shape[1:])
            model.starts[row] = _read_block(reader, model.starts.shape[1:])
    return model


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


def _read_block(reader: SymbolReader, shape: tuple[int, ...]) -> IntArray:
    classes = reader.uniform(shape[0], CLASSES)
    return reader.sized(np.repeat(classes, shape[1])).reshape(shape)
