"""Archives made for a comparison: whole folders, measured as independent code measures them."""

from __future__ import annotations

import sys
import zlib
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import cast

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

import ablations
import acl_comparison
import archive_runs
import job_settings
import numpy as np
import pytest
from acl_comparison import AclPrecision, compare_acl
from archive_runs import ArchiveRuns
from general_compressors import compare_text
from job_settings import MAX_PER_MEAN, parse_changes, settings_for, with_overrides
from libraries import amc_text, asf_text, counted_bytes, short_specs, write_clips
from library_growth import growth_sizes, measure_growth
from motion_sets import SETS, chosen, clip_files, link_library
from oracle_files import joint_distances, read_pair
from rate_curves import Bound, Run
from rate_distortion import code_state, write
from targets import GROWTH_CLIPS

from motifold.codec.formats.files import read_clip
from motifold.codec.geometry.metrics import measure
from motifold.pipeline.archive import Archive
from motifold.pipeline.executors import SerialExecutor
from motifold.pipeline.plan import Settings
from motifold.pipeline.restore import restore_clips
from motifold.pipeline.run import archive_library


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder like that of the real motion, with synthetic clips in it."""
    folder = tmp_path_factory.mktemp("data")
    (folder / "bandai").mkdir()
    write_clips(folder / "bandai", short_specs(4))
    trials = folder / "cmu_amc" / "subjects" / "01"
    trials.mkdir(parents=True)
    (trials / "01.asf").write_text(asf_text())
    for trial, frames in (("01_01", 40), ("01_02", 30)):
        (trials / f"{trial}.amc").write_text(amc_text(frames))
    return folder


@pytest.mark.parametrize("name", list(SETS))
def test_a_run_says_what_independent_code_says(name: str, data: Path, tmp_path: Path) -> None:
    sources = link_library(clip_files(SETS[name], data), tmp_path / "library")
    runs = ArchiveRuns(sources, tmp_path, workers=0, check=1)
    run = runs.at("max", 0.1)
    assert runs.at("max", 0.1) is run
    assert not (tmp_path / "max-0.1").exists()

    folder = tmp_path / "again"
    archive_library(tmp_path / "library", folder, Settings(tolerance=0.1), workers=0)
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != ".writer.lock"]
    assert run.archive_bytes == counted_bytes(folder)
    assert run.index_bytes.sum() == sum(p.stat().st_size for p in files if p.suffix == ".mfi")
    assert run.shared_bytes > 0
    with Archive(folder) as archive:
        done = restore_clips(archive, list(archive), tmp_path / "back", engine=SerialExecutor())
        units = {key: clip.rig.layout.centimetres for key, clip in archive.items()}
    distances = [
        joint_distances(*read_pair(sources[key], Path(path), units[key])).ravel()
        for key, path in done.files.items()
    ]
    assert len(distances) == len(sources)
    assert run.joint_mean == pytest.approx(float(np.concatenate(distances).mean()), abs=1e-6)
    assert run.largest.shape == (len(sources),)
    assert 0 < run.largest.max() <= 0.1


def test_a_decoder_that_is_off_is_found_out(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources = link_library(clip_files(SETS["bandai"], data), tmp_path / "library")
    monkeypatch.setattr(archive_runs, "joint_errors", lambda task: (0.0, 1))
    with pytest.raises(SystemExit, match="independent code"):
        ArchiveRuns(sources, tmp_path, workers=0, check=1).at("max", 0.1)


def test_mean_bounds_are_used_where_there_are_any(monkeypatch: pytest.MonkeyPatch) -> None:
    @dataclass(frozen=True)
    class Plain:
        tolerance: float = 0.1

    @dataclass(frozen=True)
    class WithMean(Plain):
        mean_tolerance: float | None = None

    monkeypatch.setattr(job_settings, "Settings", Plain)
    assert vars(settings_for("mean", 0.03)) == {"tolerance": 0.03}
    monkeypatch.setattr(job_settings, "Settings", WithMean)
    both = {"tolerance": MAX_PER_MEAN * 0.03, "mean_tolerance": 0.03}
    assert vars(settings_for("mean", 0.03)) == both
    assert vars(settings_for("max", 0.03)) == {"tolerance": 0.03, "mean_tolerance": None}


@pytest.mark.parametrize(("bound", "there"), [("max", True), ("mean", False), ("mean", True)])
def test_mean_matched_figures_come_from_mean_bounds(
    bound: Bound, there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Archives:
        def at(self, kind: Bound, value: float) -> Run:
            dear = 1.0 if kind == "max" else 0.5
            size = dear * 100.0 / value
            mean = value / (4.0 if kind == "max" else 1.3)
            return Run(kind, value, np.array([size]), np.array([value]), round(size), 0, 0, mean)

    monkeypatch.setattr(acl_comparison, "bounds_mean", lambda: there)
    one = np.ones(1)
    acl = AclPrecision("0.1", 2000.0 * one, one, one, 0.025 * one, 0.1 * one)
    found = compare_acl(cast(ArchiveRuns, Archives()), {"0.1": acl}, ["0.1"], [0.05, 0.2], bound)
    [figure] = found["figures"]
    assert figure["max_ratio"] == pytest.approx(0.5)
    used = bound == "mean" and there
    assert found["mean_setting"] == ("mean" if used else "max")
    wanted = 50.0 / (0.025 * 1.3) if used else 100.0 / (0.025 * 4.0)
    assert figure["mean_ratio"] == pytest.approx(wanted / 2000.0, rel=2e-3)


def test_samples_are_random_but_the_same_again(data: Path) -> None:
    files = clip_files(SETS["bandai"], data)
    assert list(chosen(files, 0, 0)) == sorted(files)
    some = chosen(files, 2, 7)
    assert len(some) == 2
    assert some == chosen(files, 2, 7)
    assert len(chosen(files, 99, 0)) == len(files)
    with pytest.raises(SystemExit, match=r"no \.bvh files"):
        clip_files(SETS["bandai"], data / "cmu_amc")


def test_growth_compares_libraries_of_other_sizes(data: Path, tmp_path: Path) -> None:
    assert growth_sizes(2476) == GROWTH_CLIPS
    assert growth_sizes(4) == (1, 4)
    files = clip_files(SETS["bandai"], data)
    found = measure_growth(files, [Settings(tolerance=0.5)], tmp_path, 0, 0)
    [figure] = found["figures"]
    assert (found["small"], found["large"]) == (1, 4)
    assert figure["growth"] == pytest.approx(figure["large_ratio"] / figure["small_ratio"])
    assert figure["small_least"] <= figure["small_ratio"] <= figure["small_most"]
    report = archive_library(data / "bandai", tmp_path / "a", Settings(tolerance=0.5), workers=0)
    assert figure["large_ratio"] == pytest.approx(report.float32_bytes / report.archive_bytes)


def test_text_counts_each_file_once(data: Path, tmp_path: Path) -> None:
    sources = link_library(clip_files(SETS["cmu"], data), tmp_path / "library")
    found = compare_text(ArchiveRuns(sources, tmp_path, 0, 0), sources, [0.5])
    texts = [path.read_bytes() for path in (data / "cmu_amc").rglob("*.a??")]
    assert len(texts) == 3
    assert found["text_bytes"] == sum(map(len, texts))
    # zlib adds a header and a checksum, six bytes, to what deflate makes
    assert found["zip_bytes"] == sum(len(zlib.compress(text, 9)) - 6 for text in texts)
    assert 0 < found["xz_bytes"] < found["text_bytes"]


def test_overrides_go_into_nested_rules() -> None:
    changed = with_overrides(
        Settings(), {"seed": 3, "clusters.radius_coefficient": 2.0, "clusters.bound": "average"}
    )
    assert (changed.seed, changed.clusters.radius_coefficient) == (3, 2.0)
    assert changed.clusters.bound == "average"
    assert with_overrides(Settings(), {}) == Settings()
    for wrong in ("nothing", "clusters.nothing", "seed.nothing"):
        with pytest.raises(ValueError, match="no field"):
            with_overrides(Settings(), {wrong: 1})
    assert next(iter(ablations.VARIANTS)) == "default"
    for overrides in ablations.VARIANTS.values():
        settings_for("max", 0.1, overrides)


def test_changes_are_read_as_json_or_words() -> None:
    changes = parse_changes(["seed=3", "clusters.bound=average", "units=cm"])
    assert changes == {"seed": 3, "clusters.bound": "average", "units": "cm"}
    assert settings_for("max", 0.2, changes).clusters.bound == "average"
    for wrong, told in (("seed", "NAME=VALUE"), ("speed=3", "no field")):
        with pytest.raises(SystemExit, match=told):
            parse_changes([wrong])


def test_variants_are_compared_with_the_first() -> None:
    base = {"index_bytes": 10, "joint_mean": 0.02}
    figures = [
        {"variant": name, "tolerance": tolerance, "archive_bytes": size, **base}
        for name, tolerance, size in (("a", "1mm", 100), ("a", "1cm", 50), ("b", "1mm", 150))
    ]
    assert [row[5] for row in ablations.rows(figures)] == ["1.0000", "1.0000", "1.5000"]
    figures[2]["joint_mean"] = 0.02 * 2.0**2.5
    assert [row[7] for row in ablations.rows(figures)] == ["1.0000", "1.0000", "3.0000"]


def test_without_memory_of_itself_a_clip_is_another_file(
    small_library: Path, tmp_path: Path
) -> None:
    name = min(path.name for path in small_library.iterdir())
    files, motions = [], []
    manners: list[AbstractContextManager[object]] = [nullcontext(), ablations.forgetful()]
    for number, manner in enumerate(manners):
        folder = tmp_path / str(number)
        with manner:
            archive_library(small_library, folder, include=[name], workers=0)
            with Archive(folder) as archive:
                files.append(archive[name].path.read_bytes())
                motions.append(archive[name].decode())
    clip = read_clip(small_library / name)
    assert files[0] != files[1]
    assert all(measure(clip, motion).maximum <= 0.1 for motion in motions)


def test_figures_are_kept_and_added_to(tmp_path: Path) -> None:
    about = {"command": "c", "clips": 1, "of": 1, "seed": 0, "code": "x"}
    sizes = {"text_bytes": 9, "zip_bytes": 3, "xz_bytes": 2, "float32_bytes": 4, "figures": []}
    (tmp_path / "README.md").write_text("top\n")
    with pytest.raises(SystemExit, match="once each"):
        write(tmp_path, {"text/bandai": {**about, **sizes}})
    (tmp_path / "README.md").write_text(
        "top\n<!-- rate-distortion:begin -->\n<!-- rate-distortion:end -->\nend\n"
    )
    write(tmp_path, {"text/cmu": {**about, **sizes}})
    text = (tmp_path / "README.md").read_text()
    assert "Bandai" in text  # kept although the README could not be written
    assert "CMU" in text
    assert text.startswith("top\n")
    assert text.endswith("end\n")
    write(tmp_path, {})
    assert (tmp_path / "README.md").read_text() == text


def test_the_state_of_the_code_is_that_of_its_sources(tmp_path: Path) -> None:
    for folder in ("codec", "pipeline", "tests"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "a.py").write_text("1")
    first = code_state(tmp_path)
    (tmp_path / "tests" / "a.py").write_text("2")
    assert code_state(tmp_path) == first
    (tmp_path / "codec" / "a.py").write_text("2")
    assert code_state(tmp_path) != first
