"""Sizes and errors against ACL, SZ3, zip and xz, and how the ratio grows with the library.

python benchmarks/rate_distortion.py DATA [--set bandai|cmu] [--only acl sz3 growth text]
    [--sample N] [--bound max|mean] [--change NAME=VALUE ...] [--json] [--write [ROOT]]

DATA is the folder into which the real motion was unpacked (with bandai and cmu_amc in it).
Everything is the whole archive: store, ledger and commit counted. A sample is archived as a
library of its own, not scaled: a smaller one is a dearer one. ``--write`` keeps the figures in
docs/rate_distortion.json, beside those of other sets and comparisons that are there already,
draws docs/rate_distortion.svg, and sets the tables between the marker comments of README.md.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shlex
import sys
import tempfile
from pathlib import Path
from typing import Any

from acl_comparison import compare_acl, read_acl
from archive_runs import ArchiveRuns
from curve_picture import draw
from general_compressors import compare_text
from job_settings import bounds_mean, parse_changes, settings_for
from library_growth import measure_growth
from motion_sets import SETS, MotionSet, chosen, clip_files, link_library
from readme_block import with_block
from result_tables import all_tables, panels
from sz3_peer import compare_sz3, load_sz3

from motifold.workflows.quantities import parse_length

ROOT = Path(__file__).resolve().parents[1]
PEERS = ROOT.parent / "shared" / "peers"
COMPARISONS = ("acl", "sz3", "growth", "text")
TOLERANCES = "0.1mm,0.3mm,1mm,2mm,10mm,30mm"
PRECISIONS = "0.01,0.1,1.0"
SZ3_TOLERANCES = "0.1mm,1mm,1cm"
GROWTH_TOLERANCES = "1mm,5mm"
TEXT_TOLERANCES = "1mm,1cm"


def main() -> None:
    """Run the benchmark."""
    options = _parser().parse_args()
    if options.redraw:
        write(options.write or ROOT, {})
        return
    if options.data is None:
        raise SystemExit("name the folder that the real motion was unpacked into")
    if "sz3" in options.only:
        load_sz3()
    results: dict[str, Any] = {}
    for name in [options.set] if options.set else SETS:
        results |= measure(SETS[name], options)
        if options.write:  # after each set, so that little is lost with the next
            write(options.write, results)
    if options.json:
        print(json.dumps(results, indent=1))
    else:
        print(all_tables(results))


def measure(motion_set: MotionSet, options: argparse.Namespace) -> dict[str, Any]:
    """Return the sections of one set's comparisons, as JSON values by ``comparison/set``."""
    name = motion_set.name
    code = code_state(ROOT)
    everything = clip_files(motion_set, options.data)
    files = chosen(everything, options.sample, options.seed)
    found: dict[str, Any] = {}
    with tempfile.TemporaryDirectory(prefix="motifold-") as folder:
        sources = link_library(files, Path(folder, "library"))
        changes = parse_changes(options.change)
        archives = ArchiveRuns(sources, Path(folder), options.workers, options.check, changes)
        if "acl" in options.only:
            acl = read_acl(options.peers / motion_set.figures, files)
            tolerances = _lengths(options.tolerances)
            precisions = options.precisions.split(",")
            found["acl"] = compare_acl(archives, acl, precisions, tolerances, options.bound)
        if "sz3" in options.only:
            found["sz3"] = compare_sz3(archives, sources, _lengths(SZ3_TOLERANCES))
        if "text" in options.only:
            found["text"] = compare_text(archives, sources, _lengths(TEXT_TOLERANCES))
        if "growth" in options.only and name != "cmu":  # too few trials to grow
            lengths = _lengths(GROWTH_TOLERANCES)
            settings = [settings_for("max", length, changes) for length in lengths]
            found["growth"] = measure_growth(
                files, settings, Path(folder), options.workers, options.seed
            )
    about: dict[str, Any] = {
        "clips": len(files),
        "of": len(everything),
        "seed": options.seed if options.sample else 0,
        "code": code,
    }
    if code_state(ROOT) != code:
        about["code"] = f"{code} (changed meanwhile)"
    return {
        f"{kind}/{name}": {"command": command(kind, name, options), **about, **section}
        for kind, section in found.items()
    }


def command(kind: str, name: str, options: argparse.Namespace) -> str:
    """Return the command that measures one section alone."""
    words = ["python", "benchmarks/rate_distortion.py", "DATA", "--set", name, "--only", kind]
    if options.sample:
        words += ["--sample", str(options.sample), "--seed", str(options.seed)]
    if options.change:
        words += ["--change", *options.change]
    if kind == "acl":
        for option, default in (("tolerances", TOLERANCES), ("precisions", PRECISIONS)):
            if getattr(options, option) != default:
                words += [f"--{option}", getattr(options, option)]
        if options.bound == "max" and bounds_mean():
            words += ["--bound", "max"]
    return shlex.join(words)


def code_state(root: Path) -> str:
    """Return a digest of the sources that decide an archive's bytes."""
    digest = hashlib.sha256()
    for path in sorted(
        path for part in ("codec", "pipeline") for path in (root / part).rglob("*.py")
    ):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


def write(root: Path, results: dict[str, Any]) -> None:
    """Add ``results`` to those kept below ``root``, and write picture and README from all."""
    kept, picture, readme = (
        root / name
        for name in ("docs/rate_distortion.json", "docs/rate_distortion.svg", "README.md")
    )
    known = json.loads(kept.read_text()) if kept.is_file() else {}
    merged = dict(sorted({**known, **results}.items()))
    if not merged:
        raise SystemExit(f"{kept} is not there: no figures to draw; measure some first")
    kept.parent.mkdir(exist_ok=True)
    kept.write_text(json.dumps(merged, indent=1) + "\n", encoding="utf-8")
    blocks = [all_tables(merged)]
    if drawn := panels(merged):
        svg = draw(drawn, "mean joint error, mm", "bits per joint and frame")
        picture.write_text(svg, encoding="utf-8")
        blocks.insert(
            0, "![Bits per joint and frame over mean joint error](docs/rate_distortion.svg)"
        )
    try:
        text = with_block(readme.read_text(encoding="utf-8"), "\n\n".join(blocks))
    except ValueError as problem:
        raise SystemExit(f"{readme} {problem}; the figures are in {kept}") from problem
    readme.write_text(text, encoding="utf-8")
    print(f"wrote {kept}, {picture.name} and {readme.name}", file=sys.stderr)


def _lengths(text: str) -> list[float]:
    return [parse_length(length) for length in text.split(",")]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, nargs="?", help="folder of the unpacked real motion")
    parser.add_argument("--set", choices=list(SETS), help="default: each of them")
    parser.add_argument("--only", nargs="+", choices=COMPARISONS, default=COMPARISONS)
    parser.add_argument("--sample", type=int, default=0, help="random clips; 0: all")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--bound",
        choices=("max", "mean"),
        default="mean",
        help="bound the mean error of archives that are matched by it, where motifold can",
    )
    parser.add_argument(
        "--change", nargs="+", default=[], metavar="NAME=VALUE", help="settings, as codec=learned"
    )
    parser.add_argument("--peers", type=Path, default=PEERS, help="folder of ACL's figures")
    parser.add_argument("--tolerances", default=TOLERANCES, help="of the archives, against ACL")
    parser.add_argument("--precisions", default=PRECISIONS, help="of ACL, cm")
    parser.add_argument("--workers", type=int, help="worker processes; default: one a core")
    parser.add_argument("--check", type=int, default=4, help="files an archive checked by oracles")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON")
    parser.add_argument("--write", type=Path, nargs="?", const=ROOT, metavar="ROOT")
    parser.add_argument("--redraw", action="store_true", help="write from kept figures only")
    return parser


if __name__ == "__main__":
    main()
