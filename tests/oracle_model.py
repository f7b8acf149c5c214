"""Motion models of index files of version 2, from docs/format.md alone.

Follows the sections "Motion model" and "Fixed model". Shares no code with ``motifold``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import numpy.typing as npt
from oracle_stream import SymbolReader

Whole = npt.NDArray[np.int64]
FIXED_BASE = (-716, -1409, -1814, -2038, -1882, -1970, -2036, -2008, -1817)
FIXED_SENSES = [145, 27, 50, -6, -132, 209, 0, 0, 0, 0]


@dataclass
class Row:
    """What a model says of one row: W (features, channels), B (coefficients, channels), sizes."""

    weights: Whole
    basis: Whole
    base: list[int]
    senses: list[list[int]]
    starts: list[list[int]]


@dataclass
class Model:
    span: int
    vertical: int
    still: set[int] = field(default_factory=set)
    sliding: set[int] = field(default_factory=set)
    rows: list[Row] = field(default_factory=list)

    @property
    def lags(self) -> tuple[int, ...]:
        return (1, 2, 3, 4) if self.span == 4 else (1, 2, 4, 8)


def cosines(span: int) -> npt.NDArray[np.float64]:
    """Return C before scaling and rounding, (3 S, 3 S)."""
    k, t = np.arange(span)[:, None], np.arange(span)
    c = np.where(k == 0, np.sqrt(1 / span), np.sqrt(2 / span))
    return np.asarray(np.kron(c * np.cos(np.pi * k * (t + 0.5) / span), np.eye(3)), np.float64)


def rounded(matrix: npt.NDArray[np.float64]) -> Whole:
    return np.rint(matrix).astype(np.int64)


def spread(span: int) -> Whole:
    """Return E, (31 + 6 S, 31 + 6 S)."""
    found = np.eye(31 + 6 * span, dtype=np.int64) << 14
    for start in (15, 21 + 3 * span):
        block = slice(start, start + 3 * span)
        found[block, block] = rounded(2**14 * cosines(span))
    return found


def weights_of(folded: Whole, span: int) -> Whole:
    c = rounded(2**14 * cosines(span))
    return ((((spread(span).T @ folded) + 2**13) >> 14) @ c + 2**13) >> 14


def basis_of(folded: Whole, span: int) -> Whole:
    return (folded @ rounded(2**14 * cosines(span)) + 2**13) >> 14


@cache
def fixed_row(span: int, hinged: bool) -> Row:
    v = np.zeros((31 + 6 * span, 3 * span))
    for i in range(span):
        phi = sum(0.8 ** (n + 1) for n in range(i + 1))
        for a in range(3):
            v[a, 3 * i + a] = -phi
            v[15 + 3 * i + a, 3 * i + a] = 1
            v[15 + 3 * span + a, 3 * i + a] = phi
    folded = rounded(2**16 * (spread(span) / 2**14) @ v @ cosines(span).T)
    if hinged:
        folded[15 : 21 + 3 * span] = 0
    k, t = np.arange(span)[:, None], np.arange(span)
    z = np.sin(np.pi * (2 * k + 1) * (t + 1) / (2 * span + 1)) * 2 / np.sqrt(2 * span + 1)
    return Row(
        weights_of(folded, span),
        basis_of(rounded(2**14 * np.kron(z, np.eye(3)) @ cosines(span).T), span),
        [FIXED_BASE[min(k // 3, 8)] for k in range(3 * span)],
        [FIXED_SENSES] * 3,
        [[768] * 3, [512] * 3],
    )


def fixed_model(span: int, rows: int, hinged: Collection[int]) -> Model:
    """Return the model of generation 0; ``hinged``: joints of the family."""
    return Model(span, 1, rows=[fixed_row(span, row in hinged) for row in range(rows)])


def read_model(stream: bytes, hinged: Collection[int]) -> Model:
    """Read a model of the store."""
    reader = SymbolReader(stream)

    def table(lines: int, numbers: int) -> list[list[int]]:
        classes = reader.uniforms(120, lines)
        return [[reader.sized(c) for _ in range(numbers)] for c in classes]

    def folded(lines: int, numbers: int) -> Whole:
        shifts = reader.uniforms(16, lines)
        found: Whole = np.array(table(lines, numbers), np.int64) << np.array(shifts)[:, None]
        return found

    span = reader.number()
    model = Model(span, reader.number())
    count = reader.number()
    model.still = {reader.number() for _ in range(reader.number())}
    model.sliding = {reader.number() for _ in range(reader.number())}
    for number in range(count):
        fixed = fixed_row(span, number in hinged)
        has_weights, has_basis, has_sizes = reader.uniforms(2, 3)
        row = Row(fixed.weights, fixed.basis, fixed.base, fixed.senses, fixed.starts)
        if has_weights:
            row.weights = weights_of(folded(31 + 6 * span, 3 * span), span)
        if has_basis:
            row.basis = basis_of(folded(3 * span, 3 * span), span)
        if has_sizes:
            (row.base,) = table(1, 3 * span)
            row.senses, row.starts = table(3, 10), table(2, 3)
        model.rows.append(row)
    return model
