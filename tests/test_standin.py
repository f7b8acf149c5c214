"""The plain range coder that stands in for constriction on arm64, against constriction."""

from __future__ import annotations

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import constriction
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

_FILE = Path(__file__).parents[1] / "benchmarks/arm64/standin/constriction/__init__.py"
_SPEC = spec_from_file_location("standin", _FILE)
assert _SPEC is not None
assert _SPEC.loader is not None
standin = module_from_spec(_SPEC)
_SPEC.loader.exec_module(standin)

Symbols = list[tuple[list[float] | int, int]]


@st.composite
def symbols(draw: st.DrawFn) -> Symbols:
    """Symbols, each with the probabilities it is coded by, or how many are equally likely."""
    found: Symbols = []
    for _ in range(draw(st.integers(0, 60))):
        if draw(st.booleans()):
            size = draw(st.integers(2, 1 << 16))
            found.append((size, draw(st.sampled_from([0, size - 1, size // 2]))))
        else:
            shares = draw(st.lists(st.floats(1e-9, 1.0), min_size=2, max_size=30))
            found.append((shares, draw(st.integers(0, len(shares) - 1))))
    return found


def coded(coder: Any, symbols: Symbols) -> tuple[np.ndarray, list[int], object]:
    """Return the words that a package writes, what it reads from them, and its last state."""
    models = [
        coder.stream.model.Uniform(shares)
        if isinstance(shares, int)
        else coder.stream.model.Categorical(np.array(shares), perfect=False)
        for shares, _ in symbols
    ]
    encoder = coder.stream.queue.RangeEncoder()
    for model, (_, symbol) in zip(models, symbols, strict=True):
        encoder.encode(symbol, model)
    words = np.asarray(encoder.get_compressed())
    decoder = coder.stream.queue.RangeDecoder(words)
    return words, [int(decoder.decode(model)) for model in models], encoder.pos()


@given(symbols())
def test_it_writes_and_reads_the_same_words(symbols: Symbols) -> None:
    ours, theirs = coded(standin, symbols), coded(constriction, symbols)
    np.testing.assert_array_equal(ours[0], theirs[0])
    assert ours[1] == theirs[1] == [symbol for _, symbol in symbols]
    assert ours[2] == theirs[2]


@given(st.lists(st.integers(0, 4), max_size=300))
def test_arrays_are_symbols_one_after_the_other(symbols: list[int]) -> None:
    shares = np.array([0.6, 0.2, 0.1, 0.05, 0.05])
    words = []
    for coder in (standin, constriction):
        model = coder.stream.model.Categorical(shares, perfect=False)
        encoder = coder.stream.queue.RangeEncoder()
        encoder.encode(np.array(symbols, np.int32), model)
        words.append(np.asarray(encoder.get_compressed()))
        decoder = coder.stream.queue.RangeDecoder(words[0])
        assert decoder.decode(model, len(symbols)).tolist() == symbols
    np.testing.assert_array_equal(words[0], words[1])
