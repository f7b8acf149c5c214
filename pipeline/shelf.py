"""Decoding index files of version 2 of an open archive, with the clips that they refer to.

A clip decodes after the clips that it is predicted from, and those after theirs: a few levels.
What was decoded is kept for a while, for others that are like it, or like its mirror image, and
for who asks for the clip itself.
"""

from __future__ import annotations

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
from ..codec.version2.motiondecode import (
    Decoded,
    decode_motion,
    decode_states,
    decoded_clip,
    parts_read,
)
from ..codec.version2.motionfile import MotionFile
from ..codec.version2.motionhead import Named, read_references
from .indexreader import read_index
from .kept import Kept
from .layout import index_path
from .ledger import Ledger
from .store import Store

REFERENCE_BYTES = 192 << 20  # of what decoded clips offer to others
DECODED_BYTES = 128 << 20  # of decoded clips themselves
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
        self._offered: Kept[tuple[Named, str, int, Parts], Reference] = Kept(REFERENCE_BYTES)
        self._decoded: Kept[tuple[Path, Parts], Decoded] = Kept(DECODED_BYTES)
        self._depths: dict[int, int] = {}

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
        found: Found,
        *,
        core_only: bool = False,
        start: int = 0,
        stop: int | None = None,
        parts: Collection[int] | None = None,
    ) -> Clip:
        """Return a clip from its index file; see `decode_states`.

        ``parts``: numbers of the body parts that are wanted, and of those above them; of others,
        here and in the references, as little is read and decoded as the files allow. Raises
        `DamagedError`.
        """
        file, rig, _ = found
        model, family = self.model(rig, file.generation), self._store.families[rig.family_key]
        read = parts_read(file, rig, family, model, parts, core_only)
        if not core_only and (start, stop) in ((0, None), (0, file.frames)):
            return decoded_clip(self._states(found, 0, read), rig)
        references = self._references(file, rig, file.generation, 0, read)
        return decode_motion(
            *(file, rig, family, model, references),
            core_only=core_only,
            start=start,
            stop=stop,
            parts=read,
        )

    def states(self, found: Found) -> Decoded:
        """Return a clip decoded in whole numbers. Raises `DamagedError`."""
        return self._states(found, 0, None)

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
        keys = [(named, model_key(rig), generation, held) for held in (None, parts)]
        known = self._offered.get(*keys)
        if known is not None:
            return known
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
            model = self.model(found.rig, found.file.generation)
            read = parts_read(found.file, found.rig, family, model, wanted)
            decoded = self._states(found, depth + 1, read)
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
        return self._offered.keep(keys[0] if read is None else keys[1], made, made.size)

    def _states(self, found: Found, depth: int, read: Parts) -> Decoded:
        """Return a clip decoded for the parts that `parts_read` names."""
        file, rig, path = found
        known = self._decoded.get((path, None), (path, read))
        if known is not None:
            return known
        model, family = self.model(rig, file.generation), self._store.families[rig.family_key]
        references = self._references(file, rig, file.generation, depth, read)
        decoded = decode_states(file, rig, family, model, references, parts=read)
        return self._decoded.keep((path, read), decoded, decoded.size)
