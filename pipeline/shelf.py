"""Decoding index files of version 2 of an open archive, with the clips that they refer to.

A clip decodes after the clips that it is predicted from, and those after theirs: a few levels.
What was decoded for others is kept, so that a second clip like the first costs little more.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import NamedTuple, TypeAlias

from ..codec.blocks.mirrored import mirrored
from ..codec.blocks.motionmodel import MotionModel, fixed_model, model_key, usual_span
from ..codec.blocks.offered import Reference, reference_of
from ..codec.clip import Clip
from ..codec.errors import DamagedError
from ..codec.figure.mirror import image_parts
from ..codec.figure.rig import Rig
from ..codec.version2.motiondecode import Decoded, decode_motion, decode_states, parts_read
from ..codec.version2.motionfile import MotionFile
from ..codec.version2.motionhead import Named, read_references
from .indexreader import read_index
from .layout import index_path
from .ledger import Ledger
from .store import Store

KEPT_BYTES = 192 << 20  # of decoded clips that others refer to
DEEPEST = 16


Parts: TypeAlias = frozenset[int] | None
"""Numbers of the body parts that are decoded; None means all."""


class Found(NamedTuple):
    """A clip of an archive: its index file, its rig, and where the file is."""

    file: MotionFile
    rig: Rig
    path: Path


class Shelf:
    """The decoded clips of an archive that others refer to, made when first asked for.

    ``find``: returns a clip by its number, read piecewise or not (see `unpack_motion`). Safe to
    use from several threads.
    """

    def __init__(self, store: Store, find: Callable[[int, bool], Found]) -> None:
        self._store = store
        self._find = find
        self._kept: OrderedDict[tuple[Named, str, int, Parts], Reference] = OrderedDict()
        self._depths: dict[int, int] = {}
        self._held = 0
        self._lock = threading.RLock()

    @classmethod
    def of(cls, archive: Path, store: Store, ledgers: Mapping[int, Ledger]) -> Shelf:
        """Return the shelf of an archive folder."""
        rows = [row for _, ledger in sorted(ledgers.items()) for row in ledger.rows]

        def find(number: int, piecewise: bool) -> Found:
            if number >= len(rows):
                raise DamagedError(f"refers to clip {number} of {len(rows)}")
            row = rows[number]
            path = index_path(archive, row.index)
            file = read_index(path, piecewise=piecewise)
            if not isinstance(file, MotionFile):
                raise DamagedError(f"refers to {row.name}, an index file of version 1")
            return Found(file, store.rigs[row.rig], path)

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
        parts: Collection[int] | None = None,
    ) -> Clip:
        """Return the clip of an index file; see `decode_motion`.

        ``parts``: numbers of the body parts that are wanted, and of those above them; of others,
        here and in the references, as little is read and decoded as the files allow. Raises
        `DamagedError`.
        """
        model = self.model(rig, file.generation)
        family = self._store.families[rig.family_key]
        read = parts_read(file, rig, family, model, parts, core_only)
        references = self._references(file, rig, file.generation, 0, read)
        return decode_motion(
            *(file, rig, family, model, references),
            core_only=core_only,
            start=start,
            stop=stop,
            parts=read,
        )

    def states(self, file: MotionFile, rig: Rig) -> Decoded:
        """Return an index file decoded in whole numbers. Raises `DamagedError`."""
        model, family = self.model(rig, file.generation), self._store.families[rig.family_key]
        references = self._references(file, rig, file.generation, 0, None)
        return decode_states(file, rig, family, model, references)

    def depth(self, file: MotionFile) -> int:
        """Return how many levels of clips must be decoded before a file. Raises `DamagedError`."""
        return self._depth(file, 0)

    def _depth(self, file: MotionFile, above: int) -> int:
        if above > DEEPEST:
            raise DamagedError("its references go in a circle")
        deepest = 0
        for number, _ in read_references(file):
            if number not in self._depths:
                self._depths[number] = self._depth(self._find(number, True).file, above + 1)
            deepest = max(deepest, self._depths[number] + 1)
        return deepest

    def _references(
        self, file: MotionFile, rig: Rig, generation: int, depth: int, parts: Parts
    ) -> list[Reference]:
        """Return what some parts of a file refer to, as a model of ``generation`` sees it."""
        if depth > DEEPEST:
            raise DamagedError("its references go in a circle")
        named = read_references(file)
        return [self._reference(each, rig, generation, depth, parts) for each in named]

    def _reference(
        self, named: Named, rig: Rig, generation: int, depth: int, parts: Parts
    ) -> Reference:
        for key in ((named, model_key(rig), generation, held) for held in (None, parts)):
            with self._lock:
                if key in self._kept:
                    self._kept.move_to_end(key)
                    return self._kept[key]
        found = self._find(named.number, parts is not None)
        if model_key(found.rig) != model_key(rig):
            raise DamagedError(f"refers to clip {named.number}, which has another kind of rig")
        family = self._store.families[rig.family_key]
        if named.mirrored and not family.mirror:
            raise DamagedError(f"refers to clip {named.number} in a mirror: its rig has no image")
        wanted = parts
        if named.mirrored and parts is not None:
            wanted = image_parts(family.mirror, rig.parts, parts)
        try:
            decoded, whole = self._read(found, depth + 1, wanted)
        except DamagedError as problem:
            raise problem.within(found.path) from problem
        states, nodes = decoded.states, decoded.nodes
        if named.mirrored:
            head = decoded.head
            image = mirrored(states, nodes, found.rig, family, head.still, head.sliding)
            if image is None:
                raise DamagedError(f"refers to clip {named.number} in a mirror: it has no image")
            states, nodes = image
        made = reference_of(states, nodes, self.model(rig, generation))
        key = (named, model_key(rig), generation, None if whole else parts)
        with self._lock:
            if key in self._kept:  # another thread was quicker
                return self._kept[key]
            self._kept[key] = made
            self._held += made.size
            while len(self._kept) > 1 and self._held > KEPT_BYTES:
                self._held -= self._kept.popitem(last=False)[1].size
        return made

    def _read(self, found: Found, depth: int, parts: Parts) -> tuple[Decoded, bool]:
        """Return a clip decoded for some parts, and whether it was decoded whole."""
        file, rig, _ = found
        model, family = self.model(rig, file.generation), self._store.families[rig.family_key]
        read = parts_read(file, rig, family, model, parts)
        references = self._references(file, rig, file.generation, depth, read)
        return decode_states(file, rig, family, model, references, parts=read), read is None
