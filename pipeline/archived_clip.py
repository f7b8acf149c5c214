"""One clip of an open archive, which is read and decoded when it is asked for."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, Protocol

from ..codec.clip import Clip, FloatArray, MarkerClip, Repair, Skeleton, SkeletonClip
from ..codec.errors import DamagedError, UsageError
from ..codec.figure.partial import only_parts, with_ancestors
from ..codec.figure.rig import Rig
from ..codec.geometry.kinematics import world_positions, world_rotations
from ..codec.geometry.metrics import Errors
from ..codec.geometry.rotations import to_quaternions
from ..codec.patterns.patterns import Codebook
from ..codec.version1.decode import Tier, decode
from ..codec.version1.index_file import IndexFile
from ..codec.version2.motionfile import MotionFile
from ..codec.version2.motionhead import read_leads, read_references
from .indexreader import read_index
from .layout import index_path
from .ledger import Ledger, Row
from .shelf import Found, Shelf


class Opened(Protocol):
    """What a clip needs of the archive that it is in."""

    path: Path

    @property
    def ledgers(self) -> dict[int, Ledger]:
        """The ledgers of all jobs, by generation."""

    @property
    def rows(self) -> dict[str, tuple[Row, int]]:
        """The current ledger row of every clip with its generation, by name."""

    @property
    def shelf(self) -> Shelf:
        """The decoded clips that others refer to."""

    @property
    def numbered(self) -> list[Row]:
        """The rows of all ledgers: clip numbers are places in it."""

    def codebook(self, family: str, generation: int) -> Codebook:
        """Return a rig family's patterns as of a generation."""

    def rig(self, number: int) -> Rig:
        """Return a rig by its number."""


class Follow(NamedTuple):
    """From ``start`` to ``stop`` a clip goes as ``clip`` does from ``begun`` on; seconds.

    ``moved``: in another place, or facing another way; ``mirrored``: left for right;
    ``replaced``: that clip's file has changed since, and what is meant is the motion that it had.
    """

    clip: str
    begun: float
    start: float
    stop: float
    moved: bool
    mirrored: bool
    replaced: bool


@dataclass(frozen=True, eq=False)
class ArchivedClip:
    """One clip of an open archive. What it holds is read and decoded when it is asked for.

    ``row`` and ``generation``: its ledger row and the job that archived it.
    """

    archive: Opened
    row: Row
    generation: int

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.row.name

    @property
    def frames(self) -> int:
        """Number of frames."""
        return self.row.frames

    @property
    def rig(self) -> Rig:
        """The rig that it was recorded on, with its body parts and file layout."""
        return self.archive.rig(self.row.rig)

    @property
    def skeleton(self) -> Skeleton:
        """The joints, parents and rest offsets (centimetres); of markers, a flat one."""
        return self.rig.skeleton

    @property
    def frame_time(self) -> float:
        """Seconds from one frame to the next."""
        return self.rig.frame_time

    @property
    def seconds(self) -> float:
        """Duration in seconds."""
        return self.frames * self.frame_time

    @property
    def repairs(self) -> tuple[Repair, ...]:
        """What the reader mended or assumed in the source file."""
        return self.row.repairs

    @property
    def tolerance(self) -> float:
        """The largest error, centimetres, that was allowed when it was archived."""
        return float(self.archive.ledgers[self.generation].settings["tolerance"])

    @property
    def largest(self) -> float:
        """The largest error, centimetres, that was allowed to any of its joints."""
        bounds = self.archive.ledgers[self.generation].settings.get("joint_tolerances", ())
        return max(self.tolerance, *(float(tolerance) for _, tolerance in bounds), 0.0)

    @property
    def mean_tolerance(self) -> float | None:
        """The mean error, centimetres, that was allowed when it was archived, or None."""
        mean = self.archive.ledgers[self.generation].settings.get("mean_tolerance")
        return None if mean is None else float(mean)

    @property
    def certificate(self) -> Errors:
        """The errors, centimetres, that the encoder measured by decoding: never understated."""
        return self.index(prefix_only=True).certificate

    @property
    def follows(self) -> list[Follow]:
        """Where it goes as other clips do, because it is a copy of them. Raises `DamagedError`."""
        index = self.index(prefix_only=True)
        if not isinstance(index, MotionFile):
            return []
        try:
            named, leads = read_references(index), read_leads(index)
        except DamagedError as problem:
            raise problem.within(self.path) from problem
        found, rows = [], self.archive.numbered
        for lead in leads:
            number, mirrored = named[lead.reference]
            if number >= len(rows):
                raise DamagedError(f"follows clip {number} of {len(rows)}", file=self.path)
            row = rows[number]
            begun = lead.start * self.archive.rig(row.rig).frame_time
            start, stop = lead.first * self.frame_time, lead.stop * self.frame_time
            replaced = self.archive.rows[row.name][0] is not row
            how = lead.move is not None, mirrored, replaced
            found.append(Follow(row.name, begun, start, stop, *how))
        return found

    @property
    def path(self) -> Path:
        """Where its index file is."""
        return index_path(self.archive.path, self.row.index)

    def index(
        self, *, prefix_only: bool = False, piecewise: bool = False
    ) -> IndexFile | MotionFile:
        """Return the clip's index file, checked; see `read_index`. Raises `DamagedError`."""
        index = read_index(self.path, prefix_only=prefix_only, piecewise=piecewise)
        if index.frames != self.row.frames or index.rig != self.row.rig:
            raise DamagedError("is the index file of another clip", file=self.path)
        return index

    def decode(
        self,
        tier: Tier = "tolerance",
        *,
        parts: Collection[str] | None = None,
        start: int = 0,
        stop: int | None = None,
    ) -> Clip:
        """Return the clip, or the frames ``start`` to ``stop`` (exclusive) of it.

        ``tier``: ``tolerance``, inside the certified error; or ``preview``, which reads only
        the first part of the index file: poses (version 1: patterns) of other clips on the
        exact root path; a clip without references shows itself. ``parts``: names of body
        parts, which come with those above them; the joints of all others are left at rest
        (markers: NaN). Runs of frames outside ``start`` and ``stop`` are not decoded. Where the
        archive has streams per body part (`plan.Settings.streams`), nothing is read or decoded
        of other parts and other runs; so damage there does not hurt. Raises `DamagedError` or
        `UsageError`.
        """
        some = parts is not None or (start, stop) != (0, None)
        index = self.index(prefix_only=tier == "preview", piecewise=some)
        if tier == "preview" and isinstance(index, MotionFile) and not read_references(index):
            # nothing to look like: it shows itself
            index, tier = self.index(piecewise=some), "tolerance"
        try:
            if isinstance(index, MotionFile):
                return self._decoded(index, tier, parts, start, stop)
            codebook = self.archive.codebook(self.rig.family_key, index.generation)
            clip = decode(index, self.rig, codebook, tier=tier, parts=parts)
        except DamagedError as problem:
            raise problem.within(self.path) from problem
        first, last, _ = slice(start, stop).indices(clip.frames)
        return clip if (first, last) == (0, clip.frames) else clip.slice(first, last)

    def _decoded(
        self,
        file: MotionFile,
        tier: Tier,
        parts: Collection[str] | None,
        start: int,
        stop: int | None,
    ) -> Clip:
        first, last, _ = slice(start, stop).indices(file.frames)
        wanted = None
        if parts is not None:
            wanted = with_ancestors(self.rig.parts, self.skeleton, parts)
        clip = self.archive.shelf.decode(
            Found(file, self.rig, self.path),
            core_only=tier == "preview",
            start=first,
            stop=last,
            parts=wanted,
        )
        return only_parts(clip.slice(first, max(first, last)), self.rig, parts)

    @cached_property
    def clip(self) -> Clip:
        """The decoded clip (`SkeletonClip` or `MarkerClip`), kept once it was asked for."""
        return self.decode()

    @property
    def rotations(self) -> FloatArray:
        """(frames, joints, 3, 3) local rotation matrices. Raises `UsageError` for markers."""
        return self._skeleton_clip().rotations

    @property
    def quaternions(self) -> FloatArray:
        """(frames, joints, 4) local rotations as (w, x, y, z), w >= 0."""
        return to_quaternions(self._skeleton_clip().rotations)

    @property
    def positions(self) -> FloatArray:
        """(frames, joints or markers, 3) world positions, centimetres; NaN in gaps."""
        clip = self.clip
        if isinstance(clip, MarkerClip):
            return clip.positions
        world = world_rotations(clip.skeleton, clip.rotations)
        return world_positions(clip.skeleton, world, clip.translations)

    @property
    def root_path(self) -> FloatArray:
        """(frames, 3) world positions, centimetres, of the root part's reference joint.

        Decoded from the first part of the index file only, at full precision.
        """
        root = self.rig.parts[0]
        clip = self.decode("preview", parts=[root.name])
        if isinstance(clip, MarkerClip):
            return clip.positions[:, root.reference]
        world = world_rotations(clip.skeleton, clip.rotations)
        return world_positions(clip.skeleton, world, clip.translations)[:, root.reference]

    def _skeleton_clip(self) -> SkeletonClip:
        if isinstance(self.clip, MarkerClip):
            raise UsageError(f"{self.name} holds markers, which have no rotations")
        return self.clip
