"""Quantiser steps: centimetres on a fine logarithmic ladder of exactly representable numbers."""

from __future__ import annotations

import math

from ..errors import DamagedError

_LEAST = 2.0**-40
_RUNGS = 128  # per octave, evenly spaced inside it: neighbours differ by 0.4 to 0.8 %
CODES = 60 * _RUNGS


def step_of(code: int) -> float:
    """Return the step (centimetres) of a code from 0 to `CODES` - 1: exact on every machine."""
    if not 0 <= code < CODES:
        raise DamagedError(f"quantiser step code {code} is out of range")
    octave, rung = divmod(code, _RUNGS)
    return _LEAST * float(1 << octave) * ((_RUNGS + rung) / _RUNGS)


def code_below(step: float) -> int:
    """Return the code of the largest step that is not larger than ``step`` (centimetres)."""
    mantissa, exponent = math.frexp(min(step, 2.0**20) / _LEAST)  # mantissa in [0.5, 1)
    if exponent < 1:
        return 0
    code = (exponent - 1) * _RUNGS + int((mantissa * 2.0 - 1.0) * _RUNGS)
    return min(code, CODES - 1)
