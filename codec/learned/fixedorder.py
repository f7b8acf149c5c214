"""Linear algebra that adds in one order, so that all machines learn the same bits.

A library of linear algebra adds in the order that suits a processor, and the last bits of its
sums depend on it. A model is fitted in rounds to walks with the model before, so that one number
rounded the other way changes every file of an archive. These loops are slower; IEEE 754 leaves
them one result.
"""

from __future__ import annotations

import math

import numpy as np

from ..arithmetic.compiled import compiled
from ..clip import FloatArray

SWEEPS = 60  # at the most: a dozen are enough for matrices of a hundred
STILL = 1e-30  # of the trace, squared: what may be left beside the diagonal


@compiled
def times(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the product of two matrices."""
    out = np.zeros((one.shape[0], other.shape[1]))
    for i in range(one.shape[0]):
        for k in range(one.shape[1]):
            if one[i, k] != 0.0:
                for j in range(other.shape[1]):
                    out[i, j] += one[i, k] * other[k, j]
    return out


def folded_products(one: FloatArray, products: FloatArray, other: FloatArray) -> FloatArray:
    """Return ``one`` · ``products`` · ``other``ᵀ."""
    return times(times(one, products), np.ascontiguousarray(other.T))


@compiled
def add_products(
    features: FloatArray,
    signals: FloatArray,
    weights: FloatArray,
    sure: float,
    gram: FloatArray,
    cross: FloatArray,
    square: FloatArray,
) -> float:
    """Add the products of blocks, each by what it counts for; return what they count in all.

    ``features``: (blocks, features), ``signals``: (blocks, channels), cm. A block counts for
    1 / (``sure`` + m²), m² the mean square of what ``weights`` (features, channels) miss, cm².
    ``gram``: (features, features), its upper half; ``cross``: (features, channels);
    ``square``: (channels, channels).
    """
    count, channels = weights.shape
    missed = np.empty(channels)
    total = 0.0
    for block in range(len(features)):
        x, y = features[block], signals[block]
        missed[:] = y
        for f in range(count):
            if x[f] != 0.0:
                for c in range(channels):
                    missed[c] -= x[f] * weights[f, c]
        off = 0.0
        for c in range(channels):
            off += missed[c] * missed[c]
        counts = 1.0 / (sure + off / channels)
        total += counts
        for f in range(count):
            heavy = counts * x[f]
            if heavy != 0.0:
                for g in range(f, count):
                    gram[f, g] += heavy * x[g]
                for c in range(channels):
                    cross[f, c] += heavy * y[c]
        for c in range(channels):
            heavy = counts * y[c]
            if heavy != 0.0:
                for d in range(channels):
                    square[c, d] += heavy * y[d]
    return total


@compiled
def solved(normal: FloatArray, target: FloatArray, ridge: float) -> FloatArray:
    """Return X of ``normal`` X = ``target`` (Cholesky), (rows, columns).

    ``normal``: positive, with ``ridge`` added to its diagonal, so that no pivot is smaller. One
    that is has lost its digits: that row says what others said before, and gets zeros.
    """
    size, columns = target.shape
    lower = np.zeros((size, size))
    out = np.zeros((size, columns))
    for i in range(size):
        for j in range(i):
            if lower[j, j] > 0.0:
                rest = normal[i, j]
                for k in range(j):
                    rest -= lower[i, k] * lower[j, k]
                lower[i, j] = rest / lower[j, j]
        pivot = normal[i, i]
        for k in range(i):
            pivot -= lower[i, k] * lower[i, k]
        if pivot < 0.5 * ridge:
            lower[i, :i] = 0.0
            continue
        lower[i, i] = math.sqrt(pivot)
        out[i] = target[i]
        for k in range(i):
            for c in range(columns):
                out[i, c] -= lower[i, k] * out[k, c]
        for c in range(columns):
            out[i, c] /= lower[i, i]
    for i in range(size - 1, -1, -1):
        if lower[i, i] > 0.0:
            for k in range(i + 1, size):
                for c in range(columns):
                    out[i, c] -= lower[k, i] * out[k, c]
            for c in range(columns):
                out[i, c] /= lower[i, i]
    return out


@compiled
def eigenvectors(symmetric: FloatArray) -> FloatArray:
    """Return the eigenvectors of a symmetric matrix as rows, that of the largest value first.

    Jacobi's rotations, pair after pair. Of equal values the first stays first, so that vectors
    are what they are where values are all zero, too.
    """
    size = len(symmetric)
    left, rows = symmetric.copy(), np.eye(size)
    trace = 0.0
    for p in range(size):
        trace += symmetric[p, p]
    enough = STILL * trace * trace
    for _ in range(SWEEPS):
        beside = 0.0
        for p in range(size):
            for q in range(p + 1, size):
                beside += left[p, q] * left[p, q]
        if beside <= enough:
            break
        for p in range(size):
            for q in range(p + 1, size):
                if left[p, q] != 0.0:
                    _rotate(left, rows, p, q)
    return rows[np.argsort(-np.diag(left), kind="mergesort")]


@compiled
def _rotate(left: FloatArray, rows: FloatArray, p: int, q: int) -> None:
    """Turn two axes so that nothing is left between them."""
    half = (left[q, q] - left[p, p]) / (2.0 * left[p, q])
    tangent = 1.0 / (abs(half) + math.sqrt(half * half + 1.0))
    if half < 0.0:
        tangent = -tangent
    cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    for k in range(len(left)):
        a, b = left[k, p], left[k, q]
        left[k, p], left[k, q] = cosine * a - sine * b, sine * a + cosine * b
    for k in range(len(left)):
        a, b = left[p, k], left[q, k]
        left[p, k], left[q, k] = cosine * a - sine * b, sine * a + cosine * b
        a, b = rows[p, k], rows[q, k]
        rows[p, k], rows[q, k] = cosine * a - sine * b, sine * a + cosine * b
    left[p, q] = left[q, p] = 0.0
