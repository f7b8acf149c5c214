"""Which formats there are, and reading a clip from a path.

An AMC file is read with the ASF file beside it: ``01_01.amc`` with ``01_01.asf`` or ``01.asf``,
else with the only ASF file of its folder.
"""

from __future__ import annotations

from pathlib import Path

from ..clip import Clip, SkeletonClip
from ..errors import InputError, UnsupportedError, UsageError

READABLE = (".amc", ".bvh", ".c3d", ".trc")
"""Suffixes of the files that `read_clip` reads, in lower case."""

WRITABLE = ("bvh", "npz", "trc")
"""Formats that `clip_bytes` writes: bvh and npz for skeletons, trc and npz for markers."""


def read_clip(path: str | Path, units: str | None = None) -> Clip:
    """Read a motion file; its suffix, in any case, says which format it has.

    ``units`` overrides the file's length unit. Raises InputError (FormatError where the file
    is broken, UnsupportedError for other suffixes) with the file named, and UsageError for
    unknown ``units``.
    """
    path = Path(path)
    try:
        return _read(path, units)
    except InputError as error:
        raise error.within(path) from None


def _read(path: Path, units: str | None) -> Clip:
    suffix, source = path.suffix.lower(), str(path)
    if suffix == ".bvh":
        from .bvh import parse_bvh

        return parse_bvh(_bytes(path), source, units)
    if suffix == ".amc":
        from .amc import parse_amc

        skeleton = _skeleton_file(path)
        return parse_amc(_bytes(path), _bytes(skeleton), source, str(skeleton), units)
    if suffix == ".c3d":
        from .c3d_file import parse_c3d

        return parse_c3d(_bytes(path), source, units)
    if suffix == ".trc":
        from .trc import parse_trc

        return parse_trc(_bytes(path), source, units)
    raise UnsupportedError(
        f"{suffix or 'no suffix'} is not a motion format",
        advice=f"motifold reads {', '.join(READABLE)}",
    )


def source_bytes(path: str | Path) -> bytes:
    """Return all bytes that the clip of a file depends on: for AMC, those of its ASF as well."""
    path = Path(path)
    content = _bytes(path)
    return content + _bytes(_skeleton_file(path)) if path.suffix.lower() == ".amc" else content


def default_format(clip: Clip) -> str:
    """Return the format that a clip is written in when none is asked for."""
    return "bvh" if isinstance(clip, SkeletonClip) else "trc"


def clip_bytes(clip: Clip, format: str) -> bytes:
    """Return a clip as a file of one of the `WRITABLE` formats, else raise UsageError."""
    if format == "npz":
        from .npz import format_npz

        return format_npz(clip)
    if isinstance(clip, SkeletonClip):
        if format == "bvh":
            from .bvh import format_bvh

            return format_bvh(clip)
    elif format == "trc":
        from .trc import format_trc

        return format_trc(clip)
    kind = "skeletons" if isinstance(clip, SkeletonClip) else "markers"
    advice = f"Use {default_format(clip)} or npz"
    raise UsageError(f"clips of {kind} cannot be written as {format!r}", advice=advice)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", file=path) from error


def _skeleton_file(motion: Path) -> Path:
    try:
        beside = sorted(p for p in motion.parent.iterdir() if p.suffix.lower() == ".asf")
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", file=motion) from error
    wanted = [motion.stem.lower(), motion.stem.partition("_")[0].lower()]
    for stem in wanted:
        for path in beside:
            if path.stem.lower() == stem:
                return path
    if len(beside) == 1:
        return beside[0]
    looked = " or ".join(dict.fromkeys(f"{stem}.asf" for stem in wanted))
    raise InputError(
        f"no skeleton for this motion: looked for {looked}, then for a single .asf file, in "
        f"{motion.parent}, which holds {len(beside)}",
        file=motion,
        advice="Put its .asf file beside it",
    )
