"""The plan of an archive job: a value that says all there is to do, and does nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from ..codec.errors import UsageError
from ..codec.formats.units import parse_units
from ..codec.limits import Bounds
from ..codec.segments import SegmentRules
from .clustering import ClusterRules
from .discover import Source

BATCH_CLIPS = 32
BATCH_BYTES = 16 << 20  # of source files


@dataclass(frozen=True)
class Settings:
    """What a job promises and how it works.

    ``tolerance``: largest error of every clip, centimetres; ``mean_tolerance``: largest mean
    error of every clip, which then takes its place. ``units``: length unit to assume
    for all files (None: as each file says, or estimated). ``seed``: of the random choices
    that clustering by average error makes, and of which clips others are predicted from.
    ``codec``: ``patterns`` writes index files of version 1, ``learned`` of version 2. Raises
    `UsageError`.
    """

    tolerance: float = 0.1
    units: str | None = None
    segments: SegmentRules = field(default_factory=SegmentRules)
    clusters: ClusterRules = field(default_factory=ClusterRules)
    seed: int = 0
    codec: Literal["patterns", "learned"] = "patterns"
    mean_tolerance: float | None = None

    def __post_init__(self) -> None:
        if not 1e-4 <= self.tolerance <= 1000.0:
            raise UsageError(
                f"a tolerance of {self.tolerance:g} cm cannot be kept",
                advice="Choose from 0.001mm to 10m",
            )
        if self.units is not None:
            parse_units(self.units)
        if not 0 <= self.seed < 1 << 32:
            raise UsageError(f"a seed of {self.seed}", advice="Choose from 0 to 4294967295")

    @property
    def bounds(self) -> Bounds:
        """What every clip must keep."""
        if self.mean_tolerance is not None:
            return Bounds(None, self.mean_tolerance)
        return Bounds(self.tolerance)

    def to_record(self) -> dict[str, Any]:
        """Return the settings as JSON-serialisable values."""
        return asdict(self)


@dataclass(frozen=True)
class Plan:
    """One archive job: batches of clips, in the order that decides the archive's bytes.

    How many workers run it, and in which order they finish, is none of the plan's business.
    """

    settings: Settings
    batches: tuple[tuple[Source, ...], ...]

    @property
    def clips(self) -> int:
        """Number of clips to archive."""
        return sum(len(batch) for batch in self.batches)

    @property
    def source_bytes(self) -> int:
        """Size of the files to archive."""
        return sum(source.size for batch in self.batches for source in batch)


def make_plan(sources: Sequence[Source], settings: Settings) -> Plan:
    """Return the plan that archives ``sources``, by name, in batches of about equal work."""
    return Plan(settings, tuple(_batches(sorted(sources))))


def _batches(sources: Sequence[Source]) -> Iterator[tuple[Source, ...]]:
    batch: list[Source] = []
    size = 0
    for source in sources:
        if batch and (len(batch) == BATCH_CLIPS or size + source.size > BATCH_BYTES):
            yield tuple(batch)
            batch, size = [], 0
        batch.append(source)
        size += source.size
    if batch:
        yield tuple(batch)
