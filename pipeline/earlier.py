"""Clips of earlier jobs that new ones may be predicted from, decoded when they are wished for."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from ..codec.blocks.motionmodel import MotionModel, model_key
from ..codec.version2.motionhead import Named
from .archive import Archive
from .executors import Executor, map_batches
from .motion_tasks import DEEPEST_REFERENCE, Recalled, recall_batch
from .plan import BATCH_CLIPS
from .traits import Traits, read_traits

MOST_KNOWN = 20_000  # clips of one kind of rig that new ones are compared with
MOST_DECODED = 512  # of those of which nothing was kept


class EarlierClips:
    """The clips of an archive before a job.

    ``models``: by key, those that the new clips are coded with. ``depths``: of clips that may be
    referred to, by number. ``ready``: those, and images of those, that were decoded and left for
    the workers in ``scratch``.
    """

    def __init__(
        self,
        engine: Executor,
        archive: Archive | None,
        models: Mapping[str, MotionModel],
        scratch: Path,
    ) -> None:
        self._engine, self._archive, self._models = engine, archive, models
        self._scratch = scratch
        self._kept = read_traits(archive) if archive else {}
        self.depths = {
            number: trait.depth
            for number, trait in self._kept.items()
            if trait.depth < DEEPEST_REFERENCE
        }
        self.ready: set[Named] = set()

    def traits(self, key: str) -> Traits[int]:
        """Return what is known of clips of one kind of rig.

        Clips of which nothing was kept are decoded, evenly chosen ones if there are many.
        """
        if self._archive is None:
            return Traits({}, {})
        keys = {number: model_key(rig) for number, rig in enumerate(self._archive.store.rigs)}
        own = [n for n, row in enumerate(self._archive.numbered) if keys[row.rig] == key]
        known = _thinned([number for number in own if number in self.depths], MOST_KNOWN)
        unknown = _thinned([number for number in own if number not in self._kept], MOST_DECODED)
        made = self._decoded(key, [Named(number) for number in unknown])
        kept = self._kept
        return Traits(
            {**{number: kept[number].sketch for number in known}, **made.clips},
            {**{number: kept[number].landmarks for number in known}, **made.landmarks},
        )

    def recall(self, key: str, wanted: Collection[Named]) -> None:
        """Decode clips for the workers; ``ready`` says which could be."""
        self._decoded(key, sorted(set(wanted) - self.ready))

    def _decoded(self, key: str, wanted: Sequence[Named]) -> Recalled:
        made = Recalled()
        batches = [
            tuple(wanted[at : at + BATCH_CLIPS]) for at in range(0, len(wanted), BATCH_CLIPS)
        ]
        known = (self._archive, {key: self._models[key]}, str(self._scratch))
        for _, result in map_batches(self._engine, recall_batch, batches, *known, lost=_none):
            made.clips.update(result.clips)
            made.landmarks.update(result.landmarks)
            made.depths.update(result.depths)
            self.ready.update(result.ready)
        self.depths.update(made.depths)
        return made


def _thinned(numbers: Sequence[int], most: int) -> Sequence[int]:
    return numbers[:: -(-len(numbers) // most)] if numbers else numbers


def _none(wanted: Sequence[Named]) -> Recalled:
    del wanted
    return Recalled()
