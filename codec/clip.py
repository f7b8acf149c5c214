"""The values that the codec works on: skeletons, clips of skeletons, clips of markers.

Lengths are centimetres, angles radians, times seconds everywhere inside motifold; readers
convert on the way in and writers on the way out, with the facts in the clip's `Layout`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]

UnitSource = Literal["declared", "estimated", "given"]


@dataclass(frozen=True)
class Repair:
    """One thing that a reader mended or assumed, in words for a person.

    ``place`` says where ("line 140", "byte 512", "marker LFHD"); empty for the whole file.
    """

    what: str
    place: str = ""


@dataclass(frozen=True)
class Layout:
    """How a source file was laid out: all that a writer needs to write it the same way.

    ``format`` is the format's short name (``bvh``, ``amc``, ``c3d``, ``trc``); ``unit`` the
    length unit of the file, ``unit_source`` how it is known, ``centimetres`` the length of one
    unit. ``channels`` holds, per joint, the names of its channels in file order (``Xposition``
    … ``Zrotation``); empty for markers. ``details`` are format-specific texts (for example the
    exact header), kept as given.
    """

    format: str
    unit: str
    unit_source: UnitSource
    centimetres: float
    channels: tuple[tuple[str, ...], ...] = ()
    details: tuple[tuple[str, str], ...] = ()

    def detail(self, key: str, default: str = "") -> str:
        """Return the format-specific text stored under ``key``."""
        return dict(self.details).get(key, default)


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of joints with their rest offsets.

    ``names``: one per joint. ``parents``: (joints,) index of each joint's parent, -1 for the
    root, which is joint 0; a parent always comes before its children. ``offsets``: (joints, 3)
    rest translation from the parent's origin, in the parent's axes, centimetres.
    ``end_parents``: (ends,) the joint that carries each end site (end effector), and
    ``end_offsets``: (ends, 3) where it lies in that joint's axes, centimetres.
    """

    names: tuple[str, ...]
    parents: IntArray
    offsets: FloatArray
    end_parents: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    end_offsets: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.names)

    def children(self) -> list[list[int]]:
        """Return, per joint, the indices of its children in order."""
        found: list[list[int]] = [[] for _ in self.names]
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                found[int(parent)].append(joint)
        return found


@dataclass(frozen=True, eq=False)
class SkeletonClip:
    """One motion of one skeleton.

    ``rotations``: (frames, joints, 3, 3) local rotation matrices, column vectors, so that a
    vector v in the joint's axes is R v in its parent's axes. ``translations``: (frames,
    joints, 3) local translations from the parent's origin in its axes, centimetres; for a joint
    without position channels they are its rest offset in every frame. ``frame_time``: seconds.
    """

    skeleton: Skeleton
    frame_time: float
    rotations: FloatArray
    translations: FloatArray
    layout: Layout
    repairs: tuple[Repair, ...] = ()

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.rotations.shape[0])

    def slice(self, start: int, stop: int) -> SkeletonClip:
        """Return the clip of the frames ``start`` to ``stop`` (exclusive)."""
        return replace(
            self,
            rotations=self.rotations[start:stop],
            translations=self.translations[start:stop],
        )


@dataclass(frozen=True, eq=False)
class MarkerClip:
    """One motion of a set of markers.

    ``positions``: (frames, markers, 3) world positions, centimetres, NaN where a marker was
    not seen (a gap). ``frame_time``: seconds.
    """

    names: tuple[str, ...]
    frame_time: float
    positions: FloatArray
    layout: Layout
    repairs: tuple[Repair, ...] = ()

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.positions.shape[0])

    @property
    def seen(self) -> BoolArray:
        """(frames, markers) True where the marker was seen."""
        return np.asarray(~np.isnan(self.positions).any(axis=2))

    def slice(self, start: int, stop: int) -> MarkerClip:
        """Return the clip of the frames ``start`` to ``stop`` (exclusive)."""
        return replace(self, positions=self.positions[start:stop])


Clip: TypeAlias = SkeletonClip | MarkerClip
