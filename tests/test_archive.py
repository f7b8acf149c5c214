"""Open archives: a mapping that decodes when asked, from threads and other processes too."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from libraries import CLIPS, STRANGE_NAME, copied, marker_course, short_specs, write_clips
from scipy.spatial.transform import Rotation

from motifold.codec.clip import Clip, MarkerClip, SkeletonClip
from motifold.codec.errors import (
    DamagedError,
    NotAnArchiveError,
    UnknownClipError,
    UsageError,
)
from motifold.codec.formats.files import read_clip
from motifold.codec.geometry.kinematics import world_positions, world_rotations
from motifold.pipeline.archive import Archive
from motifold.pipeline.archived_clip import ArchivedClip
from motifold.pipeline.clustering import ClusterRules
from motifold.pipeline.commit import Commit
from motifold.pipeline.plan import Settings
from motifold.pipeline.run import archive_library


@pytest.fixture(scope="module")
def archive(small_archive: Path) -> Archive:
    return Archive(small_archive)


@pytest.fixture(scope="module")
def odd(odd_archive: Path) -> Archive:
    return Archive(odd_archive)


def positions(clip: Clip) -> np.ndarray:
    if isinstance(clip, MarkerClip):
        return clip.positions
    world = world_rotations(clip.skeleton, clip.rotations)
    return world_positions(clip.skeleton, world, clip.translations)


def same(one: Clip, other: Clip) -> None:
    """Two clips are bit for bit the same."""
    np.testing.assert_array_equal(positions(one), positions(other))
    if isinstance(one, SkeletonClip):
        assert isinstance(other, SkeletonClip)
        np.testing.assert_array_equal(one.rotations, other.rotations)


class TestMapping:
    """What `collections.abc.Mapping` promises."""

    def test_it_is_a_mapping(self, archive: Archive, small_library: Path) -> None:
        assert isinstance(archive, Mapping)
        names = sorted(path.name for path in small_library.iterdir())
        assert list(archive) == list(archive.keys()) == names
        assert len(archive) == len(names) == CLIPS
        assert bool(archive)

    def test_keys_values_and_items_agree(self, archive: Archive) -> None:
        assert [clip.name for clip in archive.values()] == list(archive.keys())
        for name, clip in archive.items():
            assert isinstance(clip, ArchivedClip)
            assert clip.name == archive[name].name == name
            assert name in archive
            assert name in archive.keys()  # noqa: SIM118 - the view is what is tested

    def test_what_is_not_there(self, archive: Archive) -> None:
        missing: Any
        for missing in ("nobody.bvh", "", 7, None):
            assert missing not in archive
            assert archive.get(missing) is None
            with pytest.raises(KeyError):
                archive[missing]

    def test_it_is_read_only(self, archive: Archive) -> None:
        for method in ("__setitem__", "__delitem__", "pop", "update"):
            assert not hasattr(archive, method)

    def test_iterating_twice_gives_the_same(self, archive: Archive) -> None:
        first, second = iter(archive), iter(archive)
        assert next(first) == next(second)


def test_an_unknown_name_brings_suggestions(archive: Archive) -> None:
    name = next(iter(archive))
    with pytest.raises(UnknownClipError, match=f"Did you mean .*{name}") as caught:
        archive[name.replace("_", "-")]
    assert "'" not in str(caught.value)[:1], "not in quotes as other KeyErrors"
    with pytest.raises(UnknownClipError, match="See: motifold info"):
        archive["#"]


def test_names_are_found_without_suffix_and_by_glob(archive: Archive, odd: Archive) -> None:
    name = next(iter(archive))
    assert archive.find(name) == archive.find(name.removesuffix(".bvh")) == [name]
    assert archive.find("*") == list(archive)
    assert archive.find("run_*") == [each for each in archive if each.startswith("run_")]
    assert odd.find("markers/sway") == ["markers/sway.c3d", "markers/sway.trc"]
    with pytest.raises(UnknownClipError):
        archive.find("nothing*")


def test_where_there_is_no_archive(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(NotAnArchiveError):
            Archive(path)


def test_a_closed_archive_answers_no_more(small_archive: Path) -> None:
    with Archive(small_archive) as opened:
        clip = next(iter(opened.values()))
        clip.decode()
    for ask in (lambda: len(opened), lambda: list(opened), lambda: opened["x"], clip.decode):
        with pytest.raises(UsageError, match="closed"):
            ask()


def test_clips_tell_of_themselves(archive: Archive, small_library: Path) -> None:
    for clip in archive.values():
        source = small_library / clip.name
        original = read_clip(source)
        assert isinstance(original, SkeletonClip)
        assert clip.frames == original.frames == 60
        assert clip.frame_time == original.frame_time
        assert clip.seconds == pytest.approx(2.0, abs=1e-3)
        assert clip.skeleton.names == original.skeleton.names
        np.testing.assert_array_equal(clip.skeleton.offsets, original.skeleton.offsets)
        assert clip.repairs == original.repairs
        assert clip.tolerance == 0.1
        assert clip.row.source_bytes == source.stat().st_size
        assert clip.generation == 1


@pytest.mark.parametrize("tolerance", [0.01, 0.1, 1.0])
def test_the_certificate_holds_when_somebody_else_measures(
    small_library: Path, tmp_path: Path, tolerance: float
) -> None:
    names = sorted(path.name for path in small_library.iterdir())[::4]
    archive_library(
        small_library, tmp_path / "a", Settings(tolerance=tolerance), include=names, workers=0
    )
    with Archive(tmp_path / "a") as opened:
        for name, clip in opened.items():
            original, decoded = oracle.read_bvh(small_library / name), oracle.of_clip(clip.clip)
            error = oracle.shell_error(original, decoded)
            certificate = clip.certificate
            assert error.max() <= certificate.maximum * (1 + 1e-6) <= tolerance * (1 + 1e-6)
            assert error.max() == pytest.approx(certificate.maximum, rel=8e-4)
            # both are kept as shares of the maximum, rounded up by a sixteenth octave at most
            for exact, certified in (
                (error.mean(), certificate.mean),
                (np.percentile(error, 99), certificate.percentile_99),
            ):
                assert exact <= certified * (1 + 1e-6) <= exact * 2 ** (1 / 16) * (1 + 1e-6)


def test_the_certificate_of_markers_holds(odd: Archive) -> None:
    original = marker_course() / 10
    for name in ("markers/sway.c3d", "markers/sway.trc"):
        error = np.linalg.norm(odd[name].positions - original, axis=2)
        assert np.nanmax(error) <= odd[name].certificate.maximum + 1e-4
    gaps = np.asarray(np.isnan(odd["markers/sway.trc"].positions).any(axis=2))
    assert gaps[10:20, 3].all()
    assert gaps.sum() == 10


def test_arrays_are_what_they_say(archive: Archive) -> None:
    clip = next(iter(archive.values()))
    joints = clip.skeleton.joints
    assert clip.rotations.shape == (60, joints, 3, 3)
    assert clip.quaternions.shape == (60, joints, 4)
    assert (clip.quaternions[..., 0] >= 0).all()
    scipy_order = clip.quaternions[..., [1, 2, 3, 0]].reshape(-1, 4)
    rotation: Any = Rotation
    matrices = rotation.from_quat(scipy_order).as_matrix().reshape(clip.rotations.shape)
    np.testing.assert_allclose(matrices, clip.rotations, atol=1e-9)
    _, expected = oracle.pose(oracle.of_clip(clip.clip))
    np.testing.assert_allclose(clip.positions, expected, atol=1e-9)


def test_markers_have_no_rotations(odd: Archive) -> None:
    clip = odd["markers/sway.trc"]
    assert clip.positions.shape == (50, 8, 3)
    for name in ("rotations", "quaternions"):
        with pytest.raises(UsageError, match="markers"):
            getattr(clip, name)


@settings(max_examples=30)
@given(st.data())
def test_a_time_range_is_a_slice(archive: Archive, data: st.DataObject) -> None:
    clip = archive[data.draw(st.sampled_from(list(archive)[:3]))]
    start = data.draw(st.integers(-70, 70))
    stop = data.draw(st.none() | st.integers(-70, 70))
    part = clip.decode(start=start, stop=stop)
    assert isinstance(part, SkeletonClip)
    np.testing.assert_array_equal(part.rotations, clip.rotations[start:stop])
    assert isinstance(clip.clip, SkeletonClip)
    np.testing.assert_array_equal(part.translations, clip.clip.translations[start:stop])
    assert part.frames == len(range(60)[start:stop])


@pytest.mark.parametrize("tier", ["tolerance", "preview"])
def test_one_part_is_the_whole_clip_on_its_joints(
    archive: Archive, odd: Archive, tier: Any
) -> None:
    for clip in (next(iter(archive.values())), odd["07_01.amc"], odd["markers/sway.trc"]):
        whole = clip.decode(tier)
        parts = clip.rig.parts
        for part in parts:
            own = clip.decode(tier, parts=[part.name])
            above, number = set(part.joints), part.parent
            while number >= 0:
                above |= set(parts[number].joints)
                number = parts[number].parent
            joints = sorted(above)
            np.testing.assert_array_equal(positions(own)[:, joints], positions(whole)[:, joints])
            if isinstance(own, SkeletonClip) and isinstance(whole, SkeletonClip):
                np.testing.assert_array_equal(own.rotations[:, joints], whole.rotations[:, joints])
            else:
                others = sorted(set(range(clip.rig.skeleton.joints)) - above)
                assert np.isnan(positions(own)[:, others]).all()
        everything = clip.decode(tier, parts=[part.name for part in parts])
        same(everything, whole)
    with pytest.raises(UsageError, match="no body part tail"):
        clip.decode(parts=["tail"])


def test_the_root_path_is_the_tolerance_tier_s_exactly(archive: Archive, odd: Archive) -> None:
    for clip in [*archive.values(), *odd.values()]:
        joint = clip.rig.parts[0].reference
        np.testing.assert_array_equal(clip.root_path, clip.positions[:, joint])


def test_the_preview_is_like_the_clip(archive: Archive, odd: Archive) -> None:
    for opened, clip in [(a, clip) for a in (archive, odd) for clip in a.values()]:
        family = opened.store.families[clip.rig.family_key]
        radius = ClusterRules().radius(family.head_diagonal, clip.tolerance)
        preview = clip.decode("preview")
        away = np.linalg.norm(positions(preview) - clip.positions, axis=2)
        assert np.sqrt(np.nanmean(away**2)) < 2 * radius
        assert np.nanmax(away) < 12 * radius
        gaps = np.isnan(away)
        np.testing.assert_array_equal(gaps, np.isnan(clip.positions).any(axis=2))


def test_many_threads_see_what_one_does(small_archive: Path, archive: Archive) -> None:
    with Archive(small_archive) as shared:
        names = list(archive) * 2
        start = threading.Barrier(8)

        def work(place: int) -> list[np.ndarray]:
            start.wait()  # all of them find the archive unread
            return [shared[name].decode().rotations for name in names[place::8]]  # type: ignore[union-attr]

        with ThreadPoolExecutor(8) as pool:
            found = list(pool.map(work, range(8)))
    for place, clips in enumerate(found):
        for name, rotations in zip(names[place::8], clips, strict=True):
            np.testing.assert_array_equal(rotations, archive[name].rotations)


def decoded_there(archive: Archive, name: str) -> tuple[np.ndarray, int]:
    return archive[name].positions, id(archive)


def test_it_works_on_a_dask_worker(archive: Archive, cluster: Any) -> None:
    from distributed import Client

    with Client(cluster, set_as_default=False) as client:
        worker = next(iter(client.nthreads()))
        tasks = [
            client.submit(decoded_there, archive, name, workers=[worker], pure=False)
            for name in list(archive)[:3]
        ]
        found = client.gather(tasks)
    for name, (there, _) in zip(archive, found, strict=False):
        np.testing.assert_array_equal(there, archive[name].positions)
    assert len({place for _, place in found}) == 1, "read once, not once a task"


def test_a_pickled_archive_is_the_one_that_was_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    library = tmp_path / "l"
    write_clips(library, short_specs(2))
    archive_library(library, "a", include=["*take01*"], workers=0)
    old = Archive("a")
    names, sent = list(old), pickle.dumps(old)
    archive_library(library, "a", workers=0)
    monkeypatch.chdir("/")  # workers may be elsewhere
    there = pickle.loads(sent)
    assert list(there) == names
    assert there.commit == old.commit
    assert pickle.loads(sent) is there, "opened once a process"
    there.close()
    assert list(pickle.loads(sent)) == names, "not the closed one"


def test_a_pickled_archive_does_not_become_another_one(tmp_path: Path) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    write_clips(first, short_specs(1))
    write_clips(second, short_specs(1, start=5))
    archive_library(first, tmp_path / "a", workers=0)
    sent = pickle.dumps(Archive(tmp_path / "a"))
    pickle.loads(sent)
    (tmp_path / "a").rename(tmp_path / "b")
    archive_library(second, tmp_path / "a", workers=0)
    (name,) = [path.name for path in second.iterdir()]
    assert list(pickle.loads(pickle.dumps(Archive(tmp_path / "a")))) == [name]


def test_readers_that_are_open_while_a_job_publishes_see_the_old_state(tmp_path: Path) -> None:
    library = tmp_path / "l"
    write_clips(library, short_specs(4))
    archive_library(library, tmp_path / "a", include=["*take01*"], workers=0)
    before = Archive(tmp_path / "a")  # has read nothing but COMMIT.json
    counts: set[int] = set()
    done = threading.Event()

    def read() -> None:
        while not done.is_set():
            with Archive(tmp_path / "a") as opened:
                counts.add(len([clip.decode() for clip in opened.values()]))

    reader = threading.Thread(target=read)
    reader.start()
    archive_library(library, tmp_path / "a", workers=0)
    done.set()
    reader.join()
    assert counts <= {2, 4}
    assert len(before) == 2
    assert all(clip.decode().frames == 60 for clip in before.values())
    assert len(Archive(tmp_path / "a")) == 4


def test_an_empty_archive_is_an_empty_mapping(tmp_path: Path) -> None:
    from motifold.pipeline.commit import publish

    publish(tmp_path, Commit())
    with Archive(tmp_path) as opened:
        assert (len(opened), list(opened), dict(opened)) == (0, [], {})


def test_file_names_need_not_be_text(odd: Archive) -> None:
    assert STRANGE_NAME in odd
    assert odd[STRANGE_NAME].decode().frames == 60


@pytest.mark.parametrize("how", ["gone", "torn", "swapped"])
def test_a_bad_index_file_is_named_and_costs_no_other_clip(
    small_archive: Path, tmp_path: Path, how: str
) -> None:
    with Archive(copied(small_archive, tmp_path / "a")) as opened:
        bad, other = list(opened.values())[:2]
        if how == "gone":
            bad.path.unlink()
        elif how == "torn":
            bad.path.write_bytes(bad.path.read_bytes()[:-5])
        else:
            bad.path.write_bytes(list(opened.values())[-1].path.read_bytes())
        with pytest.raises(DamagedError, match=bad.path.name):
            bad.decode()
        other.decode()
