"""How far a restored file is from its source, told by readers that are not motifold's."""

from __future__ import annotations

import warnings
from pathlib import Path
from types import SimpleNamespace

import c3d
import numpy as np
from oracle import Floats, Motion, marker_error, pose, read_bvh, shell_error
from oracle_amc import read_amc

UNITS = {"m": 100.0, "cm": 1.0, "mm": 0.1}


def file_errors(source: Path, restored: Path, centimetres: float) -> Floats:
    """Return the shell errors, or displacements of markers seen, of all frames, centimetres.

    ``centimetres`` is the length of a BVH file's unit, which no BVH file tells; every other
    format does. AMC comes back as BVH in centimetres, C3D as TRC. AssertionError where the
    two files differ in more than numbers.
    """
    if source.suffix.lower() in (".c3d", ".trc"):
        (names, before), (same, after) = read_markers(source), read_markers(restored)
        assert names == same, f"markers differ: {sorted(set(names) ^ set(same))}"
        errors = marker_error(SimpleNamespace(positions=before), SimpleNamespace(positions=after))
        return errors[~np.isnan(before).any(axis=2)]
    original, decoded = read_pair(source, restored, centimetres)
    return shell_error(original, decoded).ravel()


def joint_distances(original: Motion, decoded: Motion) -> Floats:
    """Return the displacement (frames, joints) of the joints' positions, centimetres."""
    (_, before), (_, after) = pose(original), pose(decoded)
    return np.asarray(np.linalg.norm(after - before, axis=2))


def read_pair(source: Path, restored: Path, centimetres: float) -> tuple[Motion, Motion]:
    """Return a skeleton's motion as its source and the restored BVH file have it."""
    if source.suffix.lower() == ".amc":
        original, decoded = read_amc(skeleton_file(source), source), read_bvh(restored)
    else:
        original, decoded = (read_bvh(path, centimetres) for path in (source, restored))
    assert original.names == decoded.names, "joints differ"
    assert len(original.translations) == len(decoded.translations), "frames differ"
    assert np.isclose(original.frame_time, decoded.frame_time), "frame times differ"
    for (_, before), (_, after) in zip(original.ends, decoded.ends, strict=True):
        assert np.abs(before - after).max() < 2e-6, "end sites differ"
    return original, decoded


def skeleton_file(amc: Path) -> Path:
    """Return the ASF file of an AMC file: ``01.asf`` beside ``01_01.amc``."""
    return amc.with_name(amc.name.partition("_")[0] + ".asf")


def read_markers(path: Path) -> tuple[list[str], Floats]:
    """Return marker names, and positions (frames, markers, 3), centimetres, NaN in gaps."""
    return _read_c3d(path) if path.suffix.lower() == ".c3d" else _read_trc(path)


def _read_trc(path: Path) -> tuple[list[str], Floats]:
    lines = path.read_text().splitlines()
    facts = lines[2].split("\t")
    markers, unit = int(facts[3]), UNITS[facts[4].strip()]
    names = [name.strip() for name in lines[3].split("\t")[2::3]][:markers]
    rows = [line.split("\t")[2 : 2 + 3 * markers] for line in lines[5:] if line.strip()]
    cells = [
        [float(cell) if cell.strip() else np.nan for cell in row + [""] * (3 * markers - len(row))]
        for row in rows
    ]
    return names, np.array(cells).reshape(len(rows), markers, 3) * unit


def _read_c3d(path: Path) -> tuple[list[str], Floats]:
    """Read the points that are places: labels under ANGLES, POWERS and so on are not."""
    with path.open("rb") as handle, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about files without analogue channels
        reader = c3d.Reader(handle)
        unit = UNITS[reader.get("POINT:UNITS").string_value.strip("\0 ")]
        frames = np.array([points for _, points, _ in reader.read_frames()], np.float64)
        labels = [label.strip("\0 ") for label in reader.point_labels]
        others = {
            name.strip("\0 ")
            for kind in ("ANGLES", "FORCES", "MOMENTS", "POWERS")
            if reader.get(f"POINT:{kind}") is not None
            for name in reader.get(f"POINT:{kind}").string_array
        }
    kept = [number for number, label in enumerate(labels) if label not in others]
    points = frames[:, kept]
    seen = points[:, :, 3:4] >= 0
    return [labels[number] for number in kept], np.where(seen, points[:, :, :3] * unit, np.nan)
