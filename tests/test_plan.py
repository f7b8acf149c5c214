"""The plan of a job: every source once, in order, in batches of bounded work."""

from __future__ import annotations

import json
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.errors import UsageError
from motifold.codec.patterns.segments import SegmentRules
from motifold.pipeline.clustering import ClusterRules
from motifold.pipeline.discover import Source
from motifold.pipeline.plan import BATCH_BYTES, BATCH_CLIPS, Settings, make_plan

sizes = st.lists(
    st.one_of(st.integers(0, 10_000), st.integers(0, 3 * BATCH_BYTES)), max_size=3 * BATCH_CLIPS
)


def sources(of_sizes: list[int]) -> list[Source]:
    return [Source(f"{n:03d}.bvh", f"/l/{n:03d}.bvh", size) for n, size in enumerate(of_sizes)]


@given(sizes, st.randoms(use_true_random=False))
def test_every_source_is_in_the_plan_once_and_in_order(
    of_sizes: list[int], shuffle: random.Random
) -> None:
    found = sources(of_sizes)
    shuffled = found.copy()
    shuffle.shuffle(shuffled)
    plan = make_plan(shuffled, Settings())
    assert [source for batch in plan.batches for source in batch] == found
    assert plan == make_plan(found, Settings())
    assert plan.clips == len(of_sizes)
    assert plan.source_bytes == sum(of_sizes)


@given(sizes)
def test_batches_are_bounded_and_none_is_smaller_than_it_must_be(of_sizes: list[int]) -> None:
    batches = make_plan(sources(of_sizes), Settings()).batches
    work = [sum(source.size for source in batch) for batch in batches]
    for batch, size in zip(batches, work, strict=True):
        assert 1 <= len(batch) <= BATCH_CLIPS
        assert size <= BATCH_BYTES or len(batch) == 1
    for batch, size, following in zip(batches, work, batches[1:], strict=False):
        assert len(batch) == BATCH_CLIPS or size + following[0].size > BATCH_BYTES


def test_a_plan_of_nothing_has_no_batches() -> None:
    assert make_plan([], Settings()).batches == ()


@pytest.mark.parametrize("tolerance", [0.0, -1.0, 0.99e-4, 1000.1, math.nan, math.inf])
def test_a_tolerance_that_cannot_be_kept_is_refused(tolerance: float) -> None:
    with pytest.raises(UsageError, match="cannot be kept"):
        Settings(tolerance=tolerance)


def test_units_and_seed_are_checked_before_any_work() -> None:
    assert Settings(units="5.644 cm").units == "5.644 cm"
    with pytest.raises(UsageError, match="furlong"):
        Settings(units="furlong")
    with pytest.raises(UsageError, match="seed"):
        Settings(seed=-1)


def test_what_is_left_out_must_be_there() -> None:
    assert Settings(without=("world", "basis")).without == ("world", "basis")
    assert Settings(model="fixed", without=("world",)).model == "fixed"
    with pytest.raises(UsageError, match="'wings'"):
        Settings(without=("wings",))
    with pytest.raises(UsageError, match="without contexts"):
        Settings(model="basis", without=("contexts",))


def test_rules_are_checked() -> None:
    with pytest.raises(UsageError, match="segmentation"):
        SegmentRules("cubic")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="bound"):
        ClusterRules("least")  # type: ignore[arg-type]
    for radius in (math.nan, -0.1, math.inf):
        with pytest.raises(UsageError, match="radius"):
            ClusterRules(radius_coefficient=radius)


def test_settings_fit_in_json() -> None:
    settings = Settings(0.05, "mm", SegmentRules("fisher"), ClusterRules("average", 0.4), 7)
    record = json.loads(json.dumps(settings.to_record()))
    assert record == settings.to_record()
    assert (
        Settings(
            record["tolerance"],
            record["units"],
            SegmentRules(**record["segments"]),
            ClusterRules(**record["clusters"]),
            record["seed"],
        )
        == settings
    )
