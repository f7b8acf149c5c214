"""Look-up of patterns for the clustering of a job."""

from __future__ import annotations

from ..codec.patterns.nearest import NearestPatterns
from ..codec.patterns.patterns import to_centimetres
from .store import Store


class Searchers:
    """The patterns of every family and part for look-up, made when first asked for."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._made: dict[tuple[str, int], NearestPatterns] = {}

    def of(self, key: str, part: int) -> NearestPatterns:
        """Return the look-up of a family's part."""
        if (key, part) not in self._made:
            points = to_centimetres(self._store.patterns[key][part])
            self._made[key, part] = NearestPatterns(points)
        return self._made[key, part]
