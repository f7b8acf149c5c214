"""What motifold is to reach, and how a figure says whether it does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

# bytes over ACL's, by ACL's precision as its figures write it (centimetres)
QUICK_CODERS = {"0.01": 0.52, "0.1": 0.37, "1.0": 0.21}
"""Best quick coder with context mixing, Bandai, mean joint error matched: a peer, no target."""

ACL: Mapping[tuple[str, str], Mapping[str, float]] = {
    ("bandai", "mean"): {"0.01": 0.42, "0.1": 0.27, "1.0": 0.11},
    ("bandai", "max"): {"0.01": 0.36, "0.1": 0.33, "1.0": 0.15},
    ("cmu", "mean"): {"0.01": 0.45, "0.1": 0.32, "1.0": 0.16},
}
"""By set and by the error that is matched."""

SZ3: Mapping[tuple[str, float], float] = {("bandai", 0.1): 0.55, ("bandai", 1.0): 0.40}
"""Bytes over SZ3's, at most; by set and tolerance, centimetres."""

GROWTH_CLIPS = 24, 2400
GROWTH = {0.1: 1.5, 0.5: 1.5}
"""Ratio of the large library over that of the small one, at least; by tolerance, centimetres."""


@dataclass(frozen=True)
class Figure:
    """A measured ``value`` beside its ``target`` (None: it has none).

    ``whole``: measured on all that the target is about; a sample is not judged by it.
    """

    what: str
    value: float
    target: float | None
    whole: bool
    at_least: bool = False

    @property
    def judged(self) -> bool:
        """Whether it is known if the target is met."""
        return self.target is not None and self.whole

    @property
    def missed(self) -> bool:
        """Whether the target is known to be missed."""
        if self.target is None or not self.whole:
            return False
        return self.value < self.target if self.at_least else self.value > self.target

    @property
    def cell(self) -> str:
        """The value as a table shows it."""
        if self.target is None:
            return f"{self.value:.3f}"
        if not self.whole:
            return f"{self.value:.3f} (sample; target {self.target:.2f})"
        value = f"{self.value:.3f} (target {self.target:.2f}"
        return f"{value}, **missed**)" if self.missed else f"{value}, met)"
