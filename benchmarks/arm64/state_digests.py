"""Print digests of what archives decode to: a line for each clip.

python benchmarks/arm64/state_digests.py ARCHIVE...

SHA-256 of the decoder's whole-number states and of the floats made from them, frames, and name.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from motifold.codec.clip import MarkerClip
from motifold.codec.version1.decode import decode_integers
from motifold.codec.version1.index_file import IndexFile
from motifold.pipeline.archive import Archive
from motifold.pipeline.shelf import Found


def digest(arrays: Iterable[npt.NDArray[np.generic]], kind: str) -> str:
    """Return the digest of arrays, as numbers of one kind."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(np.ascontiguousarray(array).astype(kind).tobytes())
    return found.hexdigest()[:32]


def main() -> None:
    """Print a line for each clip of the archives that are named."""
    for folder in sys.argv[1:]:
        with Archive(folder) as archive:
            for name, clip in archive.items():
                index = clip.index()
                if isinstance(index, IndexFile):
                    codebook = archive.codebook(clip.rig.family_key, index.generation)
                    states = list(decode_integers(index, clip.rig, codebook))
                else:
                    states = list(archive.shelf.states(Found(index, clip.rig, clip.path)).states)
                shown = clip.decode()
                if isinstance(shown, MarkerClip):
                    floats = [shown.positions]
                else:
                    floats = [shown.rotations, shown.translations]
                print(digest(states, "<i8"), digest(floats, "<f8"), clip.frames, name, flush=True)


if __name__ == "__main__":
    main()
