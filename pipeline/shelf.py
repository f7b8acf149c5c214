"""Decoding index files of version 2 of an open archive, with the clips that they refer to.

A clip decodes after the clips that it is predicted from, and those after theirs: a few levels.
What was decoded for others is kept, so that a second clip like the first costs little more.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path

from ..codec.blocks.motionmodel import MotionModel, fixed_model, model_key, usual_span
from ..codec.blocks.offered import Reference, reference_of
from ..codec.clip import Clip
from ..codec.errors import DamagedError
from ..codec.figure.rig import Rig
from ..codec.version2.motiondecode import Decoded, decode_motion, decode_states
from ..codec.version2.motionfile import MotionFile
from ..codec.version2.motionhead import read_references
from .indexreader import read_index
from .layout import index_path
from .ledger import Ledger
from .store import Store

KEPT_BYTES = 192 << 20  # of decoded clips that others refer to
DEEPEST = 16


class Shelf:
    """The decoded clips of an archive that others refer to, made when first asked for.

    ``find``: returns the index file and the rig of a clip number. Safe to use from several
    threads.
    """

    def __init__(self, store: Store, find: Callable[[int], tuple[MotionFile, Rig]]) -> None:
        self._store = store
        self._find = find
        self._kept: OrderedDict[tuple[int, str, int], Reference] = OrderedDict()
        self._depths: dict[int, int] = {}
        self._held = 0
        self._lock = threading.RLock()

    @classmethod
    def of(cls, archive: Path, store: Store, ledgers: Mapping[int, Ledger]) -> Shelf:
        """Return the shelf of an archive folder."""
        rows = [row for _, ledger in sorted(ledgers.items()) for row in ledger.rows]

        def find(number: int) -> tuple[MotionFile, Rig]:
            if number >= len(rows):
                raise DamagedError(f"refers to clip {number} of {len(rows)}")
            row = rows[number]
            file = read_index(index_path(archive, row.index))
            if not isinstance(file, MotionFile):
                raise DamagedError(f"refers to {row.name}, an index file of version 1")
            return file, store.rigs[row.rig]

        return cls(store, find)

    def model(self, rig: Rig, generation: int) -> MotionModel:
        """Return the model that a rig's clips are coded with. Raises `DamagedError`."""
        if generation == 0:
            hinged = self._store.families[rig.family_key].hinged
            span = usual_span(rig.frame_time)
            return fixed_model(2 * rig.skeleton.joints, span, hinged=hinged)
        model = self._store.models.get((model_key(rig), generation))
        if model is None:
            raise DamagedError(f"generation {generation} has no motion model for its rig")
        if model.rows != 2 * rig.skeleton.joints:
            raise DamagedError(f"generation {generation} has the motion model of another rig")
        return model

    def decode(
        self,
        file: MotionFile,
        rig: Rig,
        *,
        core_only: bool = False,
        start: int = 0,
        stop: int | None = None,
    ) -> Clip:
        """Return the clip of an index file; see `decode_motion`. Raises `DamagedError`."""
        model = self.model(rig, file.generation)
        references = self._references(file, rig, file.generation, 0)
        family = self._store.families[rig.family_key]
        return decode_motion(
            file, rig, family, model, references, core_only=core_only, start=start, stop=stop
        )

    def states(self, file: MotionFile, rig: Rig) -> Decoded:
        """Return an index file decoded in whole numbers. Raises `DamagedError`."""
        model, family = self.model(rig, file.generation), self._store.families[rig.family_key]
        references = self._references(file, rig, file.generation, 0)
        return decode_states(file, rig, family, model, references)

    def depth(self, file: MotionFile) -> int:
        """Return how many levels of clips must be decoded before a file. Raises `DamagedError`."""
        return self._depth(file, 0)

    def _depth(self, file: MotionFile, above: int) -> int:
        if above > DEEPEST:
            raise DamagedError("its references go in a circle")
        deepest = 0
        for number in read_references(file.cores[0]):
            if number not in self._depths:
                self._depths[number] = self._depth(self._find(number)[0], above + 1)
            deepest = max(deepest, self._depths[number] + 1)
        return deepest

    def _references(
        self, file: MotionFile, rig: Rig, generation: int, depth: int
    ) -> list[Reference]:
        """Return what a file refers to, as a model of ``generation`` sees it."""
        if depth > DEEPEST:
            raise DamagedError("its references go in a circle")
        numbers = read_references(file.cores[0])
        return [self._reference(number, rig, generation, depth) for number in numbers]

    def _reference(self, number: int, rig: Rig, generation: int, depth: int) -> Reference:
        key = (number, model_key(rig), generation)
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        file, own_rig = self._find(number)
        if model_key(own_rig) != model_key(rig):
            raise DamagedError(f"refers to clip {number}, which has another kind of rig")
        family = self._store.families[rig.family_key]
        decoded = decode_states(
            file,
            own_rig,
            family,
            self.model(own_rig, file.generation),
            self._references(file, own_rig, file.generation, depth + 1),
        )
        made = reference_of(decoded.states, decoded.nodes, self.model(rig, generation))
        with self._lock:
            if key in self._kept:  # another thread was quicker
                return self._kept[key]
            self._kept[key] = made
            self._held += made.size
            while len(self._kept) > 1 and self._held > KEPT_BYTES:
                self._held -= self._kept.popitem(last=False)[1].size
        return made
