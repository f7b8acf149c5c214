"""Every error that motifold raises on purpose, grouped by what the caller can do about it.

::

    MotifoldError
    ├── InputError            a source file is the problem: mend or leave out that file
    │   ├── FormatError       it breaks its format's rules (names the line or byte)
    │   └── UnsupportedError  it is valid, but holds something motifold does not handle
    ├── UsageError            the call is the problem: change an argument
    │   └── UnknownClipError  no clip of that name (also a KeyError)
    ├── GuaranteeError        a clip cannot be brought inside the asked tolerance
    ├── SchedulerError        the Dask scheduler or its workers are gone: start them again
    └── ArchiveError          the archive is the problem
        ├── NotAnArchiveError there is no archive at this path
        ├── VersionError      written by a newer (or no longer supported) motifold
        ├── DamagedError      bytes are missing or changed: restore them from a copy
        └── BusyError         another writer holds the archive
"""

from __future__ import annotations


class MotifoldError(Exception):
    """Base of all of motifold's errors.

    ``file`` names the file, ``place`` where in it (a line, a byte, a joint), ``advice`` the
    next step; all three appear in the message, and survive pickling to other processes.
    """

    def __init__(
        self,
        problem: str,
        *,
        file: object | None = None,
        place: str | None = None,
        advice: str | None = None,
    ) -> None:
        self.problem = problem
        self.file = None if file is None else str(file)
        self.place = place
        self.advice = advice
        where = ", ".join(part for part in (self.file, place) if part)
        text = f"{where}: {problem}" if where else problem
        super().__init__(f"{text}. {advice}" if advice else text)

    def __reduce__(self) -> tuple[object, ...]:
        return _rebuild, (type(self), self.problem, self.file, self.place, self.advice)

    def within(self, file: object) -> MotifoldError:
        """Return the same error with ``file`` named, unless a file is named already."""
        if self.file is not None:
            return self
        return type(self)(self.problem, file=file, place=self.place, advice=self.advice)


def _rebuild(
    kind: type[MotifoldError],
    problem: str,
    file: str | None,
    place: str | None,
    advice: str | None,
) -> MotifoldError:
    return kind(problem, file=file, place=place, advice=advice)


class InputError(MotifoldError):
    """A source file cannot be used as it is."""


class FormatError(InputError):
    """A source file breaks the rules of its format."""


class UnsupportedError(InputError):
    """A source file is valid but holds something that motifold does not handle."""


class UsageError(MotifoldError):
    """An argument of the call is wrong."""


class UnknownClipError(UsageError, KeyError):
    """The archive holds no clip of this name."""

    def __str__(self) -> str:  # KeyError would show the text in quotes
        return str(self.args[0])


class GuaranteeError(MotifoldError):
    """A clip cannot be brought inside the tolerance that was asked for."""


class SchedulerError(MotifoldError):
    """The Dask scheduler cannot be reached, or all of its workers are gone."""


class ArchiveError(MotifoldError):
    """An archive cannot be used as it is."""


class NotAnArchiveError(ArchiveError):
    """There is no motifold archive at this path."""


class VersionError(ArchiveError):
    """The archive or index file has a format version that this motifold does not read."""


class DamagedError(ArchiveError):
    """Bytes of the archive are missing or changed."""


class BusyError(ArchiveError):
    """Another writer holds the archive."""
