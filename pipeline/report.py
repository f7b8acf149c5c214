"""What an archive job says of itself: while it runs, and when it is done."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from .ledger import Failure


@dataclass(frozen=True)
class Progress:
    """How far a job is: ``stage``, clips done of ``clips``, and bytes in and out so far."""

    stage: str
    done: int
    clips: int
    source_bytes: int = 0
    archived_bytes: int = 0


@dataclass
class Report:
    """What an archive job did.

    ``archive_bytes`` is the whole archive, store and ledgers included. Errors are in
    centimetres over all clips of this job; the mean is weighted by frames. ``seconds``: per
    stage.
    """

    clips: int = 0
    unchanged: int = 0
    failures: list[Failure] = field(default_factory=list)
    frames: int = 0
    source_bytes: int = 0
    float32_bytes: int = 0
    index_bytes: int = 0
    archive_bytes: int = 0
    patterns: int = 0
    segments: int = 0
    matched: int = 0
    max_error: float = 0.0
    mean_error: float = 0.0
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Note how long the block takes, in seconds, as ``stage``."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] = time.perf_counter() - start
