"""Numbers as the text formats spell them."""

from __future__ import annotations

import math
import re

LARGEST = 1e9
"""Units or degrees. Beyond it a number is damage, and sums along a chain lose all precision."""

_CUT_SHORT = re.compile(rb"[-+]?\.?|[-+]?[0-9.]+[eE][-+]?")


def usable_number(token: str | bytes) -> float:
    """Return the number that a token spells, NaN where it spells none below `LARGEST`."""
    try:
        number = float(token)
    except ValueError:
        return math.nan
    underscore = b"_" in token if isinstance(token, bytes) else "_" in token
    return number if abs(number) < LARGEST and not underscore else math.nan


def cut_short(token: bytes) -> bool:
    """Say whether a token is the start of a number, as at the end of a truncated file."""
    return _CUT_SHORT.fullmatch(token) is not None
