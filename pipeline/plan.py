"""The plan of an archive job: a value that says all there is to do, and does nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from ..codec.errors import UsageError
from ..codec.formats.units import parse_units
from ..codec.geometry.limits import Bounds
from ..codec.patterns.segments import SegmentRules
from ..codec.version2.motionhead import MOST_REFERENCES
from .clustering import ClusterRules
from .discover import Source

BATCH_CLIPS = 32
BATCH_BYTES = 16 << 20  # of source files
LEARNED = ("basis", "parents", "contexts")  # what a learned model can do without


@dataclass(frozen=True)
class Settings:
    """What a job promises and how it works.

    ``tolerance``: largest error of every clip, ``mean_tolerance``: largest mean error of every
    clip, ``joint_tolerances`` and ``span_tolerances``: see `limits.Bounds`; centimetres.
    ``units``: length unit to assume for all files (None: as each says, or estimated).
    ``seed``: of the random choices that clustering by average error makes, and of which clips
    others are predicted from. ``codec``: ``patterns`` writes index files of version 1,
    ``learned`` of version 2, in which a clip is predicted from up to ``references`` others
    with a ``model`` that is learned where that saves bytes, learned but for the prediction
    (``basis``), or ``fixed``. ``without`` leaves ideas out, to measure what they are worth:
    ``basis``, ``parents`` and ``contexts`` of what is learned (see `learning.learn`), and
    ``world``: joints are coded as the joints above them see them, ``mirrors``: no clip is predicted
    from the mirror image of another. ``streams``: ``runs``, one
    stream of the body for every 1,024 frames, or ``parts``, one for each body part of these, so
    that a part decodes without the others. Raises `UsageError`.
    """

    tolerance: float = 0.1
    units: str | None = None
    segments: SegmentRules = field(default_factory=SegmentRules)
    clusters: ClusterRules = field(default_factory=ClusterRules)
    seed: int = 0
    codec: Literal["patterns", "learned"] = "learned"
    mean_tolerance: float | None = None
    joint_tolerances: tuple[tuple[str, float], ...] = ()
    span_tolerances: tuple[tuple[float, float, float], ...] = ()
    references: int = 4
    model: Literal["learned", "basis", "fixed"] = "learned"
    without: tuple[str, ...] = ()
    streams: Literal["runs", "parts"] = "runs"

    def __post_init__(self) -> None:
        if not 1e-4 <= self.tolerance <= 1000.0:
            raise UsageError(
                f"a tolerance of {self.tolerance:g} cm cannot be kept",
                advice="Choose from 0.001mm to 10m",
            )
        for value in (self.mean_tolerance, *(bound[-1] for bound in self._local)):
            if value is not None and not 1e-4 <= value <= 1000.0:
                raise UsageError(
                    f"a bound of {value:g} cm cannot be kept", advice="Choose from 0.001mm to 10m"
                )
        if self.codec not in ("patterns", "learned"):
            raise UsageError(f"unknown codec {self.codec!r}", advice="Use learned or patterns")
        if self.model not in ("learned", "basis", "fixed"):
            raise UsageError(f"unknown model {self.model!r}", advice="Use learned, basis or fixed")
        if self.streams not in ("runs", "parts"):
            raise UsageError(f"no streams are called {self.streams!r}", advice="Use runs or parts")
        if self.codec == "patterns" and self.streams != "runs":
            raise UsageError("the codec of version 1 has no streams per body part")
        for name in self.without:
            if name not in (*LEARNED, "world", "mirrors"):
                advice = f"Use {', '.join(LEARNED)}, world or mirrors"
                raise UsageError(f"nothing is called {name!r}", advice=advice)
            if name in LEARNED and self.model != "learned":
                raise UsageError(f"only a learned model can do without {name}")
        if not 0 <= self.references <= MOST_REFERENCES:
            raise UsageError(
                f"{self.references} references", advice=f"Choose from 0 to {MOST_REFERENCES}"
            )
        if self.codec == "patterns" and (self.mean_tolerance is not None or self._local):
            raise UsageError("the codec of version 1 bounds the largest error only")
        if self.units is not None:
            parse_units(self.units)
        if not 0 <= self.seed < 1 << 32:
            raise UsageError(f"a seed of {self.seed}", advice="Choose from 0 to 4294967295")

    @property
    def _local(self) -> tuple[tuple[Any, ...], ...]:
        return (*self.joint_tolerances, *self.span_tolerances)

    @property
    def bounds(self) -> Bounds:
        """What every clip must keep."""
        return Bounds(
            self.tolerance, self.mean_tolerance, self.joint_tolerances, self.span_tolerances
        )

    def covers(self, other: dict[str, Any]) -> bool:
        """Return whether clips archived under the settings ``other`` are good enough for these."""
        mean = other.get("mean_tolerance")
        return bool(
            other["tolerance"] <= self.tolerance
            and other["units"] == self.units
            and (self.mean_tolerance is None or (mean is not None and mean <= self.mean_tolerance))
            and _pairs(other.get("joint_tolerances", ())) == _pairs(self.joint_tolerances)
            and _pairs(other.get("span_tolerances", ())) == _pairs(self.span_tolerances)
        )

    def to_record(self) -> dict[str, Any]:
        """Return the settings as JSON-serialisable values."""
        record = asdict(self)
        for name in ("joint_tolerances", "span_tolerances"):
            record[name] = [list(bound) for bound in record[name]]
        record["without"] = list(self.without)
        if self.streams == "runs":
            del record["streams"]  # the ledgers of earlier motifolds have no such word
        return record


def _pairs(values: Sequence[Sequence[Any]]) -> list[tuple[Any, ...]]:
    return [tuple(value) for value in values]


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
