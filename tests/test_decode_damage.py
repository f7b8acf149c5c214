"""Damaged and hostile index files: a clip or a `MotifoldError`, soon and in little memory."""

from __future__ import annotations

import time
import tracemalloc
from dataclasses import replace

import numpy as np
import oracle
import pytest
from clips import Bench, Recipe, marker_bench, skeleton_bench
from hypothesis import given, settings
from hypothesis import strategies as st

from motifold.codec.errors import DamagedError, MotifoldError
from motifold.codec.figure.sliding import can_slide
from motifold.codec.streams.entropy import SymbolWriter
from motifold.codec.version1.decode import Tier, decode
from motifold.codec.version1.index_file import pack, unpack
from motifold.codec.version1.residual import write_residual

SUBJECTS = {
    "skeleton": skeleton_bench(Recipe(1, joints=9, frames=30), patterns=True),
    "spinning": skeleton_bench(Recipe(2, joints=6, frames=40, motion="spin", stretchy=0.5)),
    "still": skeleton_bench(Recipe(5, joints=12, frames=300, motion="still", hinges=0.3)),
    "markers": marker_bench(3, 10, 30, gaps=0.5, patterns=True),
}
FILES = {
    name: unpack(subject.encoder().encode(subject.clip, subject.rig, 1).data)
    for name, subject in SUBJECTS.items()
}
TIERS: list[Tier] = ["tolerance", "preview"]
CLAIMS = [0, 1, 7, 29, 31, 100, 1000, 10_000, 100_000, 10**6, 2**28, 10**12]


def survive(subject: Bench, data: bytes, tier: Tier) -> None:
    """Decode any bytes: a clip or a `MotifoldError`, and soon."""
    started = time.process_time()
    try:
        with np.errstate(all="ignore"):  # of numbers that no encoder writes
            clip = decode(unpack(data), subject.rig, subject.codebook, tier=tier)
    except MotifoldError:
        return
    finally:
        assert time.process_time() - started < 1.0
    assert clip.frames == unpack(data).frames
    assert type(clip) is type(subject.clip)


def mutated(rng: np.random.Generator, data: bytes) -> bytes:
    """Flip bits, cut, overwrite a stretch, or make up something else."""
    kind = int(rng.integers(5))
    if kind == 0 or not data:
        return rng.integers(0, 256, int(rng.integers(0, 1500)), np.uint8).tobytes()
    if kind == 1:
        return data[: int(rng.integers(len(data) + 1))]
    if kind == 2:
        return bytes([int(rng.choice([0, 1, 0x55, 255]))]) * int(rng.integers(0, 3000))
    hurt = bytearray(data)
    at = int(rng.integers(len(data)))
    if kind == 3:
        hurt[at : at + int(rng.integers(1, 40))] = rng.bytes(int(rng.integers(0, 60)))
    else:
        for place in rng.integers(0, len(data), int(rng.integers(1, 5))):
            hurt[place] ^= 1 << int(rng.integers(8))
    return bytes(hurt)


@pytest.mark.parametrize("name", FILES)
def test_mutated_files_are_damage(name: str) -> None:
    """The checksums see every change."""
    rng = np.random.default_rng(20090803)
    whole = pack(FILES[name])
    for _ in range(250):
        hurt = mutated(rng, whole)
        if hurt != whole:
            with pytest.raises(MotifoldError):
                unpack(hurt)


@pytest.mark.parametrize("name", FILES)
def test_mutated_layers_with_sound_checksums_do_no_harm(name: str) -> None:
    rng = np.random.default_rng(20090804)
    index = FILES[name]
    assert index.residual is not None
    for _ in range(500):
        hurt = index
        while hurt == index:
            if rng.random() < 0.5:
                hurt = replace(hurt, preview=mutated(rng, index.preview))
            if rng.random() < 0.5:
                hurt = replace(hurt, residual=mutated(rng, index.residual))
            if rng.random() < 0.2:
                hurt = replace(hurt, frames=int(rng.choice(CLAIMS)))
            if rng.random() < 0.1:
                hurt = replace(hurt, step_code=int(rng.integers(0, 9000)))
        survive(SUBJECTS[name], pack(hurt), TIERS[int(rng.integers(2))])


@given(
    st.sampled_from(sorted(FILES)),
    st.sampled_from(TIERS),
    st.one_of(st.sampled_from(CLAIMS), st.integers(0, 2**40)),
    st.integers(0, 10_000),
    st.binary(max_size=300),
    st.binary(max_size=300),
)
@settings(max_examples=150, deadline=None)
def test_any_layers_do_no_harm(
    name: str, tier: Tier, frames: int, code: int, preview: bytes, residual: bytes
) -> None:
    forged = replace(FILES[name], frames=frames, step_code=code, preview=preview, residual=residual)
    survive(SUBJECTS[name], pack(forged), tier)


def endless(kind: str, subject: Bench, frames: int) -> bytes:
    """A preview that claims much in a few bytes: first symbols of their tables cost nothing."""
    writer = SymbolWriter()
    if kind == "gaps":
        writer.uniform([1], 2)
        writer.number(frames)
        return writer.to_words()
    writer.differences(np.zeros(len(can_slide(subject.rig)), np.int64), 1)
    if kind == "bases":
        writer.number(1)
        writer.uniform([0], subject.rig.skeleton.joints)
        writer.number(frames - 1)
    else:
        writer.number(0)  # and then, for ever, segments of one frame
    return writer.to_words()


@pytest.mark.parametrize("kind", ["gaps", "bases", "segments"])
@pytest.mark.parametrize("frames", [10_000, 100_000, 500_000])
def test_claims_cost_neither_time_nor_memory(kind: str, frames: int) -> None:
    """A few kilobytes of padding let the claim pass the first check."""
    name = "markers" if kind == "gaps" else "skeleton"
    subject = SUBJECTS[name]
    padding = b"\xa5" * (frames * 3 * len(subject.rig.parts[0].joints) // 390)
    forged = replace(
        FILES[name],
        frames=frames,
        preview=endless(kind, subject, frames),
        residual=padding,
    )
    data = pack(forged)
    tracemalloc.start()
    try:
        survive(subject, data, "tolerance")
        with pytest.raises(DamagedError), np.errstate(all="ignore"):
            decode(unpack(data), subject.rig, subject.codebook)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # the arrays that so many frames would need if they were there, and no more
    assert peak < 4e6 + 24 * frames * subject.rig.skeleton.joints


def test_numbers_past_all_bounds_are_a_clip_or_damage() -> None:
    """Jumps to the format's limits: sums wrap, angles and lengths overflow."""
    for name in ("skeleton", "markers"):
        subject, index = SUBJECTS[name], FILES[name]
        channels = [3 * len(part.joints) for part in subject.rig.parts[1:]]
        left = np.full((index.frames, sum(channels)), 2**46)
        writer = SymbolWriter()
        write_residual(writer, left, channels)
        for code in (0, 4000, 7679):
            forged = replace(index, residual=writer.to_words(), step_code=code)
            survive(subject, pack(forged), "tolerance")


def test_patterns_that_do_not_exist_are_damage() -> None:
    """A file read against a store that lost its patterns, or has others."""
    for name in ("skeleton", "markers"):
        subject = SUBJECTS[name]
        tables = tuple(table[:1] for table in subject.codebook.patterns)
        smaller = Bench(
            subject.clip, subject.rig, replace(subject.codebook, patterns=tables), subject.rules
        )
        for tier in TIERS:
            survive(smaller, pack(FILES[name]), tier)


def test_a_forgery_can_be_sound() -> None:
    """The fuzzing above reaches the decoder: an unchanged file passes the same way."""
    for name, index in FILES.items():
        subject = SUBJECTS[name]
        decoded = decode(unpack(pack(index)), subject.rig, subject.codebook)
        assert oracle.clip_error(subject.clip, decoded).max() <= 0.1
