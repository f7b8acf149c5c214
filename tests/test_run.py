"""Jobs: the same bytes whoever does the work, whenever it is cut short, and only ever more."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from libraries import BAD, CLIPS, copied, counted_bytes, short_specs, tree, write_clips

from motifold.codec.blocks.motionmodel import fixed_model
from motifold.codec.errors import ArchiveError, UsageError
from motifold.codec.figure.bodyparts import load_parts
from motifold.codec.formats.files import clip_bytes, read_clip
from motifold.codec.geometry.metrics import measure
from motifold.codec.patterns.segments import SegmentRules, clip_segments
from motifold.codec.version2.motionfile import MotionFile
from motifold.codec.version2.motionhead import read_references
from motifold.pipeline import plan, run
from motifold.pipeline.archive import Archive
from motifold.pipeline.clustering import ClusterRules
from motifold.pipeline.commit import read_commit
from motifold.pipeline.executors import SerialExecutor
from motifold.pipeline.lock import NAME as LOCK
from motifold.pipeline.plan import Settings
from motifold.pipeline.report import Progress, Report
from motifold.pipeline.run import archive_library
from motifold.pipeline.verify import verify_archive

# Runs the job in a child that is killed at its n-th write to disk, once for each folder named.
# Children are forked from one process, because imports take longer than the job.
KILLED = """
import os, signal, sys
from pathlib import Path
import motifold.pipeline.run as run
from motifold.pipeline.plan import Settings
import motifold.pipeline.store, motifold.workflows.archive_command
library, *jobs = sys.argv[1:]
real, calls = os.fsync, 0
def child(archive, kill_at):
    def fsync(handle):
        global calls
        calls += 1
        if calls == kill_at:
            os.kill(os.getpid(), signal.SIGKILL)
        real(handle)
    os.fsync = fsync
    stages = set()
    def progress(step):
        if kill_at < 0 and step.stage not in stages:
            stages.add(step.stage)
            if len(stages) == -kill_at:
                os.kill(os.getpid(), signal.SIGKILL)
    run.archive_library(library, archive, workers=0, progress=progress)
    Path(archive + ".writes").write_text(str(calls))
for job in jobs:
    archive, kill_at = job.rsplit(":", 1)
    pid = os.fork()
    if pid == 0:
        child(archive, int(kill_at))
        os._exit(0)
    print(os.WTERMSIG(os.waitpid(pid, 0)[1]), flush=True)
"""


def run_killed(library: Path, jobs: list[tuple[Path, int]]) -> list[int]:
    """Run jobs that die at a write (or, if negative, a stage); return what signals ended them."""
    words = [f"{archive}:{kill_at}" for archive, kill_at in jobs]
    out = subprocess.run(
        [sys.executable, "-c", KILLED, str(library), *words],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert out.returncode == 0, out.stderr
    return [int(line) for line in out.stdout.split()]


def assert_whole(archive: Path, names: list[str]) -> None:
    with Archive(archive) as opened:
        assert list(opened) == sorted(names)
        found = verify_archive(opened, engine=SerialExecutor(), decode=True)
    assert found.problems == []
    assert found.decoded == len(names)


class HalfAndAll:
    """Archives of the clips of some actors in a library, and of those and all others."""

    def __init__(
        self, base: Path, names: list[str], small_library: Path, codec: str = "learned"
    ) -> None:
        settings = Settings(codec=codec)  # type: ignore[arg-type]
        self.names, self.first = names, [name for name in names if re.search("actor[1357]", name)]
        assert len(self.first) == len(names) // 2
        self.library = base / "library"
        self.library.mkdir()
        for name in self.first:
            shutil.copy(small_library / name, self.library)
        self.half, self.all = base / "half", base / "all"
        archive_library(self.library, self.half, settings, workers=0)
        for name in self.names:
            shutil.copy(small_library / name, self.library)
        copied(self.half, self.all)
        self.report = archive_library(self.library, self.all, settings, workers=0)


@pytest.fixture(scope="module")
def grown(tmp_path_factory: pytest.TempPathFactory, small_library: Path) -> HalfAndAll:
    names = sorted(path.name for path in small_library.iterdir())
    return HalfAndAll(tmp_path_factory.mktemp("grown"), names, small_library)


@pytest.fixture(scope="module")
def patterned(tmp_path_factory: pytest.TempPathFactory, small_library: Path) -> HalfAndAll:
    names = sorted(path.name for path in small_library.iterdir())
    return HalfAndAll(tmp_path_factory.mktemp("patterned"), names, small_library, "patterns")


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory, small_library: Path) -> HalfAndAll:
    """The same with four clips, for tests that run many jobs."""
    found = [*small_library.glob("jump*_take0[12]*"), *small_library.glob("run*_take0[12]*")]
    names = sorted(path.name for path in found)
    return HalfAndAll(tmp_path_factory.mktemp("quick"), names, small_library)


def test_every_clip_is_inside_the_tolerance_and_counted(
    small_library: Path, small_archive: Path
) -> None:
    with Archive(small_archive) as archive:
        rows = [row for row, _ in archive.rows.values()]
        assert sorted(archive) == sorted(path.name for path in small_library.iterdir())
        assert all(clip.certificate.maximum <= 0.1 for clip in archive.values())
    sizes = sum(path.stat().st_size for path in small_library.iterdir())
    assert sum(row.source_bytes for row in rows) == sizes
    assert not (small_archive / LOCK).exists()


STAGES = {"learned": ("survey", "sketch", "encode"), "patterns": ("survey", "cluster", "encode")}


@pytest.mark.parametrize("codec", STAGES)
def test_the_report_adds_up(codec: str, small_library: Path, tmp_path: Path) -> None:
    seen: list[Progress] = []
    settings = Settings(codec=codec)  # type: ignore[arg-type]
    report = archive_library(
        small_library, tmp_path / "a", settings, workers=0, progress=seen.append
    )
    assert report.clips == CLIPS
    assert report.unchanged == 0
    assert report.failures == []
    assert report.frames == 60 * CLIPS
    assert report.archive_bytes == counted_bytes(tmp_path / "a")
    files = tree(tmp_path / "a" / "clips")
    assert report.index_bytes == sum(map(len, files.values()))
    assert 0 < report.mean_error < report.max_error <= 0.1
    assert report.matched == report.segments
    assert (report.segments > 0) == (codec == "patterns")
    with Archive(tmp_path / "a") as archive:
        assert report.patterns == sum(map(sum, archive.commit.jobs[-1].patterns.values()))
        assert report.max_error == max(clip.certificate.maximum for clip in archive.values())
    for stage in STAGES[codec]:
        steps = [step for step in seen if step.stage == stage]
        assert steps[-1].done == steps[-1].clips == CLIPS
        assert report.seconds[stage] > 0
    assert seen[-1].source_bytes == report.source_bytes


def test_any_number_of_workers_writes_the_same_bytes(
    small_library: Path, cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plan, "BATCH_CLIPS", 2)  # enough batches to finish out of order
    archive_library(small_library, tmp_path / "serial", workers=0)
    archive_library(small_library, tmp_path / "dask", scheduler=cluster.scheduler_address)
    assert len(cluster.scheduler_info["workers"]) == 3
    assert tree(tmp_path / "dask") == tree(tmp_path / "serial")


def test_where_the_library_is_makes_no_difference(odd_library: Path, tmp_path: Path) -> None:
    shutil.copytree(odd_library, tmp_path / "elsewhere", symlinks=True)
    archive_library(odd_library, tmp_path / "a", workers=0)
    archive_library(tmp_path / "elsewhere", tmp_path / "b", workers=0)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")


def test_a_job_may_be_killed_at_any_moment(quick: HalfAndAll, tmp_path: Path) -> None:
    half, whole = tree(quick.half), tree(quick.all)
    probe = copied(quick.half, tmp_path / "probe")
    assert run_killed(quick.library, [(probe, 0)]) == [0]
    writes = int((tmp_path / "probe.writes").read_text())
    assert tree(probe) == whole
    new = len(quick.names) - len(quick.first)
    stages = [-2, -3]  # cluster, encode
    index_files, store, ledger = [new], [new + 3, (new + writes) // 2], [writes - 5]
    commit = [writes - 1, writes]  # before it has its name, and after
    moments = [*stages, *index_files, *store, *ledger, *commit]
    archives = [tmp_path / f"killed-{number}" for number in range(len(moments))]
    for archive in archives:
        copied(quick.half, archive)
    assert run_killed(quick.library, list(zip(archives, moments, strict=True))) == [9] * len(
        moments
    )
    published = []
    for archive in archives:
        after = tree(archive)
        assert LOCK in after, "the killed job could not remove its lock"
        published.append(read_commit(archive).generation == 2)
        if not published[-1]:
            assert half.items() <= after.items()
        assert_whole(archive, quick.names if published[-1] else quick.first)
        archive_library(quick.library, archive, workers=0)
        assert tree(archive) == whole
    assert published == [False] * (len(moments) - 1) + [True]


def test_the_very_first_job_may_be_killed_too(quick: HalfAndAll, tmp_path: Path) -> None:
    archive_library(quick.library, tmp_path / "whole", workers=0)
    whole = tree(tmp_path / "whole")
    archives = [(tmp_path / f"killed-{moment}", moment) for moment in (1, 4, 9)]
    assert run_killed(quick.library, archives) == [9] * 3
    for archive, _ in archives:
        archive_library(quick.library, archive, workers=0)
        assert tree(archive) == whole


def test_growing_touches_nothing_that_is_there(grown: HalfAndAll) -> None:
    assert grown.report.unchanged == CLIPS // 2
    assert grown.report.clips == CLIPS - CLIPS // 2
    before, after = tree(grown.half), tree(grown.all)
    for name, data in before.items():
        if name != "COMMIT.json":
            assert after[name] == data
            old, new = (folder / name for folder in (grown.half, grown.all))
            assert old.stat().st_mtime_ns == new.stat().st_mtime_ns
    with Archive(grown.half) as half, Archive(grown.all) as whole:
        for name in grown.first:
            assert half[name].row == whole[name].row
            mine, theirs = (clip_bytes(opened[name].decode(), "npz") for opened in (half, whole))
            assert mine == theirs
        assert [rig.key for rig in half.store.rigs] == [
            rig.key for rig in whole.store.rigs[: len(half.store.rigs)]
        ]
        assert whole.store.rigs[len(half.store.rigs) :], "the second half has rigs of its own"
        for key, parts in half.store.patterns.items():
            for fewer, more in zip(parts, whole.store.patterns[key], strict=True):
                np.testing.assert_array_equal(fewer, more[: len(fewer)])


def test_the_store_saves_what_a_second_half_needs(patterned: HalfAndAll) -> None:
    first = read_commit(patterned.half).jobs[0].patterns
    second = read_commit(patterned.all).jobs[1].patterns
    (key,) = first
    added = sum(second[key]) - sum(first[key])
    assert 0 < added < sum(first[key]), "half of the motion is as before"


def test_nothing_new_publishes_nothing(grown: HalfAndAll, tmp_path: Path) -> None:
    archive = copied(grown.all, tmp_path / "a")
    before = tree(archive)
    report = archive_library(grown.library, archive, workers=0)
    assert (report.clips, report.unchanged, report.failures) == (0, CLIPS, [])
    assert tree(archive) == before


def test_files_that_go_on_failing_publish_nothing_new(odd_library: Path, tmp_path: Path) -> None:
    first = archive_library(odd_library, tmp_path / "a", workers=0)
    before = tree(tmp_path / "a")
    again = archive_library(odd_library, tmp_path / "a", workers=0)
    assert again.failures == first.failures
    assert tree(tmp_path / "a") == before


def test_a_changed_file_is_archived_again_and_wins(grown: HalfAndAll, tmp_path: Path) -> None:
    library, archive = copied(grown.library, tmp_path / "l"), copied(grown.all, tmp_path / "a")
    changed, other = grown.first[0], grown.names[-1]
    (library / changed).write_bytes((library / other).read_bytes())
    report = archive_library(library, archive, workers=0)
    assert (report.clips, report.unchanged) == (1, CLIPS - 1)
    with Archive(archive) as opened:
        assert len(opened) == CLIPS
        assert opened[changed].generation == 3
        assert opened[changed].frames == opened[other].frames
        away = opened[changed].positions - opened[other].positions
        assert np.abs(away).max() < 2 * 0.1, "both are the same motion now"
        found = verify_archive(opened, engine=SerialExecutor(), library=library)
    assert found.problems == []
    assert found.measured == CLIPS


def test_a_file_that_breaks_keeps_its_last_good_version(grown: HalfAndAll, tmp_path: Path) -> None:
    library, archive = copied(grown.library, tmp_path / "l"), copied(grown.all, tmp_path / "a")
    (library / grown.first[0]).write_bytes(b"torn")
    (library / grown.first[1]).unlink()
    report = archive_library(library, archive, workers=0)
    assert [failure.name for failure in report.failures] == [grown.first[0]]
    assert_whole(archive, grown.names)


def test_a_tighter_tolerance_archives_again_and_a_looser_one_does_not(
    grown: HalfAndAll, tmp_path: Path
) -> None:
    archive = copied(grown.half, tmp_path / "a")
    globs = grown.first[:2]

    def again(tolerance: float) -> Report:
        settings = Settings(tolerance=tolerance)
        return archive_library(grown.library, archive, settings, include=globs, workers=0)

    assert again(1.0).clips == 0
    assert again(0.01).clips == 2
    assert again(0.1).clips == 0
    with Archive(archive) as opened:
        for name in globs:
            assert opened[name].certificate.maximum <= opened[name].tolerance == 0.01
    assert_whole(archive, grown.first)


def test_other_units_archive_again(grown: HalfAndAll, tmp_path: Path) -> None:
    archive = copied(grown.half, tmp_path / "a")
    report = archive_library(
        grown.library, archive, Settings(units="in"), include=grown.first[:1], workers=0
    )
    assert report.clips == 1
    with Archive(archive) as opened:
        small, large = (opened[name].skeleton.offsets for name in grown.first[1::-1])
        assert np.abs(large).max() > 2 * np.abs(small).max()


def test_bad_files_stop_nothing_and_are_written_down(odd_library: Path, odd_archive: Path) -> None:
    with Archive(odd_archive) as archive:
        (ledger,) = archive.ledgers.values()
        assert {failure.name for failure in ledger.failures} == set(BAD)
        for failure in ledger.failures:
            assert BAD[failure.name] in failure.reason
        assert not set(archive) & set(BAD)
        found = verify_archive(archive, engine=SerialExecutor(), library=odd_library)
        assert found.problems == []
        assert found.measured == len(archive) == 6


def test_a_library_of_bad_files_only_is_reported(tmp_path: Path) -> None:
    (tmp_path / "l").mkdir()
    (tmp_path / "l" / "a.bvh").write_bytes(b"torn")
    report = archive_library(tmp_path / "l", tmp_path / "a", workers=0)
    assert (report.clips, len(report.failures)) == (0, 1)
    assert_whole(tmp_path / "a", [])


def test_every_segment_is_within_the_radius_of_the_pattern_that_stands_for_it(
    patterned: HalfAndAll,
) -> None:
    from motifold.codec.formats.files import read_clip
    from motifold.codec.patterns.segments import most_frames
    from motifold.codec.version1.index_file import IndexFile
    from motifold.codec.version1.layers import read_preview

    rules = ClusterRules()
    with Archive(patterned.all) as archive:
        for clip in archive.values():
            index = clip.index()
            assert isinstance(index, IndexFile)
            codebook = archive.codebook(clip.rig.family_key, index.generation)
            family = codebook.family
            preview, _ = read_preview(
                index.preview, clip.rig, codebook, index.frames, most_frames(clip.frame_time)
            )
            source = read_clip(patterned.library / clip.name)
            radius = rules.radius(family.head_diagonal, 0.1)
            segments = clip_segments(source, family, SegmentRules())
            for part, named, table in zip(
                segments, preview.parts, codebook.centimetres, strict=True
            ):
                if part is None or named is None:
                    continue
                assert (named.patterns >= 0).all(), "a segment without a pattern"
                away = part.points - table[named.patterns]
                joints = away.reshape(*away.shape[:2], -1, 3)
                rms = np.sqrt(np.square(joints).sum(axis=3).mean(axis=(1, 2)))
                assert (rms <= radius + 1e-6).all()


@pytest.mark.parametrize(
    "settings",
    [
        Settings(segments=SegmentRules("fisher")),
        Settings(clusters=ClusterRules("average"), seed=3),
        Settings(tolerance=1.0, clusters=ClusterRules(radius_coefficient=0.0)),
    ],
    ids=["fisher", "average", "no radius"],
)
def test_every_setting_keeps_the_promise(
    small_library: Path, tmp_path: Path, settings: Settings
) -> None:
    names = sorted(path.name for path in small_library.iterdir())[:4]
    report = archive_library(small_library, tmp_path / "a", settings, include=names, workers=0)
    again = archive_library(small_library, tmp_path / "b", settings, include=names, workers=0)
    assert tree(tmp_path / "a") == tree(tmp_path / "b")
    assert report.max_error == again.max_error <= settings.tolerance
    assert_whole(tmp_path / "a", names)


def test_body_parts_may_be_named(tmp_path: Path) -> None:
    write_clips(tmp_path / "l", short_specs(1))
    (tmp_path / "parts.toml").write_text('[parts.thinking]\njoints = ["Head"]\n')
    parts = load_parts(tmp_path / "parts.toml")
    archive_library(tmp_path / "l", tmp_path / "a", parts=parts, workers=0)
    with Archive(tmp_path / "a") as archive:
        (clip,) = archive.values()
        assert "thinking" in [part.name for part in clip.rig.parts]


def test_many_clips_are_clustered_in_rounds(
    small_library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plan, "BATCH_CLIPS", 2)
    monkeypatch.setattr(run, "ROUND_CLIPS", 5)
    report = archive_library(small_library, tmp_path / "a", workers=0)
    assert report.matched == report.segments
    assert_whole(tmp_path / "a", [path.name for path in small_library.iterdir()])


def test_equal_clips_share_an_index_file(tmp_path: Path) -> None:
    (name,) = write_clips(tmp_path / "l", short_specs(1))
    for copy in ("a.bvh", "b/c.bvh"):
        (tmp_path / "l" / "b").mkdir(exist_ok=True)
        shutil.copy(tmp_path / "l" / name, tmp_path / "l" / copy)
    archive_library(tmp_path / "l", tmp_path / "a", workers=0)
    assert len(tree(tmp_path / "a" / "clips")) == 1
    assert_whole(tmp_path / "a", ["a.bvh", "b/c.bvh", name])


def test_files_whose_names_begin_alike_are_told_apart(
    small_library: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    archive_library(small_library, tmp_path / "usual", workers=0)
    monkeypatch.setattr(run, "name_of", lambda data: "0" * 12)
    archive_library(small_library, tmp_path / "alike", workers=0)
    with Archive(tmp_path / "usual") as usual, Archive(tmp_path / "alike") as alike:
        names = [clip.row.index for clip in alike.values()]
        assert len(set(names)) == len(names)
        assert {len(name) for name in names} == {12, 16}
        for name, clip in usual.items():
            assert clip.path.read_bytes() == alike[name].path.read_bytes()


def test_a_folder_of_somebody_else_s_is_not_taken_for_an_archive(tmp_path: Path) -> None:
    library = tmp_path / "library"
    write_clips(library / "clips" / "walks", short_specs(2))
    before = tree(library)
    with pytest.raises(UsageError, match="is no archive"):
        archive_library(library, library, workers=0)
    assert tree(library) == before


def test_an_archive_that_lost_its_commit_loses_no_more(grown: HalfAndAll, tmp_path: Path) -> None:
    archive = copied(grown.all, tmp_path / "a")
    (archive / "COMMIT.json").unlink()
    before = tree(archive)
    with pytest.raises(UsageError, match=r"no COMMIT\.json"):
        archive_library(grown.library, archive, workers=0)
    assert tree(archive) == before


def test_a_disk_that_is_full_is_told_and_harms_nothing(
    grown: HalfAndAll, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import os

    archive = copied(grown.half, tmp_path / "a")
    real, calls = os.fsync, 0

    def fsync(handle: int) -> None:
        nonlocal calls
        calls += 1
        if calls == 5:
            raise OSError(28, "No space left on device")
        real(handle)

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(ArchiveError, match="No space left on device"):
        archive_library(grown.library, archive, workers=0)
    assert_whole(archive, grown.first)
    archive_library(grown.library, archive, workers=0)
    assert tree(archive) == tree(grown.all)


def test_one_process_may_write_an_archive_twice(small_library: Path, tmp_path: Path) -> None:
    """What a job left for its workers is not taken for what the next one leaves."""
    names = sorted(path.name for path in small_library.iterdir())
    archive = tmp_path / "a"
    for seed in (0, 1):
        shutil.rmtree(archive, ignore_errors=True)
        archive_library(small_library, archive, Settings(seed=seed), workers=0)
        assert_whole(archive, names)
        with Archive(archive) as opened:
            for name in names:
                decoded = opened[name].decode()
                certificate = opened[name].certificate
                assert measure(read_clip(small_library / name), decoded).maximum <= (
                    certificate.maximum + 1e-6
                )


LEFT_OUT = ("basis", "parents", "contexts", "world", "mirrors")


@pytest.mark.parametrize(
    "changes",
    [
        {"references": 0},
        {"model": "basis"},
        {"model": "fixed"},
        *({"without": (name,)} for name in LEFT_OUT),
    ],
)
def test_parts_of_the_codec_can_be_left_out(
    changes: dict[str, Any], small_library: Path, tmp_path: Path
) -> None:
    settings = Settings(**changes)
    report = archive_library(small_library, tmp_path / "a", settings, workers=0)
    assert_whole(tmp_path / "a", sorted(path.name for path in small_library.iterdir()))
    assert report.max_error <= settings.tolerance
    with Archive(tmp_path / "a") as archive:
        files = [clip.index() for clip in archive.values()]
        assert all(isinstance(file, MotionFile) for file in files)
        if changes.get("model") == "fixed":
            assert not archive.store.models
        if changes.get("references") == 0:
            assert not any(read_references(file) for file in files if isinstance(file, MotionFile))
        for name in settings.without:
            assert_left_out(archive, name)


def assert_left_out(archive: Archive, name: str) -> None:
    """No joint of the archive's families, and no learned row, has what was left out."""
    store = archive.store
    if name == "mirrors":
        files = [clip.index() for clip in archive.values()]
        assert not any(isinstance(file, MotionFile) and file.mirrored for file in files)
        return
    if name == "world":
        for family in store.families.values():
            assert family.hinged == tuple(range(1, len(family.levers)))
        return
    assert store.models or name == "basis"
    for model in store.models.values():
        plain = fixed_model(model.rows, model.span, model.up)
        learned = {
            field: [
                row
                for row in range(model.rows)
                if not np.array_equal(getattr(model, field)[row], getattr(plain, field)[row])
            ]
            for field in ("folded_weights", "folded_basis", "senses")
        }
        if name == "basis":
            assert not learned["folded_basis"]
        elif name == "parents":
            guided = slice(15, 27 + 6 * model.span)
            assert learned["folded_weights"]
            assert not model.folded_weights[learned["folded_weights"], guided].any()
        else:
            assert learned["senses"]
            assert not model.senses[learned["senses"]].any()
