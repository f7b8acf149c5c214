"""The pattern store: rigs, rig families and their patterns, once per library, in Zarr v3.

One group a generation, written whole by one job and never changed::

    store.zarr/000001/records             uint8: JSON of the rigs and families that are new
    store.zarr/000001/<family>/<part>     int16 (16, channels, patterns): patterns that are new
    store.zarr/000001/models/<key>        uint8: a motion model (`codec.modelfile`)

Patterns are cosine coefficients along time (`codec.patterns`), mostly zeros, and stored with
the patterns as the last axis, so that the zeros of the quick courses lie together.
Numbers of rigs and patterns run on through the generations.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import zarr
from zarr.codecs import ZstdCodec

from ..codec.blocks.motionmodel import MotionModel
from ..codec.errors import DamagedError
from ..codec.figure.rig import Family, Rig
from ..codec.learned.modelfile import read_model, write_model
from ..codec.patterns.patterns import Codebook, no_patterns
from .commit import Commit
from .durable import digest, sync, writing
from .ledger import Ledger

NAME = "store.zarr"
_CHUNK = 1 << 14  # patterns, or bytes of records

Patterns = npt.NDArray[np.int16]


class Store:
    """All of a store that the published generations, or a job under way, can see.

    ``rigs``: by number. ``families``: by key. ``patterns``: per family key, per part, the
    patterns of all generations in their order. ``models``: motion models by key (see
    `codec.motionmodel.model_key`) and the generation that learned them.
    """

    def __init__(self) -> None:
        self.rigs: list[Rig] = []
        self.families: dict[str, Family] = {}
        self.patterns: dict[str, list[Patterns]] = {}
        self.models: dict[tuple[str, int], MotionModel] = {}
        self._numbers: dict[str, int] = {}

    def rig_number(self, rig: Rig) -> int | None:
        """Return the number of a rig with the same record, or None."""
        return self._numbers.get(rig.key)

    def add_rig(self, rig: Rig) -> int:
        """Add a rig; return its number."""
        self._numbers[rig.key] = len(self.rigs)
        self.rigs.append(rig)
        return len(self.rigs) - 1

    def add_family(self, family: Family) -> None:
        """Add a rig family without patterns."""
        self.families[family.key] = family
        self.patterns[family.key] = [no_patterns(part) for part in family.parts]

    def add_patterns(self, key: str, part: int, patterns: Patterns) -> None:
        """Append patterns to a family's part."""
        self.patterns[key][part] = np.concatenate([self.patterns[key][part], patterns])

    def counts(self) -> dict[str, list[int]]:
        """Return the number of patterns per family and part."""
        return {key: [len(part) for part in parts] for key, parts in self.patterns.items()}

    def newest_models(self) -> dict[str, tuple[int, MotionModel]]:
        """Return the newest model of every key with its generation."""
        newest: dict[str, tuple[int, MotionModel]] = {}
        for (key, generation), model in sorted(self.models.items(), key=lambda entry: entry[0]):
            newest[key] = generation, model
        return newest

    def codebook(self, key: str, counts: list[int] | None = None) -> Codebook:
        """Return a family's patterns; with ``counts``, only the first so many of each part."""
        if key not in self.families:
            raise DamagedError(f"the store has no rig family {key}")
        parts = self.patterns[key]
        if counts is not None:
            parts = [part[:count] for part, count in zip(parts, counts, strict=True)]
        return Codebook(self.families[key], tuple(parts))


def read_store(archive: Path, commit: Commit, ledgers: Mapping[int, Ledger]) -> Store:
    """Return the store of an archive as of ``commit``, checked against its ledgers.

    Zarr gives zeros for files that are missing, and the patterns' bytes carry no checksums, so
    nothing is read whose digest is not the published one. Raises `DamagedError`.
    """
    store = Store()
    for job in commit.jobs:
        path = archive / NAME / f"{job.generation:06d}"
        wrong = check_generation(archive, job.generation, ledgers[job.generation].store)
        if wrong:
            raise DamagedError(wrong[0], advice="Restore it from a copy")
        try:
            group = zarr.open_group(path, mode="r", use_consolidated=False)
            _read_generation(store, group, job.generation)
        except (OSError, ValueError, KeyError, TypeError, RuntimeError) as problem:
            raise DamagedError(
                f"the pattern store cannot be read ({problem})",
                file=path,
                advice="Restore it from a copy",
            ) from problem
        if len(store.rigs) != job.rigs or store.counts() != job.patterns:
            raise DamagedError("the pattern store is not the one that was published", file=path)
    return store


def write_generation(
    archive: Path, generation: int, before: Commit, store: Store
) -> dict[str, str]:
    """Write what ``store`` has beyond ``before`` as a generation; return its files' digests."""
    known_rigs = before.jobs[-1].rigs if before.jobs else 0
    known = before.jobs[-1].patterns if before.jobs else {}
    path = archive / NAME / f"{generation:06d}"
    records = {
        "rigs": [rig.to_record() for rig in store.rigs[known_rigs:]],
        "families": [
            family.to_record() for key, family in store.families.items() if key not in known
        ],
    }
    text = json.dumps(records, separators=(",", ":")).encode()
    with writing(path):
        group = zarr.create_group(path, overwrite=True)
        _write(group, "records", np.frombuffer(text, np.uint8))
        for key, parts in store.patterns.items():
            for number, patterns in enumerate(parts):
                new = patterns[known[key][number] if key in known else 0 :]
                if len(new):
                    name = f"{key}/{number:02d}"
                    _write(group, name, np.ascontiguousarray(np.moveaxis(new, 0, -1)))
        for (key, made), model in sorted(store.models.items(), key=lambda entry: entry[0]):
            if made == generation:
                _write(group, f"models/{key}", np.frombuffer(write_model(model), np.uint8))
        for written in (path.parent, path, *path.rglob("*")):
            sync(written)  # Zarr does not
    return _digests(path)


def check_generation(archive: Path, generation: int, digests: Mapping[str, str]) -> list[str]:
    """Return what is wrong with a generation's files, in words; nothing if they are whole."""
    path = archive / NAME / f"{generation:06d}"
    found = _digests(path)
    wrong = [f"{path / name} is missing" for name in digests if name not in found]
    wrong += [f"{path / name} does not belong here" for name in found if name not in digests]
    wrong += [
        f"{path / name} is damaged"
        for name in digests
        if name in found and found[name] != digests[name]
    ]
    return wrong


def _write(group: Any, name: str, values: npt.NDArray[Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about codecs without a final v3 text
        group.create_array(
            name,
            data=values,
            chunks=(*values.shape[:-1], min(values.shape[-1], _CHUNK)),
            compressors=ZstdCodec(level=19),
        )


def _read_generation(store: Store, group: Any, generation: int) -> None:
    records = json.loads(bytes(group["records"][:]))
    for record in records["rigs"]:
        store.add_rig(Rig.from_record(record))
    for record in records["families"]:
        store.add_family(Family.from_record(record))
    for key, family in store.families.items():
        for number in range(len(family.parts)):
            name = f"{key}/{number:02d}"
            if name in group:
                store.add_patterns(
                    key, number, np.moveaxis(np.asarray(group[name][:], np.int16), -1, 0)
                )
    if "models" in group:
        for name in group["models"]:
            data = bytes(np.asarray(group[f"models/{name}"][:], np.uint8))
            founded = store.families.get(name.rpartition("-")[0])
            hinged = founded.hinged if founded else ()
            store.models[name, generation] = read_model(data, hinged)


def _digests(path: Path) -> dict[str, str]:
    return {
        file.relative_to(path).as_posix(): digest(file.read_bytes())
        for file in sorted(path.rglob("*"))
        if file.is_file()
    }
