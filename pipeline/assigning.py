"""Which clip refers to which, and who is encoded before whom: the plan of a job's encoding."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from .copies import Copy, after_originals, find_copies
from .references import ReferenceFinder, levels_of
from .traits import Traits

Clip: TypeAlias = str | int
"""A clip of this job by its name, of an earlier one by its number."""


class Wish(NamedTuple):
    """A clip with those that it is to refer to, and what it may be a copy of."""

    name: str
    references: list[Clip]
    copies: list[Copy[Clip]]


def assigned(own: Traits[str], earlier: Traits[int], most: int, seed: int) -> list[list[Wish]]:
    """Return, per level, clips with those that they refer to: of lower levels, or ``earlier``.

    All are of one model key. A clip has ``most`` references, originals of which it may be a copy
    first.
    """
    names = [*own.sketches]
    copies = _copies(own, earlier) if most else {name: [] for name in names}
    originals = {name: [each.original for each in copies[name]] for name in names}
    drawn = levels_of(len(names), seed).tolist()
    level = after_originals(dict(zip(names, drawn, strict=True)), originals)
    finder = ReferenceFinder(most)
    order: list[Clip] = [*earlier.sketches]
    finder.add([*earlier.sketches.values()])
    levels = []
    for number in range(max(level.values(), default=-1) + 1):
        members = [name for name in names if level[name] == number]
        wishes = []
        for name in members:
            chosen = [order[candidate] for candidate in finder.find(own.sketches[name])]
            first = [
                each for each in originals[name] if isinstance(each, int) or level[each] < number
            ]
            others = [each for each in chosen if each not in first]
            wishes.append(Wish(name, [*first, *others][:most], copies[name]))
        levels.append(wishes)
        finder.add([own.sketches[name] for name in members])
        order += members
    return levels


def _copies(own: Traits[str], earlier: Traits[int]) -> dict[str, list[Copy[Clip]]]:
    """Return what each clip may be a copy of."""
    names, before = [*own.landmarks], [*earlier.landmarks]
    order: list[Clip] = [*before, *names]
    known = [*earlier.landmarks.values(), *own.landmarks.values()]
    found = find_copies(known, len(before))[len(before) :]
    return {
        name: [Copy(order[each.original], each.shift, each.stride) for each in copies]
        for name, copies in zip(names, found, strict=True)
    }
