"""What a person searches for: a clip of the archive by name, or any motion file."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from ..codec.clip import Clip, MarkerClip
from ..codec.errors import UnknownClipError, UsageError
from ..codec.figure.bodyparts import BodyPart, body_parts
from ..codec.figure.markerparts import marker_parts
from .bodysignals import PARTS, body_signals, known_parts
from .catalogfolder import Catalog
from .search import Query, cut_query


@dataclass(frozen=True, eq=False)
class Asked:
    """A query, and in words what of it the search does not use."""

    query: Query
    notes: tuple[str, ...] = ()


def ask(
    catalog: Catalog,
    text: str,
    *,
    start: float | None = None,
    stop: float | None = None,
    parts: Iterable[str] = (),
    mirror: bool = False,
) -> Asked:
    """Return the query that ``text`` means: a clip's name, with or without suffix, or a file.

    ``start``, ``stop``: seconds; ``parts``: names, with ``=weight`` if it is not 1; none means
    all. ``mirror``: search for its mirror image. Raises `UnknownClipError`, `UsageError`, or
    `InputError` where the file cannot be read.
    """
    weights = parse_parts(parts)
    number = _find(catalog, text)
    if number is not None:
        asked = Asked(replace(cut_query(catalog.words(number), start, stop), own=number))
    else:
        asked = _from_file(catalog, Path(text), start, stop)
    query = replace(asked.query, weights=weights)
    return replace(asked, query=query.mirrored(catalog.vocabulary) if mirror else query)


def parse_parts(parts: Iterable[str]) -> dict[str, float]:
    """Return the weights of parts from texts such as ``left_arm`` or ``left_arm=2``."""
    weights = {}
    for text in parts:
        name, found, weight = text.strip().partition("=")
        if name not in PARTS:
            raise UsageError(f"there is no part {name!r}", advice=f"Parts: {', '.join(PARTS)}")
        try:
            weights[name] = float(weight) if found else 1.0
        except ValueError:
            raise UsageError(f"{text!r} is no weight", advice=f"Write {name}=2") from None
    return weights or dict.fromkeys(PARTS, 1.0)


def parts_of(clip: Clip) -> tuple[BodyPart, ...]:
    """Return the body parts of a clip."""
    if isinstance(clip, MarkerClip):
        return marker_parts(clip.names, clip.positions)
    return body_parts(clip.skeleton)


def _find(catalog: Catalog, text: str) -> int | None:
    """Return the number of the clip of a name, None for a file; raises `UnknownClipError`."""
    if text in catalog.numbers:
        return catalog.numbers[text]
    if Path(text).is_file():
        return None
    stems = [name for name in catalog.numbers if str(PurePosixPath(name).with_suffix("")) == text]
    if len(stems) == 1:
        return catalog.numbers[stems[0]]
    close = stems or difflib.get_close_matches(text, catalog.numbers, 3)
    advice = f"Did you mean {' or '.join(close)}?" if close else "See: motifold info --clips"
    if text in catalog.record.left_out:
        advice = f"It has no words: {catalog.record.left_out[text]}"
    if catalog.problems:
        advice = f"Some clips are not searched: {catalog.problems[0]}"
    raise UnknownClipError(f"no clip {text!r}, nor a file", file=catalog.archive, advice=advice)


def _from_file(catalog: Catalog, path: Path, start: float | None, stop: float | None) -> Asked:
    from ..codec.formats.files import read_clip

    clip = read_clip(path)
    parts = parts_of(clip)
    signals = body_signals(clip, parts)
    if not signals:
        raise UsageError("has no body part that is searched", file=path, advice="See the README")
    used, notes = known_parts(signals), []
    ignored = [part.name for part in parts if part.name not in used]
    missing = [part for part in PARTS if part not in used]
    if ignored:
        notes.append(f"not searched by: {', '.join(ignored)}")
    if missing:
        notes.append(f"the query has no {', '.join(missing)}")
    try:
        query = cut_query(catalog.vocabulary.words_of(signals), start, stop)
    except UsageError as problem:
        raise problem.within(path) from None
    return Asked(query, tuple(notes))
