"""Which clip refers to which, and who is encoded before whom: the plan of a job's encoding."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

from .copies import Copy, after_originals, find_copies
from .references import ReferenceFinder, levels_of
from .traits import Traits

Clip: TypeAlias = str | int
"""A clip of this job by its name, of an earlier one by its number."""


class Shown(NamedTuple):
    """A clip, or its mirror image."""

    clip: Clip
    mirrored: bool


class Wish(NamedTuple):
    """A clip with those that it is to refer to, and what it may be a copy of."""

    name: str
    references: list[Shown]
    copies: list[Copy[Clip]]


def assigned(
    own: Traits[str], images: Traits[str], earlier: Traits[int], most: int, seed: int
) -> list[list[Wish]]:
    """Return, per level, clips with those that they refer to: of lower levels, or ``earlier``.

    All are of one model key. A clip has ``most`` references, originals of which it may be a copy
    first. ``images``: of the clips' mirror images, as far as they have one.
    """
    names = [*own.sketches]
    copies = _copies(own, images, earlier) if most else {name: [] for name in names}
    originals = {
        name: [Shown(each.original, each.mirrored) for each in copies[name]] for name in names
    }
    drawn = levels_of(len(names), seed).tolist()
    above = {name: [each.clip for each in originals[name]] for name in names}
    level = after_originals(dict(zip(names, drawn, strict=True)), above)
    finder = ReferenceFinder(most)
    order: list[Clip] = [*earlier.sketches]
    finder.add([*earlier.sketches.values()])
    levels = []
    for number in range(max(level.values(), default=-1) + 1):
        members = [name for name in names if level[name] == number]
        wishes = []
        for name in members:
            found = finder.find(own.sketches[name], images.sketches.get(name))
            chosen = [Shown(order[each.number], each.mirrored) for each in found]
            first = [
                each
                for each in originals[name]
                if isinstance(each.clip, int) or level[each.clip] < number
            ]
            others = [each for each in chosen if each not in first]
            wishes.append(Wish(name, [*first, *others][:most], copies[name]))
        levels.append(wishes)
        imaged = [name in images.sketches for name in members]
        finder.add([own.sketches[name] for name in members], imaged)
        order += members
    return levels


def _copies(
    own: Traits[str], images: Traits[str], earlier: Traits[int]
) -> dict[str, list[Copy[Clip]]]:
    """Return what each clip may be a copy of."""
    names, before = [*own.landmarks], [*earlier.landmarks]
    order: list[Clip] = [*before, *names]
    known = [*earlier.landmarks.values(), *own.landmarks.values()]
    mirrored = [images.landmarks.get(name) for name in names]
    found = find_copies(known, len(before), mirrored)[len(before) :]
    return {
        name: [Copy(order[each.original], *each[1:]) for each in copies]
        for name, copies in zip(names, found, strict=True)
    }
