"""Fixtures that tests of the whole pipeline share."""

from hypothesis import settings
from libraries import (
    cluster,
    odd_archive,
    odd_library,
    small_archive,
    small_library,
    tiny_archive,
)

settings.register_profile("motifold", deadline=None)  # machines that test are busy ones
settings.load_profile("motifold")

__all__ = [
    "cluster",
    "odd_archive",
    "odd_library",
    "small_archive",
    "small_library",
    "tiny_archive",
]
