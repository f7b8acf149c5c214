"""What the clips of a job leave for one another while they are encoded: decoded motion, on disk."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from ..codec.blocks.motionmodel import model_key
from ..codec.version2.leadfinding import Hint
from ..codec.version2.motionhead import Named
from .assigning import Shown, Wish
from .motion_tasks import Assignment, left_name
from .tasks import Prepared


class Relay:
    """The clips that a job's clips are predicted from, as they become ready.

    ``levels``: the wishes of the job; ``ready``: earlier clips, and images of such, that are in
    ``scratch`` already.
    """

    def __init__(
        self, scratch: Path, levels: Sequence[Sequence[Wish]], ready: Collection[Named]
    ) -> None:
        self._scratch = scratch
        self._wanted = {shown for level in levels for wish in level for shown in wish.references}
        self._ready = {*ready}
        self._numbers: dict[str, int] = {}

    def assignment(self, wish: Wish, item: Prepared) -> Assignment:
        """Return what is to be done to get a clip encoded, with what is ready of its wishes."""
        known = {shown: named for shown in wish.references if (named := self._named(shown))}
        order = sorted(known.values())
        likes = [(Shown(copy.original, copy.mirrored), copy) for copy in wish.copies]
        hints = tuple(
            Hint(order.index(known[shown]), copy.shift, copy.stride)
            for shown, copy in likes
            if shown in known
        )
        left, image = (
            _left_before(item, mirrored) if Shown(wish.name, mirrored) in self._wanted else None
            for mirrored in (False, True)
        )
        references = tuple((named, left_name(named)) for named in order)
        return Assignment(item, model_key(item.rig), references, left, image, hints)

    def number(self, item: Prepared, number: int) -> None:
        """Give an encoded clip its number, and with it what it has left for others."""
        self._numbers[item.source.name] = number
        for named in (Named(number), Named(number, True)):
            left = self._scratch / _left_before(item, named.mirrored)
            if left.exists():
                left.replace(self._scratch / left_name(named))
                self._ready.add(named)

    def _named(self, shown: Shown) -> Named | None:
        """Return how a head names a clip or its image, or None if that is not ready."""
        number = self._numbers.get(shown.clip) if isinstance(shown.clip, str) else shown.clip
        named = None if number is None else Named(number, shown.mirrored)
        return named if named in self._ready else None


def _left_before(item: Prepared, mirrored: bool) -> str:
    """Return under which name a clip leaves itself, or its image, before it has a number."""
    return f"{item.digest}-{item.rig_number}{'-image' * mirrored}.npz"
