"""Joint roles from the shape of the tree alone, for skeletons whose names say nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np

from ..clip import FloatArray, Skeleton
from .jointnames import Role, Side

Reading: TypeAlias = tuple[Side, Role]

_SIDES: tuple[Side, ...] = ("left", "right")
_LEG: tuple[Role, ...] = ("hip?", "thigh", "shin", "foot", "foot")
_ARM: tuple[Role, ...] = ("shoulder", "upper_arm", "forearm", "hand", "fingers")


def roles_from_shape(skeleton: Skeleton) -> list[Reading] | None:
    """Return side and role per joint, or None where the tree does not look like a body.

    The pelvis is the first joint with three children or more of which two carry trees of the
    same shape (the legs); the chest is the first joint with such a pair (the arms) on the
    largest other branch. One pair alone is legs when it points away from the other branch in
    the rest pose, and arms when it does not. Inside a limb the two consecutive bones that are
    the longest together are thigh and shin, or upper arm and forearm. The sides are told by
    the axis along which the pair lies furthest apart: the positive one is left, as it
    is in a T-pose that faces +Z with Y up; in other rest poses the sides may come out swapped.
    """
    tree = _Tree(skeleton)
    forks = (j for j, children in enumerate(tree.children) if len(children) > 2)
    pelvis = next((joint for joint in forks if tree.pair(joint)), -1)
    if pelvis < 0:
        return None
    legs = tree.pair(pelvis)
    trunk = tree.largest(pelvis, legs)
    chest = next((joint for joint in tree.subtree(trunk) if tree.pair(joint)), -1)
    if chest < 0 and not tree.hangs(pelvis, legs, trunk):
        pelvis, chest, legs = 0, pelvis, ()
    arms = tree.pair(chest) if chest >= 0 else ()

    out: list[Reading] = [("", "")] * skeleton.joints
    for joint in tree.path(chest) if arms else tree.subtree(trunk):
        out[joint] = "", "spine"
    for joint in tree.path(pelvis):
        out[joint] = "", "root"
    neck = tree.largest(chest, arms) if arms else -1
    for joint in tree.subtree(neck) if neck >= 0 else ():
        out[joint] = "", "head"
    apart = tree.rest[(legs or arms)[0]] - tree.rest[(legs or arms)[1]]
    axis = int(np.abs(apart).argmax())
    for pair, roles in ((legs, _LEG), (arms, _ARM)):
        ordered = sorted(pair, key=lambda joint: -tree.rest[joint, axis])
        for joint, side in zip(ordered, _SIDES, strict=False):
            for member, role in tree.limb(joint, roles):
                out[member] = side, role
    return out


class _Tree:
    """A skeleton with, per joint, its rest position, its subtree's size, length and shape."""

    def __init__(self, skeleton: Skeleton) -> None:
        self.parents = [int(parent) for parent in skeleton.parents]
        self.children = skeleton.children()
        self.lengths: FloatArray = np.sqrt((skeleton.offsets**2).sum(axis=1))
        self.rest: FloatArray = np.array(skeleton.offsets, dtype=np.float64)
        for joint in range(1, skeleton.joints):
            self.rest[joint] += self.rest[self.parents[joint]]
        self.spans = self.lengths.tolist()  # all bones of the subtree together
        self.sizes = [1] * skeleton.joints
        self.shapes = [0] * skeleton.joints  # equal numbers mean equal trees
        known: dict[tuple[int, ...], int] = {}
        for joint in range(skeleton.joints - 1, -1, -1):
            shape = tuple(sorted(self.shapes[child] for child in self.children[joint]))
            self.shapes[joint] = known.setdefault(shape, len(known))
            self.spans[joint] += sum(self.spans[child] for child in self.children[joint])
            self.sizes[joint] += sum(self.sizes[child] for child in self.children[joint])

    def subtree(self, joint: int) -> Iterator[int]:
        """Yield a joint and all that hangs on it, parents first."""
        waiting = [joint]
        while waiting:
            joint = waiting.pop()
            yield joint
            waiting += reversed(self.children[joint])

    def path(self, joint: int) -> Iterator[int]:
        """Yield a joint and its ancestors."""
        while joint >= 0:
            yield joint
            joint = self.parents[joint]

    def pair(self, joint: int) -> tuple[int, ...]:
        """Return the two children that mirror each other the best; () without any.

        They carry trees of the same shape, of two joints or more; of several such pairs the
        one whose bones together differ the least in length is taken.
        """
        groups: dict[int, list[int]] = {}
        for child in self.children[joint]:
            if self.sizes[child] > 1:
                groups.setdefault(self.shapes[child], []).append(child)
        pairs = [
            (first, second)
            for group in groups.values()
            for first, second in zip(group, group[1:] + group[:1], strict=True)
            if first != second
        ]
        return min(pairs, key=self._asymmetry, default=())

    def _asymmetry(self, pair: tuple[int, int]) -> float:
        first, second = (self.spans[joint] for joint in pair)
        return float(abs(first - second) / max(first + second, 1e-9))

    def largest(self, joint: int, without: Sequence[int]) -> int:
        """Return the child with the largest subtree, ``without`` left out; -1 for none."""
        rest = [child for child in self.children[joint] if child not in without]
        return max(rest, key=lambda child: self.sizes[child], default=-1)

    def hangs(self, joint: int, pair: Sequence[int], other: int) -> bool:
        """Tell whether a pair of limbs points away from the other branch in the rest pose."""
        tips = [self.rest[list(self.subtree(limb))[-1]] - self.rest[joint] for limb in pair]
        up = self.rest[list(self.subtree(other))[-1]] - self.rest[joint]
        down = -np.add(*tips) / 2
        return bool(down @ up >= 0.5 * np.linalg.norm(tips[0]) * np.linalg.norm(up))

    def limb(self, joint: int, roles: Sequence[Role]) -> Iterator[tuple[int, Role]]:
        """Yield the joints of a limb with their roles: before, upper, lower, end, and beyond."""
        chain = [joint]
        while len(self.children[chain[-1]]) == 1:
            chain += self.children[chain[-1]]
        bones = self.lengths[chain]
        upper = 0
        if len(chain) > 2:  # nearly equal: a clavicle may be as long as a forearm
            pairs = bones[1:-1] + bones[2:]
            upper = int(np.flatnonzero(pairs >= 0.9 * pairs.max())[-1]) if pairs.max() else 0
        for place, member in enumerate(chain):
            yield member, roles[min(max(place - upper, -1), 2) + 1]
        for member in list(self.subtree(chain[-1]))[1:]:
            yield member, roles[4]
