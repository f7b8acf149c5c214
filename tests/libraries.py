"""Small libraries and archives of them, made once a test session, and a Dask cluster.

Nothing here may be written to: tests that change an archive copy it first.
"""

from __future__ import annotations

import io
import shutil
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import c3d
import numpy as np
import pytest

from motifold.codec.formats.bvh import format_bvh
from motifold.pipeline.run import archive_library
from motifold.workflows.synthetic import SyntheticSpec, plan_library

CLIPS = 24
MARKERS = ("LFHD", "RFHD", "CLAV", "STRN", "LWRA", "RWRA", "LANK", "RANK")
STRANGE_NAME = b"caf\xe9.bvh".decode("utf-8", "surrogateescape")

BAD = {
    "bad/empty.bvh": "line 1",
    "bad/header.bvh": "ends",
    "bad/nan.bvh": "nan",
    "bad/two_roots.bvh": "root",
    "bad/no_skeleton.amc": "skeleton",
    "bad/gone.bvh": "No such file",
    "bad/noise.c3d": "C3D",
}
"""Files of the odd library that cannot be used, with a word that their reason must have."""


def short_specs(count: int, start: int = 0) -> list[SyntheticSpec]:
    """Return specifications of clips that are quick to archive: 60 frames each."""
    plan = plan_library(start + count)[start:]
    return [replace(spec, seconds=2.0, rate=30.0) for spec in plan]


def write_clips(folder: Path, specs: list[SyntheticSpec]) -> list[str]:
    """Write synthetic clips into a folder; return their file names."""
    folder.mkdir(parents=True, exist_ok=True)
    for spec in specs:
        (folder / f"{spec.name}.bvh").write_bytes(format_bvh(spec.clip()))
    return [f"{spec.name}.bvh" for spec in specs]


def tree(folder: Path) -> dict[str, bytes]:
    """Return all files below a folder, by their path inside it."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def counted_bytes(archive: Path) -> int:
    """Return the size of an archive, without what no clip needs."""
    files = tree(archive).items()
    beside = ("catalog/", "traits/", ".writer.lock")
    return sum(len(data) for path, data in files if not path.startswith(beside))


def copied(folder: Path, to: Path) -> Path:
    """Copy a folder, times of change included, and return where it went."""
    shutil.copytree(folder, to)
    return to


def marker_course(frames: int = 50) -> np.ndarray:
    """Return positions (frames, markers, 3), millimetres, of a person who sways and waves."""
    rest = np.array(
        [
            [-70, 1700, 90],
            [70, 1700, 90],
            [0, 1450, 80],
            [0, 1300, 90],
            [-600, 1400, 20],
            [600, 1400, 20],
            [-120, 90, -30],
            [120, 90, -30],
        ],
        float,
    )
    time = np.arange(frames)[:, None, None] / 10.0
    sway = rest[None, :, 1:2] / 1700 * np.array([40.0, 0.0, 25.0]) * np.sin(time)
    wave = np.zeros_like(sway)
    wave[:, 5] = np.array([0.0, 180.0, 90.0]) * np.sin(3 * time[:, 0])
    return np.asarray(rest + sway + wave)


def trc_text(positions: np.ndarray, rate: float = 100.0) -> str:
    """Return a TRC file of positions (frames, markers, 3) in millimetres; NaN is a gap."""
    frames = len(positions)
    lines = [
        "PathFileType\t4\t(X/Y/Z)\tsway.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\t"
        "OrigDataStartFrame\tOrigNumFrames",
        f"{rate:g}\t{rate:g}\t{frames}\t{len(MARKERS)}\tmm\t{rate:g}\t1\t{frames}",
        "Frame#\tTime\t" + "\t\t\t".join(MARKERS) + "\t\t",
        "\t\t" + "\t".join(f"{axis}{n + 1}" for n in range(len(MARKERS)) for axis in "XYZ"),
        "",
    ]
    for frame, points in enumerate(positions):
        cells = ["" if np.isnan(value) else f"{value:.4f}" for value in points.ravel()]
        lines.append("\t".join([str(frame + 1), f"{frame / rate:.4f}", *cells]))
    return "\n".join(lines) + "\n"


def c3d_bytes(positions: np.ndarray, rate: float = 100.0) -> bytes:
    """Return a C3D file of positions (frames, markers, 3) in millimetres, by the c3d library."""
    writer = c3d.Writer(point_rate=rate, analog_rate=0, point_scale=-1.0, point_units="mm  ")
    writer.point_group.add_str("LABELS", "", "".join(MARKERS), 4, len(MARKERS))
    writer.set_start_frame(1)
    for points in positions:
        values = np.zeros((len(MARKERS), 5), np.float32)
        values[:, :3] = points
        pair = np.empty((1, 2), object)  # the writer guesses wrongly from other nestings
        pair[0, 0], pair[0, 1] = values, np.ones((0, 0))
        writer.add_frames(pair)
    out = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        writer.write(out)
    return out.getvalue()


ASF = """:version 1.10
:units
  length 0.45
  angle deg
:root
order TX TY TZ RX RY RZ
axis XYZ
position 0 0 0
orientation 0 0 0
:bonedata
{bones}:hierarchy
begin
root lowerback lfemur rfemur
lowerback head
lfemur ltibia
rfemur rtibia
end
"""
_BONES = {
    "lowerback": ("0 1 0", 4.0, "rx ry rz"),
    "head": ("0 1 0", 2.0, "rx ry rz"),
    "lfemur": ("0.3 -0.95 0", 7.0, "rx ry rz"),
    "ltibia": ("0 -1 0", 7.0, "rx"),
    "rfemur": ("-0.3 -0.95 0", 7.0, "rx ry rz"),
    "rtibia": ("0 -1 0", 7.0, "rx"),
}


def asf_text() -> str:
    """Return a skeleton of seven bones, two of them hinges."""
    bones = "".join(
        f"begin\nname {name}\ndirection {direction}\nlength {length}\naxis 0 0 20 XYZ\n"
        f"dof {dofs}\nend\n"
        for name, (direction, length, dofs) in _BONES.items()
    )
    return ASF.format(bones=bones)


def amc_text(frames: int = 40) -> str:
    """Return a motion of `asf_text`'s skeleton."""
    lines = [":FULLY-SPECIFIED", ":DEGREES"]
    for frame in range(frames):
        swing = 30 * np.sin(frame / 6)
        lines += [str(frame + 1), f"root {frame * 0.05:.4f} 17 0 0 {frame:.4f} 0"]
        lines += [f"lowerback {swing / 6:.4f} 0 {swing / 9:.4f}", f"head 0 {swing / 3:.4f} 0"]
        lines += [f"lfemur {swing:.4f} 1 2", f"ltibia {abs(swing) / 2:.4f}"]
        lines += [f"rfemur {-swing:.4f} 1 2", f"rtibia {20 - swing / 2:.4f}"]
    return "\n".join(lines) + "\n"


def write_odd_library(folder: Path) -> list[str]:
    """Write a library of every format with names and files as life has them.

    Returns the names that can be archived; the others are `BAD`.
    """
    (folder / "bad").mkdir(parents=True)
    (folder / "markers").mkdir()
    good, spare = short_specs(2)
    bvh = format_bvh(good.clip())
    (folder / STRANGE_NAME).write_bytes(bvh)
    (folder / "Upper.BVH").write_bytes(format_bvh(spare.clip()))
    text = bvh.decode()
    (folder / "cut.bvh").write_text(text[: len(text) * 3 // 4])  # ends within a number: mended
    positions = marker_course()
    positions[10:20, 3] = np.nan
    (folder / "markers" / "sway.trc").write_text(trc_text(positions))
    (folder / "markers" / "sway.c3d").write_bytes(c3d_bytes(marker_course()))
    (folder / "07.asf").write_text(asf_text())
    (folder / "07_01.amc").write_text(amc_text())
    (folder / "notes.txt").write_text("not a clip")

    head, _, motion = text.partition("MOTION")
    (folder / "bad" / "empty.bvh").write_bytes(b"")
    (folder / "bad" / "header.bvh").write_text(head[: len(head) // 2])
    lines = motion.splitlines()
    lines[5] = "nan " + lines[5].split(None, 1)[1]
    (folder / "bad" / "nan.bvh").write_text(head + "MOTION" + "\n".join(lines) + "\n")
    (folder / "bad" / "two_roots.bvh").write_text(head.rstrip() + "\n" + text.split("\n", 1)[1])
    (folder / "bad" / "no_skeleton.amc").write_text(amc_text())
    (folder / "bad" / "gone.bvh").symlink_to(folder / "never" / "was.bvh")
    (folder / "bad" / "noise.c3d").write_bytes(np.random.default_rng(0).bytes(2000))
    names = [STRANGE_NAME, "Upper.BVH", "cut.bvh", "markers/sway.trc", "markers/sway.c3d"]
    return sorted([*names, "07_01.amc"])


@pytest.fixture(scope="session")
def small_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library of `CLIPS` synthetic clips."""
    folder = tmp_path_factory.mktemp("small") / "library"
    write_clips(folder, short_specs(CLIPS))
    return folder


@pytest.fixture(scope="session")
def small_archive(small_library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An archive of `small_library`, written without workers."""
    folder = tmp_path_factory.mktemp("small") / "archive"
    report = archive_library(small_library, folder, workers=0)
    assert report.clips == CLIPS
    return folder


@pytest.fixture(scope="session")
def odd_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library of every format, with names and files as life has them; see `BAD`."""
    folder = tmp_path_factory.mktemp("odd") / "library"
    write_odd_library(folder)
    return folder


@pytest.fixture(scope="session")
def odd_archive(odd_library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An archive of what can be archived of `odd_library`."""
    folder = tmp_path_factory.mktemp("odd") / "archive"
    archive_library(odd_library, folder, workers=0)
    return folder


@pytest.fixture(scope="session")
def tiny_archive(small_library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An archive of three clips in two jobs, one clip in two versions."""
    base = tmp_path_factory.mktemp("tiny")
    names = sorted(path.name for path in small_library.iterdir())[:3]
    library = base / "library"
    library.mkdir()
    for name in names[:2]:
        shutil.copy(small_library / name, library / name)
    archive_library(library, base / "archive", workers=0)
    shutil.copy(small_library / names[2], library / names[2])
    shutil.copy(small_library / names[2], library / names[1])  # a new version of the second
    archive_library(library, base / "archive", workers=0)
    return base / "archive"


@pytest.fixture(scope="session")
def cluster() -> Iterator[Any]:
    """A Dask cluster of three worker processes."""
    from distributed import LocalCluster

    with (
        tempfile.TemporaryDirectory(prefix="motifold-dask-") as folder,
        LocalCluster(
            n_workers=3,
            threads_per_worker=1,
            dashboard_address=None,
            scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
            local_directory=folder,
        ) as running,
    ):
        yield running
