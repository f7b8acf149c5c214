"""The whole library: clustering, the pattern store, archives and the jobs that write them.

>>> from motifold.pipeline import Archive, archive_library
"""

from .archive import Archive
from .archived_clip import ArchivedClip
from .plan import Settings
from .run import archive_library

__all__ = ["Archive", "ArchivedClip", "Settings", "archive_library"]
