"""The command line: every command, its exit codes, JSON, one-line errors, and Ctrl-C."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from libraries import (
    BAD,
    CLIPS,
    STRANGE_NAME,
    copied,
    counted_bytes,
    short_specs,
    tree,
    write_clips,
)
from typer.testing import CliRunner

from motifold.codec.clip import SkeletonClip
from motifold.codec.formats.files import read_clip
from motifold.codec.geometry.metrics import clip_errors
from motifold.pipeline.archive import Archive
from motifold.pipeline.verify import Verified
from motifold.workflows.cli import app, main

MOTIFOLD = (sys.executable, "-m", "motifold")
COMMANDS = ("archive", "restore", "verify", "info", "demo", "search", "duplicates", "report")
# Says on standard error that the first index file is written, and goes slowly from there.
SLOWLY = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have set it to be ignored
import motifold.pipeline.run as run
from motifold.workflows.cli import main
whole = run.write_whole
def slowly(path, data):
    whole(path, data)
    print("working", file=sys.stderr, flush=True)
    time.sleep(2.0)  # the test comes before it is over
run.write_whole = slowly
if __name__ == "__main__":
    main()
"""


def ran(*words: object) -> tuple[int, str]:
    """Run a command that raises nothing; return its exit code and what it printed."""
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout


def said(*words: object) -> Any:
    """Run a command with --json; return what it said."""
    code, out = ran(*words, "--json")
    assert code == 0, out
    return json.loads(out)


def refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: object
) -> str:
    """Run a command that must end with code 2 and one line on standard error; return it."""
    monkeypatch.setattr(sys, "argv", ["motifold", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    captured = capsys.readouterr()
    assert ended.value.code == 2, captured
    assert captured.out == ""
    assert captured.err.startswith("motifold: ")
    assert captured.err.count("\n") == 1
    return captured.err


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command: str) -> None:
    code, out = ran(command, "--help")
    assert code == 0
    assert f"Usage: motifold {command}" in out.replace("root", "motifold")
    code, out = ran("--help")
    assert command in out


def test_help_is_quick_and_imports_nothing_heavy() -> None:
    script = (
        "import sys\nsys.argv = ['motifold', *sys.argv[1:]]\n"
        "from motifold.workflows.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'scipy', 'sklearn', 'dask', 'distributed', 'zarr', 'constriction'}\n"
        "print('HEAVY', sorted(heavy & set(sys.modules)))"
    )
    seconds = []
    for words in (["--help"], ["archive", "--help"], ["--version"]):
        start = time.monotonic()
        out = subprocess.run(
            [sys.executable, "-c", script, *words], capture_output=True, text=True, check=True
        )
        seconds.append(time.monotonic() - start)
        assert out.stdout.endswith("HEAVY []\n"), out.stdout[-300:]
    assert min(seconds) < 1.0


def test_the_version_is_the_package_s() -> None:
    from importlib.metadata import version

    assert ran("--version") == (0, f"motifold {version('motifold')}\n")


def test_archive_reports_and_archives_once(small_library: Path, tmp_path: Path) -> None:
    code, out = ran("archive", small_library, tmp_path / "a", "--workers", 0)
    assert code == 0
    shown = {line[:26].strip(): line[26:].strip() for line in out.splitlines()}
    assert shown["clips archived"] == str(CLIPS)
    assert shown["clips unchanged"] == "0"
    assert shown["files that failed"] == "0"
    ratio = sum(map(len, tree(small_library).values())) / counted_bytes(tmp_path / "a")
    assert float(shown["source : archive"]) == pytest.approx(ratio, abs=0.006)
    again = said("archive", small_library, tmp_path / "a", "--workers", 0)
    assert (again["clips"], again["unchanged"], again["failures"]) == (0, CLIPS, [])


def test_workers_of_the_command_write_the_same_bytes(
    small_library: Path, small_archive: Path, tmp_path: Path
) -> None:
    out = subprocess.run(
        [*MOTIFOLD, "archive", small_library, tmp_path / "a", "--workers", "2", "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert out.returncode == 0, out.stderr
    assert out.stderr == "", "nothing to say"
    assert json.loads(out.stdout)["clips"] == CLIPS
    serial = copied(small_archive, tmp_path / "serial")
    assert said("index", serial, "--workers", 0)["clips"] == CLIPS
    assert tree(tmp_path / "a") == tree(serial)


def test_options_reach_the_job(small_library: Path, tmp_path: Path) -> None:
    (tmp_path / "parts.toml").write_text('[parts.thinking]\njoints = ["Head"]\n')
    options = "--tolerance 0.5cm --units in --segmentation fisher --cluster-bound average"
    report = said(
        *("archive", small_library, tmp_path / "a", "--workers", 0, "--include", "run_*"),
        *("--include", "jump_*take01*", "--parts", tmp_path / "parts.toml", "--seed", 5),
        *("--cluster-radius", 0.8, *options.split()),
    )
    assert report["clips"] == 4
    assert 0.1 < report["max_error"] <= 0.5
    with Archive(tmp_path / "a") as archive:
        settings = archive.ledgers[1].settings
        parts = [part.name for part in next(iter(archive.values())).rig.parts]
    assert settings["tolerance"] == 0.5
    assert settings["units"] == "in"
    assert settings["seed"] == 5
    assert settings["segments"]["method"] == "fisher"
    assert settings["clusters"]["bound"] == "average"
    assert settings["clusters"]["radius_coefficient"] == 0.8
    assert "thinking" in parts


@pytest.mark.parametrize("bound", ["--tolerance", "--mean-tolerance"])
def test_what_counts_more_is_coded_closer(small_library: Path, tmp_path: Path, bound: str) -> None:
    """The feet count four times: their bound is a quarter, and so is their error, or so."""
    errors, sizes = {}, {}
    for name, weights in (("plain", ()), ("weighted", ("--joint-weight", "*Foot=4"))):
        out = tmp_path / name
        said("archive", small_library, out, "--workers", 0, "--no-index", bound, "4mm", *weights)
        sizes[name] = counted_bytes(out)
        found = []
        with Archive(out) as archive:
            for clip in archive.values():
                original, decoded = read_clip(small_library / clip.name), clip.decode()
                assert isinstance(original, SkeletonClip)
                assert isinstance(decoded, SkeletonClip)
                feet = [n for n, joint in enumerate(original.skeleton.names) if "Foot" in joint]
                found.append(clip_errors(original, decoded)[:, feet])
        errors[name] = np.concatenate(found)
    assert errors["weighted"].mean() < 0.5 * errors["plain"].mean()
    assert sizes["weighted"] > sizes["plain"]
    if bound == "--tolerance":
        assert errors["plain"].max() > 0.1 >= errors["weighted"].max()


def test_bad_files_are_listed_and_the_code_is_3(odd_library: Path, tmp_path: Path) -> None:
    out = subprocess.run(
        [*MOTIFOLD, "archive", odd_library, tmp_path / "a", "--workers", "0"],
        capture_output=True,
        check=False,
        env={**os.environ, "LC_ALL": "C.UTF-8"},
    )
    assert out.returncode == 3, out.stderr
    assert out.stderr == b""
    failed = [line for line in out.stdout.decode().splitlines() if line.startswith("failed: ")]
    assert len(failed) == len(BAD)
    for line, name in zip(failed, sorted(BAD), strict=True):
        assert line.startswith(f"failed: {name}: ")
        assert BAD[name] in line
    code, text = ran("archive", odd_library, tmp_path / "a", "--workers", 0, "--json")
    assert code == 3
    assert {failure["name"] for failure in json.loads(text)["failures"]} == set(BAD)


def test_info_of_an_archive(small_archive: Path, odd_archive: Path) -> None:
    record = said("info", small_archive)
    assert record["clips"] == CLIPS
    assert record["frames"] == 60 * CLIPS
    assert record["seconds"] == pytest.approx(2.0 * CLIPS, rel=1e-3)
    assert record["archive_bytes"] == counted_bytes(small_archive)
    assert [job["tolerance_cm"] for job in record["jobs"]] == [0.1]
    code, out = ran("info", small_archive)
    assert code == 0
    assert re.search(rf"^clips +{CLIPS}$", out, re.MULTILINE)
    code, out = ran("info", odd_archive)
    assert code == 0
    assert sum(line.startswith("failed in job 1: bad/") for line in out.splitlines()) == len(BAD)


def test_info_of_clips(odd_archive: Path) -> None:
    one = said("info", odd_archive, "markers/sway.c3d")
    assert (one["name"], one["format"], one["unit"]) == ("markers/sway.c3d", "c3d", "mm")
    assert 0 < one["certificate_cm"]["maximum"] <= one["tolerance_cm"] == 0.1
    assert Path(one["index_file"]).stat().st_size == one["index_bytes"]
    two = said("info", odd_archive, "markers/*")
    assert [record["name"] for record in two] == ["markers/sway.c3d", "markers/sway.trc"]
    words = [sys.executable, "-m", "motifold", "info", str(odd_archive), "cut"]
    done = subprocess.run(words, capture_output=True, check=True)
    out = done.stdout.decode("utf-8", "surrogateescape")
    assert "repair: Frames is '60': the file holds 44 (Frames)" in out
    assert "part left_arm: " in out
    assert "from 0.00 s to 1.47 s as caf\udce9.bvh from 0.00 s on" in out  # its name is no text
    every = said("info", odd_archive, "--clips")
    assert [record["name"] for record in every] == sorted(record["name"] for record in every)
    assert len(every) == 6


def test_names_that_are_no_text_can_be_printed(odd_archive: Path, tmp_path: Path) -> None:
    env = {**os.environ, "LC_ALL": "C.UTF-8"}
    raw = os.fsencode(STRANGE_NAME)
    out = subprocess.run(
        [*MOTIFOLD, "info", odd_archive, "--clips"], capture_output=True, check=True, env=env
    )
    assert raw in out.stdout
    lost = subprocess.run(
        [*MOTIFOLD, "info", odd_archive, b"x" + raw], capture_output=True, check=False, env=env
    )
    assert lost.returncode == 2
    assert lost.stderr.count(b"\n") == 1
    assert raw in lost.stderr


def test_restore_writes_what_is_asked_for(
    small_library: Path, small_archive: Path, tmp_path: Path
) -> None:
    done = said("restore", small_archive, "run_*", "jump_proud_actor5_take01", "--out", tmp_path)
    assert len(done["files"]) == 4
    assert done["failures"] == []
    for name, path in done["files"].items():
        error = oracle.shell_error(oracle.read_bvh(small_library / name), oracle.read_bvh(path))
        assert error.max() < 0.1 + 1e-4
    code, out = ran("restore", small_archive, "--out", tmp_path / "all")
    assert code == 0
    assert out.startswith(f"restored {CLIPS} clips, ")
    assert len(tree(tmp_path / "all")) == CLIPS


def test_restore_has_formats_and_tiers(small_archive: Path, tmp_path: Path) -> None:
    name = "run_proud_actor2_take01.bvh"
    done = said("restore", small_archive, name, "--out", tmp_path, "--format", "npz")
    with np.load(done["files"][name]) as exact:
        positions = exact["positions"]
    words = (name, "--out", tmp_path / "p", "--format", "npz", "--tier", "preview")
    done = said("restore", small_archive, *words)
    with np.load(done["files"][name]) as preview:
        away = np.linalg.norm(preview["positions"] - positions, axis=2)
    assert 0.1 < away.max() < 100
    assert away[:, 0].max() < 1e-9, "the root path is exact"


def test_a_part_of_an_archive_with_streams_per_part_comes_back(
    small_library: Path, tmp_path: Path
) -> None:
    done = said(
        *("archive", small_library, tmp_path / "a", "--include", "run_*", "--workers", 0),
        *("--streams", "parts", "--model", "fixed", "--no-index"),
    )
    assert done["clips"] == 3
    name = "run_proud_actor2_take01.bvh"
    words = ("--parts", "left_arm, head", "--from", "0.5s", "--to", "1s", "--out", tmp_path / "out")
    done = said("restore", tmp_path / "a", name, *words)
    with np.load(done["files"][name]) as found:
        assert found["positions"].shape[0] == 16
        assert "Head" in found["names"]
        assert not [joint for joint in found["names"] if "Leg" in joint or "Right" in joint]


def test_restore_that_fails_in_part_ends_with_3(small_archive: Path, tmp_path: Path) -> None:
    archive = copied(small_archive, tmp_path / "a")
    with Archive(archive) as opened:
        bad = next(iter(opened.values()))
        bad.path.unlink()
    code, out = ran("restore", archive, "--out", tmp_path / "out")
    assert code == 3
    assert out.startswith(f"restored {CLIPS - 1} clips")
    assert f"\nfailed: {bad.name}: " in out
    code, out = ran("restore", archive, "--out", tmp_path / "out", "--json")
    assert code == 3
    assert [name for name, _ in json.loads(out)["failures"]] == [bad.name]


def test_verify_says_whole_or_damaged(
    small_library: Path, small_archive: Path, tmp_path: Path
) -> None:
    code, out = ran("verify", small_archive, "--decode", "--workers", 0)
    assert code == 0
    assert f"{CLIPS} clips, {CLIPS} decoded; largest error 0.9" in out
    assert out.endswith("the archive is whole\n")
    found = said("verify", small_archive, "--library", small_library, "--workers", 0)
    assert set(found) == set(Verified.__dataclass_fields__)
    assert found["measured"] == CLIPS
    archive = copied(small_archive, tmp_path / "a")
    with Archive(archive) as opened:
        path = next(iter(opened.values())).path
    path.write_bytes(path.read_bytes()[:-1])
    code, out = ran("verify", archive)
    assert code == 3
    assert path.name in out
    assert out.endswith("the archive is DAMAGED\n")
    code, out = ran("verify", archive, "--json")
    assert code == 3
    assert len(json.loads(out)["problems"]) == 1


WRONG = [
    (["archive", "{nowhere}", "{new}"], "no such folder"),
    (["archive", "{empty}", "{new}"], "no motion files"),
    (["archive", "{library}", "{new}", "--include", "*.c3d"], "no motion files that match"),
    (["archive", "{library}", "{new}", "--tolerance", "1"], "'1' is not a length"),
    (["archive", "{library}", "{new}", "--tolerance", "0mm"], "cannot be kept"),
    (["archive", "{library}", "{new}", "--units", "furlong"], "unknown length unit 'furlong'"),
    (["archive", "{library}", "{new}", "--segmentation", "x"], "unknown segmentation"),
    (["archive", "{library}", "{new}", "--cluster-bound", "x"], "unknown cluster bound"),
    (["archive", "{library}", "{new}", "--cluster-radius", "nan"], "cluster radius"),
    (["archive", "{library}", "{new}", "--parts", "{nowhere}"], "parts file"),
    (["archive", "{library}", "{library}", "--workers", "0"], "is no archive"),
    (["archive", "{library}", "{file}", "--workers", "0"], "cannot be written"),
    (["restore", "{nowhere}", "--out", "{new}"], "no motifold archive"),
    (["restore", "{archive}", "nobody", "--out", "{new}"], "no clip 'nobody'"),
    (["restore", "{archive}", "--out", "{new}", "--tier", "best"], "unknown tier"),
    (["restore", "{archive}", "--out", "{new}", "--from", "late"], "no time"),
    (["restore", "{archive}", "--out", "{new}", "--from", "2s", "--to", "1s"], "nothing lies"),
    (
        ["restore", "{archive}", "--out", "{new}", "--parts", "head", "--format", "bvh"],
        "a BVH file cannot hold",
    ),
    (["archive", "{library}", "{new}", "--joint-weight", "Head=0"], "'Head=0' is no weight"),
    (["archive", "{library}", "{new}", "--streams", "limbs"], "no streams are called 'limbs'"),
    (["restore", "{archive}", "--out", "{new}", "--format", "fbx"], "cannot write 'fbx'"),
    (["verify", "{library}"], "no motifold archive"),
    (["info", "{newer}"], "reads format 1. Use a newer motifold"),
    (["info", "{torn}"], "is not a commit record"),
    (["info", "{archive}", "run_proud_actor2_take99"], "Did you mean run_proud_actor2_take0"),
    (["demo", "--out", "{library}"], "is there already"),
]


@pytest.mark.parametrize(("words", "problem"), WRONG, ids=[" ".join(words) for words, _ in WRONG])
def test_wrong_use_is_one_line_and_code_2(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    small_library: Path,
    small_archive: Path,
    tmp_path: Path,
    words: list[str],
    problem: str,
) -> None:
    places = {
        name: tmp_path / name for name in ("nowhere", "new", "empty", "file", "newer", "torn")
    }
    for name in ("empty", "newer", "torn"):
        places[name].mkdir()
    places["file"].write_text("")
    (places["newer"] / "COMMIT.json").write_text('{"format": 2}')
    (places["torn"] / "COMMIT.json").write_text('{"format": 1')
    before = tree(small_library)
    filled = [word.format(library=small_library, archive=small_archive, **places) for word in words]
    line = refused(capsys, monkeypatch, *filled)
    assert problem in line
    assert tree(small_library) == before
    if "{new}" in words:
        assert not places["new"].exists()


@pytest.mark.parametrize(
    "words",
    [[], ["fly"], ["archive"], ["restore", "x"], ["archive", "x", "y", "--workers", "-1"]],
)
def test_a_command_line_that_makes_no_sense_ends_with_2(words: list[str]) -> None:
    code, _ = ran(*words)
    assert code == 2


def test_a_second_writer_is_refused(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    small_library: Path,
    small_archive: Path,
    tmp_path: Path,
) -> None:
    from motifold.pipeline.lock import writer_lock

    archive = copied(small_archive, tmp_path / "a")
    with writer_lock(archive):
        line = refused(capsys, monkeypatch, "archive", small_library, archive, "--workers", 0)
        assert f"being written by process {os.getpid()}" in line
        assert ran("info", archive)[0] == 0, "readers are welcome"


def test_a_bug_shows_its_traceback(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, small_archive: Path
) -> None:
    def broken(*_: object) -> None:
        raise IndexError("off by one")

    monkeypatch.setattr(Archive, "find", broken)
    monkeypatch.setattr(sys, "argv", ["motifold", "info", str(small_archive), "x"])
    with pytest.raises(IndexError):
        main()


@pytest.mark.parametrize(
    ("sent", "workers"), [(signal.SIGINT, 0), (signal.SIGINT, 2), (signal.SIGKILL, 0)]
)
def test_an_interrupted_job_leaves_the_archive_as_it_was(
    tmp_path: Path, sent: signal.Signals, workers: int
) -> None:
    library, archive = tmp_path / "l", tmp_path / "a"
    names = write_clips(library, short_specs(4))
    assert ran("archive", library, archive, "--include", names[0], "--workers", 0)[0] == 0
    before = tree(archive)
    job = subprocess.Popen(
        [sys.executable, "-c", SLOWLY, "archive", library, archive, "--workers", str(workers)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert job.stderr is not None
    assert job.stderr.readline() == "working\n"
    os.killpg(job.pid, sent)  # as a terminal does
    out, err = job.communicate(timeout=30)
    assert out == ""
    after = tree(archive)
    assert before.items() <= after.items()
    assert after["COMMIT.json"] == before["COMMIT.json"]
    if sent == signal.SIGINT:
        assert job.returncode == 130
        said_last = [line for line in err.splitlines() if line != "working"]
        assert said_last == ["motifold: interrupted; the archive is as it was"]
        assert ".writer.lock" not in after
    assert ran("verify", archive, "--decode", "--workers", 0)[0] == 0
    assert ran("archive", library, archive, "--workers", 0)[0] == 0
    shutil.rmtree(tmp_path / "b", ignore_errors=True)
    assert ran("archive", library, tmp_path / "b", "--include", names[0], "--workers", 0)[0] == 0
    assert ran("archive", library, tmp_path / "b", "--workers", 0)[0] == 0
    assert tree(archive) == tree(tmp_path / "b")
