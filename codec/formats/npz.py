"""NumPy archives (``.npz``) of clips, for people who want the arrays.

Keys of every clip: ``names`` (joints or markers, text), ``frame_time`` (seconds), ``units``
(``"cm"``). Of a skeleton's clip: ``parents`` (joints,), -1 for the root; ``offsets``
(joints, 3); ``rotations`` (frames, joints, 3, 3), local, column vectors; ``translations``
(frames, joints, 3), local; ``positions`` (frames, joints, 3), world; ``end_parents`` (ends,),
``end_offsets`` (ends, 3). Of a clip of markers: ``positions`` (frames, markers, 3), NaN where
not seen; ``seen`` (frames, markers). Lengths are centimetres.
"""

from __future__ import annotations

import io
import zipfile
from typing import Any

import numpy as np
import numpy.typing as npt

from ..clip import Clip, SkeletonClip
from ..geometry.kinematics import world_positions, world_rotations

_UNIX = 3


def format_npz(clip: Clip) -> bytes:
    """Return the bytes of an uncompressed archive; equal clips give equal bytes."""
    arrays: dict[str, npt.NDArray[Any]] = {
        "frame_time": np.array(clip.frame_time),
        "units": np.array("cm"),
    }
    if isinstance(clip, SkeletonClip):
        skeleton = clip.skeleton
        world = world_rotations(skeleton, clip.rotations)
        arrays |= {
            "names": np.array(skeleton.names, dtype=np.str_),
            "parents": skeleton.parents,
            "offsets": skeleton.offsets,
            "rotations": clip.rotations,
            "translations": clip.translations,
            "positions": world_positions(skeleton, world, clip.translations),
            "end_parents": skeleton.end_parents,
            "end_offsets": skeleton.end_offsets,
        }
    else:
        names = np.array(clip.names, dtype=np.str_)
        arrays |= {"names": names, "positions": clip.positions, "seen": clip.seen}
    return _archive(arrays)


def _archive(arrays: dict[str, npt.NDArray[Any]]) -> bytes:
    """Return what ``np.savez`` would write, without the clock and the platform in it."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for key, array in arrays.items():
            entry = zipfile.ZipInfo(f"{key}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            entry.create_system = _UNIX
            content = io.BytesIO()
            np.lib.format.write_array(content, np.ascontiguousarray(array), allow_pickle=False)
            archive.writestr(entry, content.getvalue())
    return out.getvalue()
