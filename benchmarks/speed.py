"""Speed of every stage of archiving BVH files, on one core.

python benchmarks/speed.py FOLDER [--clips N] [--tolerance 1mm] [--profile]

Speeds are CPU time, in MB of source text per second, and compared with a plain NumPy parse of
the same files in the same run (``np.array(text.split(), float)`` of the motion block), which
makes them comparable between machines. ``--profile`` shows where encode and decode spend it.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import random
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from tables import print_table
from threadpoolctl import threadpool_limits

from motifold.codec import encode
from motifold.codec.bodyparts import body_parts
from motifold.codec.clip import Clip
from motifold.codec.decode import decode
from motifold.codec.encode import Encoder, measure
from motifold.codec.formats.bvh import format_bvh, parse_bvh
from motifold.codec.index_file import unpack
from motifold.codec.nearest import NearestPatterns
from motifold.codec.rig import Rig, found_family, rig_of
from motifold.codec.segments import clip_segments
from motifold.pipeline.clustering import Representatives, grow, within_clip
from motifold.pipeline.discover import discover
from motifold.pipeline.plan import Settings
from motifold.pipeline.run import ROUND_CLIPS
from motifold.pipeline.store import Store
from motifold.pipeline.tasks import survey_batch
from motifold.workflows.quantities import parse_length

PLAIN = "plain NumPy parse"
PROFILED_LINES = 18


@dataclass
class Times:
    """CPU seconds per stage."""

    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    @contextmanager
    def of(self, stage: str) -> Iterator[None]:
        """Add the CPU time of a ``with`` block to a stage."""
        start = time.process_time()
        yield
        self.seconds[stage] += time.process_time() - start


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--clips", type=int, default=200, help="random clips, seed 0")
    parser.add_argument("--tolerance", default="1mm")
    parser.add_argument("--profile", action="store_true")
    options = parser.parse_args()
    sources = discover(options.folder, ["*.bvh"])
    sources = sorted(random.Random(0).sample(sources, min(options.clips, len(sources))))
    settings = Settings(tolerance=parse_length(options.tolerance))
    with threadpool_limits(1):
        run_stages([Path(source.path) for source in sources], sources, settings, options.profile)


def run_stages(paths: list[Path], sources: list[Any], settings: Settings, profile: bool) -> None:
    """Time every stage on the files and print the table."""
    times = Times()
    survey = survey_batch(tuple(sources), settings.units, None, {})
    for failure in survey.failures:
        raise SystemExit(f"{failure.name}: {failure.reason}")
    store = Store()
    for key, sketch in survey.families.items():
        family = found_family(
            sketch.rig, sketch.usual, sketch.bones, sketch.bends, sketch.head_diagonal
        )
        store.add_family(family)
        assert family.key == key

    contents = [path.read_bytes() for path in paths]
    clips: list[Clip] = []
    rigs: list[Rig] = []
    groups: dict[tuple[str, int], list[Representatives]] = defaultdict(list)
    for content in contents:
        _plain(content, times)
        with times.of("read"):
            clip = parse_bvh(content)
        with times.of("body parts, features, segments"):
            rig = rig_of(clip, body_parts(clip.skeleton, None))
            family = store.families[rig.family_key]
            radius = settings.clusters.radius(family.head_diagonal, settings.tolerance)
            segments = clip_segments(clip, family, settings.segments)
        with times.of("cluster within the clip"):
            for part, found in enumerate(segments):
                if found is not None and len(found.points):
                    groups[rig.family_key, part].append(within_clip(found.points, radius))
        clips.append(clip)
        rigs.append(rig)
    with times.of("grow the store"):
        for (key, part), members in sorted(groups.items(), key=lambda entry: entry[0]):
            radius = settings.clusters.radius(store.families[key].head_diagonal, settings.tolerance)
            searcher = NearestPatterns(store.codebook(key).centimetres[part])
            for start in range(0, len(members), ROUND_CLIPS):
                new = grow(
                    searcher, members[start : start + ROUND_CLIPS], radius, settings.clusters
                )
                store.add_patterns(key, part, new)

    codebooks = {key: store.codebook(key) for key in store.families}
    encoders = {
        key: Encoder(
            codebook,
            1,
            settings.tolerance,
            settings.clusters.radius(codebook.family.head_diagonal, settings.tolerance),
            settings.segments,
        )
        for key, codebook in codebooks.items()
    }
    for key, encoder in encoders.items():
        len(encoder.searchers), len(codebooks[key].centimetres)  # built once for all clips
    encode._search_step = _timed(encode._search_step, times, "encode: step search")
    profiles = {"encode": cProfile.Profile(), "decode": cProfile.Profile()}
    files, restored = [], []
    for content, original, rig in zip(contents, clips, rigs, strict=True):
        _plain(content, times)
        with times.of("encode"), _maybe(profiles["encode"], profile):
            files.append(encoders[rig.family_key].encode(original, rig, 0).data)
    for data, original, rig in zip(files, clips, rigs, strict=True):
        with times.of("decode"), _maybe(profiles["decode"], profile):
            restored.append(decode(unpack(data), rig, codebooks[rig.family_key]))
        with times.of("measure (for verify)"):
            measure(original, restored[-1])
    for back in restored:
        with times.of("write BVH"):
            format_bvh(back)  # type: ignore[arg-type]  # BVH files hold skeletons
    text = sum(map(len, contents)) / 1e6
    seconds = sum(clip.frames * clip.frame_time for clip in clips)
    print(
        f"{len(clips)} clips, {text:.1f} MB of text, {seconds / 60:.1f} min of motion, "
        f"tolerance {settings.tolerance * 10:g} mm, {sum(map(len, files)) / 1e6:.3f} MB encoded"
    )
    if not profile:
        _print_times(times, text)
        pace = seconds / times.seconds["decode"]
        print(f"decode runs {pace:,.0f} times faster than real time")
        return
    for name, made in profiles.items():
        print(f"\n{name}: CPU time, with the profiler's own share in it")
        pstats.Stats(made).strip_dirs().sort_stats("tottime").print_stats(PROFILED_LINES)


def _plain(content: bytes, times: Times) -> None:
    """Parse the motion block of a file without looking at anything, as a yardstick."""
    with times.of(PLAIN):
        text = content.decode().partition("Frame Time:")[2].partition("\n")[2]
        np.array(text.split(), float)


def _print_times(times: Times, text: float) -> None:
    seconds = dict(times.seconds)
    seconds[PLAIN] /= 2  # it ran twice
    seconds["encode without step search"] = seconds["encode"] - seconds["encode: step search"]
    seconds["verify (read, decode, measure)"] = (
        seconds["read"] + seconds["decode"] + seconds["measure (for verify)"]
    )
    job = "archive job (read 3 times)"
    stages = ("body parts, features, segments", "cluster within the clip", "grow the store")
    seconds[job] = 3 * seconds["read"] + sum(seconds[s] for s in (*stages, "encode"))
    rows = [("stage", "MB/s of text", "times the plain parse", "share of an archive job")]
    for stage, value in seconds.items():
        share = f"{100 * value / seconds[job]:.0f} %"
        rows.append((stage, f"{text / value:.1f}", f"{value / seconds[PLAIN]:.2f}", share))
    print_table(rows)


def _timed(function: Callable[..., Any], times: Times, stage: str) -> Callable[..., Any]:
    def timed(*arguments: Any) -> Any:
        with times.of(stage):
            return function(*arguments)

    return timed


@contextmanager
def _maybe(profile: cProfile.Profile, wanted: bool) -> Iterator[None]:
    if wanted:
        profile.enable()
    yield
    profile.disable()


if __name__ == "__main__":
    main()
