from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from library import library_path

from motifold.codec.clip import Layout, MarkerClip, Skeleton, SkeletonClip
from motifold.codec.errors import FormatError, InputError, UnsupportedError, UsageError
from motifold.codec.formats.files import (
    READABLE,
    WRITABLE,
    clip_bytes,
    default_format,
    read_clip,
    source_bytes,
)

BVH = b"""HIERARCHY
ROOT hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT head { OFFSET 0 70 0 CHANNELS 1 Zrotation End Site { OFFSET 0 100 0 } }
}
MOTION
Frames: 1
Frame Time: 0.01
1 2 3 90 0 0 0
"""
ASF = b"""
:units
length 1
:root
order TX TY TZ RX RY RZ
:bonedata
begin
name leg
direction 0 -1 0
length 30
axis 0 0 0 XYZ
end
:hierarchy
root leg
"""
AMC = b":DEGREES\n1\nroot 1 2 3 4 5 6\n"


def markers() -> MarkerClip:
    positions = np.arange(12.0).reshape(2, 2, 3)
    positions[1, 0] = np.nan
    return MarkerClip(("a", "b"), 0.01, positions, Layout("trc", "mm", "declared", 0.1))


def skeleton_clip(folder: Path) -> SkeletonClip:
    (folder / "a.bvh").write_bytes(BVH)
    clip = read_clip(folder / "a.bvh")
    assert isinstance(clip, SkeletonClip)
    return clip


@pytest.mark.parametrize("name", ["walk.bvh", "WALK.BVH", "walk.1.Bvh"])
def test_the_suffix_says_the_format(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(BVH)
    clip = read_clip(str(tmp_path / name), "m")
    assert isinstance(clip, SkeletonClip)
    assert clip.layout.unit_source == "given"
    assert source_bytes(tmp_path / name) == BVH


@pytest.mark.parametrize(
    "names", [["01.asf", "02.asf"], ["01_01.asf", "02.asf"], ["01.ASF", "z.asf"], ["other.asf"]]
)
def test_the_skeleton_of_a_motion_is_found(tmp_path: Path, names: list[str]) -> None:
    (tmp_path / "01_01.amc").write_bytes(AMC)
    for name in names:
        (tmp_path / name).write_bytes(ASF if name == names[0] else b"wrong")
    clip = read_clip(tmp_path / "01_01.amc")
    assert isinstance(clip, SkeletonClip)
    assert clip.skeleton.names == ("root", "leg")
    assert source_bytes(tmp_path / "01_01.amc") == AMC + ASF


@pytest.mark.parametrize("names", [[], ["02.asf", "03.asf"]])
def test_a_motion_without_skeleton_says_what_was_looked_for(
    tmp_path: Path, names: list[str]
) -> None:
    (tmp_path / "01_01.amc").write_bytes(AMC)
    for name in names:
        (tmp_path / name).write_bytes(ASF)
    with pytest.raises(InputError, match=r"01_01\.amc: .*looked for 01_01\.asf or 01\.asf"):
        read_clip(tmp_path / "01_01.amc")
    with pytest.raises(InputError, match=r"looked for"):
        source_bytes(tmp_path / "01_01.amc")


def test_errors_name_the_file(tmp_path: Path) -> None:
    for suffix in READABLE:
        with pytest.raises(InputError, match="gone" + suffix):
            read_clip(tmp_path / f"gone{suffix}")
        (tmp_path / "x.asf").write_bytes(ASF)
        (tmp_path / f"junk{suffix}").write_bytes(b"junk\x00\xff")
        with pytest.raises(FormatError, match=f"junk{suffix}"):
            read_clip(tmp_path / f"junk{suffix}")
        (tmp_path / f"folder{suffix}").mkdir()
        with pytest.raises(InputError, match=f"folder{suffix}"):
            read_clip(tmp_path / f"folder{suffix}")
        with pytest.raises(InputError, match=f"folder{suffix}"):
            source_bytes(tmp_path / f"folder{suffix}")
    (tmp_path / "x.asf").write_bytes(b"junk")
    (tmp_path / "x.amc").write_bytes(AMC)
    with pytest.raises(FormatError, match=r"x\.asf"):
        read_clip(tmp_path / "x.amc")


@pytest.mark.parametrize("name", ["walk.fbx", "walk"])
def test_other_formats_are_unsupported(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(BVH)
    with pytest.raises(UnsupportedError, match=rf"{name}: .*motifold reads"):
        read_clip(tmp_path / name)


def test_units_must_be_known(tmp_path: Path) -> None:
    (tmp_path / "a.bvh").write_bytes(BVH)
    with pytest.raises(UsageError):
        read_clip(tmp_path / "a.bvh", "cubit")


def test_every_clip_is_written_in_its_formats_only(tmp_path: Path) -> None:
    for clip, formats in ((skeleton_clip(tmp_path), {"bvh", "npz"}), (markers(), {"trc", "npz"})):
        assert default_format(clip) in formats
        for format in (*WRITABLE, "fbx", ""):
            if format in formats:
                assert clip_bytes(clip, format)
            else:
                with pytest.raises(UsageError, match=default_format(clip)):
                    clip_bytes(clip, format)


def test_default_formats_read_back(tmp_path: Path) -> None:
    for clip in (skeleton_clip(tmp_path), markers()):
        path = tmp_path / f"again.{default_format(clip)}"
        path.write_bytes(clip_bytes(clip, default_format(clip)))
        again = read_clip(path)
        if isinstance(clip, SkeletonClip) and isinstance(again, SkeletonClip):
            np.testing.assert_allclose(again.rotations, clip.rotations, atol=1e-6)
        elif isinstance(clip, MarkerClip) and isinstance(again, MarkerClip):
            np.testing.assert_allclose(again.positions, clip.positions, atol=1e-5)
        else:
            pytest.fail("the kind of clip changed")


def test_npz_of_a_skeleton(tmp_path: Path) -> None:
    clip = skeleton_clip(tmp_path)
    content = clip_bytes(clip, "npz")
    assert content == clip_bytes(clip, "npz")
    with np.load(io.BytesIO(content)) as arrays:
        assert set(arrays) == {
            "names", "parents", "offsets", "frame_time", "rotations", "translations", "positions",
            "end_parents", "end_offsets", "units",
        }  # fmt: skip
        assert arrays["names"].tolist() == ["hips", "head"]
        assert arrays["units"] == "cm"
        assert arrays["frame_time"] == 0.01
        # the hips are turned by 90 degrees about z: up becomes -x
        np.testing.assert_allclose(arrays["positions"], [[[1, 2, 3], [-69, 2, 3]]], atol=1e-12)


def test_npz_of_markers() -> None:
    clip = markers()
    with np.load(io.BytesIO(clip_bytes(clip, "npz"))) as arrays:
        assert set(arrays) == {"names", "positions", "seen", "frame_time", "units"}
        assert arrays["seen"].tolist() == [[True, True], [False, True]]
        np.testing.assert_array_equal(arrays["positions"], clip.positions)


def test_npz_holds_any_name() -> None:
    skeleton = Skeleton(("Hüfte 腰",), np.array([-1]), np.zeros((1, 3)))
    layout = Layout("bvh", "cm", "given", 1.0)
    empty = SkeletonClip(skeleton, 0.1, np.zeros((0, 1, 3, 3)), np.zeros((0, 1, 3)), layout)
    with np.load(io.BytesIO(clip_bytes(empty, "npz"))) as arrays:
        assert arrays["names"].tolist() == ["Hüfte 腰"]
        assert arrays["positions"].shape == (0, 1, 3)


@pytest.mark.library
def test_real_motions_find_their_skeletons() -> None:
    paths = sorted(library_path("cmu_amc").rglob("*_01.amc"))
    assert paths
    for path in paths:
        clip = read_clip(path)
        assert isinstance(clip, SkeletonClip)
        assert clip.skeleton.joints == 31
        assert clip.layout.unit_source == "declared"
