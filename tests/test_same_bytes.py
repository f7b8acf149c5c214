"""One library, one archive, whatever adds up the numbers: models are learned bit for bit."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from libraries import tree

from motifold.codec.learned.fixedorder import add_products, eigenvectors, solved, times
from motifold.codec.learned.sizefit import fit_sizes
from motifold.pipeline.archive import Archive

MACHINES = {
    "four threads": {"OPENBLAS_NUM_THREADS": "4", "OMP_NUM_THREADS": "4"},
    "old kernels": {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3"},
}


@pytest.mark.parametrize("name", MACHINES)
def test_another_linear_algebra_learns_the_same_model(
    name: str, small_library: Path, small_archive: Path, tmp_path: Path
) -> None:
    with Archive(small_archive) as archive:
        assert archive.store.models  # or there is nothing to see here
    command = "from motifold.workflows.cli import main; main()"
    job = ["archive", str(small_library), str(tmp_path / "archive"), "--workers", "2"]
    subprocess.run(
        [sys.executable, "-W", "ignore", "-c", command, *job, "--no-index"],
        env={**os.environ, **MACHINES[name]},
        check=True,
        capture_output=True,
    )
    found, known = tree(tmp_path / "archive"), tree(small_archive)
    differ = [path for path in known if found.get(path) != known[path]]
    assert not differ


@st.composite
def squares(draw: st.DrawFn) -> np.ndarray:
    """Positive matrices, some of them without full rank."""
    size, rank = draw(st.integers(1, 14)), draw(st.integers(0, 20))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    half = rng.normal(0.0, 1.0, (size, rank)) * 10.0 ** rng.uniform(-3, 3, (size, 1))
    return np.asarray(half @ half.T)


@given(squares())
@settings(max_examples=60)
def test_eigenvectors_are_those_of_lapack(square: np.ndarray) -> None:
    rows = eigenvectors(square)
    size = max(float(np.trace(square)), 1e-12)
    np.testing.assert_allclose(rows @ rows.T, np.eye(len(square)), atol=1e-12)
    values = np.einsum("ki,ij,kj->k", rows, square, rows)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(square)[::-1], atol=1e-12 * size)
    np.testing.assert_allclose(rows @ square, values[:, None] * rows, atol=1e-12 * size)


@given(squares(), st.integers(1, 5))
@settings(max_examples=60)
def test_systems_are_solved(square: np.ndarray, columns: int) -> None:
    usual = np.sqrt(np.diag(square)) + 1e-6
    normal = square / np.outer(usual, usual) + 0.01 * np.eye(len(square))
    wanted = np.random.default_rng(columns).normal(0.0, 1.0, (len(square), columns))
    found = solved(normal, times(normal, wanted), 0.01)
    np.testing.assert_allclose(found, wanted, atol=1e-9)


@given(squares(), st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_systems_that_rounding_has_made_indefinite_have_finite_solutions(
    square: np.ndarray, seed: int
) -> None:
    noise = np.random.default_rng(seed).normal(0.0, 1e-3, square.shape)
    usual = np.sqrt(np.diag(square)) + 1e-6
    normal = square / np.outer(usual, usual) + noise + noise.T + 1e-6 * np.eye(len(square))
    found = solved(normal, np.ones((len(square), 2)), 1e-6)
    assert np.isfinite(found).all()
    kept = found[:, 0] != 0.0
    if np.linalg.eigvalsh(normal)[0] > 1e-4:
        np.testing.assert_allclose(found[:, 0], np.linalg.solve(normal, np.ones(len(normal))))
    else:  # those that were not dropped solve their own system
        left = normal[np.ix_(kept, kept)] @ found[kept, 0] - 1.0
        assert np.abs(left).max(initial=0.0) < 1e-9 * np.abs(found).max(initial=1.0)


def test_products_are_weighted_means() -> None:
    rng = np.random.default_rng(5)
    x, y, weights = (rng.normal(0.0, 1.0, size) for size in ((40, 7), (40, 3), (7, 3)))
    x[:, 2] = 0.0
    gram, cross, square = np.zeros((7, 7)), np.zeros((7, 3)), np.zeros((3, 3))
    total = add_products(x, y, weights, 0.3, gram, cross, square)
    counts = 1.0 / (0.3 + np.square(y - x @ weights).mean(axis=1))
    assert total == pytest.approx(counts.sum())
    np.testing.assert_allclose(gram, np.triu(x.T @ (counts[:, None] * x)), atol=1e-12)
    np.testing.assert_allclose(cross, x.T @ (counts[:, None] * y), atol=1e-12)
    np.testing.assert_allclose(square, y.T @ (counts[:, None] * y), atol=1e-12)


def test_sizes_are_found_that_made_the_numbers() -> None:
    """Numbers drawn from tables that depend on one sign: the fit finds how."""
    rng = np.random.default_rng(3)
    signs = np.zeros((40_000, 10), np.int64)
    signs[:, 0] = rng.integers(-512, 512, len(signs))
    senses, base = 0.5, np.array([2.0, 1.0, 0.0, -1.0, -2.0, 3.0])  # octaves
    mean = np.exp2(base + senses * signs[:, :1] / 256.0)
    theta = (np.sqrt(mean**2 + 1.0) - 1.0) / mean
    draws = rng.geometric(1.0 - theta, (2, *mean.shape)) - 1
    found, sensed = fit_sizes(signs, np.abs(draws[0] - draws[1]))
    np.testing.assert_allclose(found, 256.0 * base, atol=12.0)
    np.testing.assert_allclose(sensed[:, 0], 256.0 * senses, atol=8.0)
    assert np.abs(sensed[:, 1:]).max() == 0
