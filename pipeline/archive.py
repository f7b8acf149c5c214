"""An open archive: a read-only mapping from clip names to clips that decode when asked."""

from __future__ import annotations

import difflib
import threading
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatch
from functools import cached_property, lru_cache
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any

from ..codec.clip import Clip, FloatArray, MarkerClip, Repair, Skeleton, SkeletonClip
from ..codec.decode import Tier, decode
from ..codec.errors import DamagedError, UnknownClipError, UsageError
from ..codec.index_file import IndexFile
from ..codec.kinematics import world_positions, world_rotations
from ..codec.metrics import Errors
from ..codec.motionfile import MotionFile
from ..codec.partial import only_parts
from ..codec.patterns import Codebook
from ..codec.rig import Rig
from ..codec.rotations import to_quaternions
from .commit import Commit, read_commit
from .indexreader import read_index
from .layout import current_rows, index_path, read_ledgers
from .ledger import Ledger, Row
from .shelf import Shelf
from .store import Store, read_store


class Archive(Mapping[str, "ArchivedClip"]):
    """The clips of an archive folder, as of the moment it was opened.

    A mapping from clip name (the source's path in its library) to `ArchivedClip`, ordered by
    name. Opening reads one small file; the rest is read when it is first needed. Safe to use
    from several threads, and to send to other processes that see the same folder. Use it in a
    ``with`` block, or call `close`: a closed archive answers no more.

    Raises `NotAnArchiveError`, `VersionError` or `DamagedError`; a name that is not there
    raises `UnknownClipError`, which is a KeyError too.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.commit: Commit = read_commit(self.path)
        self._lock = threading.Lock()
        self._loaded: dict[str, Any] = {}
        self._codebooks: dict[tuple[str, int], Codebook] = {}
        self._closed = False

    def __enter__(self) -> Archive:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        problem: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of everything that was read."""
        with self._lock:
            self._closed = True
            self._loaded.clear()
            self._codebooks.clear()
        _reopened.cache_clear()

    def __reduce__(self) -> tuple[Any, ...]:
        return _reopened, (str(self.path.absolute()), _last_ledger(self.commit))

    def __getitem__(self, name: str) -> ArchivedClip:
        entry = self.rows.get(name)
        if entry is None:
            close = difflib.get_close_matches(str(name), list(self.rows), 3)
            advice = f"Did you mean {' or '.join(close)}?" if close else "See: motifold info"
            raise UnknownClipError(f"no clip {name!r}", file=self.path, advice=advice)
        return ArchivedClip(self, *entry)

    def __contains__(self, name: object) -> bool:
        return name in self.rows

    def __iter__(self) -> Iterator[str]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def find(self, text: str) -> list[str]:
        """Return the names that ``text`` means: a name, a name without suffix, or a glob.

        Raises `UnknownClipError` if it means none.
        """
        if text in self.rows:
            return [text]
        found = self.stems.get(text) or [name for name in self.rows if fnmatch(name, text)]
        return found or [self[text].name]

    @property
    def ledgers(self) -> dict[int, Ledger]:
        """The ledgers of all jobs, by generation."""
        value: dict[int, Ledger] = self._once(
            "ledgers", lambda: read_ledgers(self.path, self.commit)
        )
        return value

    @property
    def rows(self) -> dict[str, tuple[Row, int]]:
        """The current ledger row of every clip with its generation, by name."""
        ledgers = self.ledgers
        value: dict[str, tuple[Row, int]] = self._once("rows", lambda: current_rows(ledgers))
        return value

    @property
    def stems(self) -> dict[str, list[str]]:
        """The names of the clips by what is left of them without their suffix."""
        rows = self.rows
        value: dict[str, list[str]] = self._once("stems", lambda: _by_stem(rows))
        return value

    @property
    def store(self) -> Store:
        """The pattern store."""
        ledgers = self.ledgers
        value: Store = self._once("store", lambda: read_store(self.path, self.commit, ledgers))
        return value

    def codebook(self, family: str, generation: int) -> Codebook:
        """Return a rig family's patterns as of a generation."""
        counts = self.commit.job(generation).patterns.get(family)
        if counts is None:
            raise DamagedError(f"generation {generation} does not know rig family {family}")
        store = self.store
        with self._lock:
            if (family, generation) not in self._codebooks:
                self._codebooks[family, generation] = store.codebook(family, counts)
            return self._codebooks[family, generation]

    @property
    def shelf(self) -> Shelf:
        """The decoded clips that others refer to."""
        store, numbered = (
            self.store,
            [row for _, ledger in sorted(self.ledgers.items()) for row in ledger.rows],
        )

        def find(number: int) -> tuple[MotionFile, Rig]:
            if number >= len(numbered):
                raise DamagedError(f"refers to clip {number} of {len(numbered)}")
            row = numbered[number]
            file = read_index(index_path(self.path, row.index))
            if not isinstance(file, MotionFile):
                raise DamagedError(f"refers to {row.name}, an index file of version 1")
            return file, self.rig(row.rig)

        value: Shelf = self._once("shelf", lambda: Shelf(store, find))
        return value

    def rig(self, number: int) -> Rig:
        """Return a rig by its number."""
        rigs = self.store.rigs
        if not 0 <= number < len(rigs):
            raise DamagedError(f"names rig {number} of {len(rigs)}")
        return rigs[number]

    def _once(self, key: str, read: Any) -> Any:
        with self._lock:
            if self._closed:
                raise UsageError("the archive is closed", file=self.path)
            if key not in self._loaded:
                self._loaded[key] = read()
            return self._loaded[key]


def _by_stem(names: Iterable[str]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(str(PurePosixPath(name).with_suffix("")), []).append(name)
    return found


def _last_ledger(commit: Commit) -> str:
    return commit.jobs[-1].ledger if commit.jobs else ""


@lru_cache(maxsize=8)
def _reopened(path: str, last_ledger: str) -> Archive:
    """Open an archive in another process, once; as of the job that was the last one when sent."""
    archive = Archive(path)
    jobs = archive.commit.jobs
    while jobs and jobs[-1].ledger != last_ledger:
        jobs = jobs[:-1]
    archive.commit = Commit(jobs)
    if _last_ledger(archive.commit) != last_ledger:
        raise DamagedError("another archive took its place", file=path, advice="Open it again")
    return archive


@dataclass(frozen=True, eq=False)
class ArchivedClip:
    """One clip of an open archive. What it holds is read and decoded when it is asked for.

    ``row`` and ``generation``: its ledger row and the job that archived it.
    """

    archive: Archive
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
    def certificate(self) -> Errors:
        """The errors, centimetres, that the encoder measured by decoding: never understated."""
        return self.index(prefix_only=True).certificate

    @property
    def path(self) -> Path:
        """Where its index file is."""
        return index_path(self.archive.path, self.row.index)

    def index(self, *, prefix_only: bool = False) -> IndexFile | MotionFile:
        """Return the clip's index file, checked. Raises `DamagedError`."""
        index = read_index(self.path, prefix_only=prefix_only)
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

        ``tier``: ``tolerance``, inside the certified error; or ``preview``, the patterns on
        the exact root path, which reads only the first part of the index file. ``parts``:
        names of body parts; the joints of all others are left at rest (markers: NaN), and the
        work for them is not done. Raises `DamagedError` or `UsageError`.
        """
        index = self.index(prefix_only=tier == "preview")
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
        clip = self.archive.shelf.decode(
            file, self.rig, core_only=tier == "preview", start=first, stop=last
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
