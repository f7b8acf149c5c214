"""Postings and time warping against plain loops that share no code with them."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from motifold.catalog.bodysignals import PARTS
from motifold.catalog.framewarp import frame_distances, warped_frames, warped_span, warping_path
from motifold.catalog.kernels import add_scores
from motifold.catalog.postings import (
    PASSAGE,
    SCALE,
    TERMS_A_PART,
    Postings,
    make_postings,
    passages_of,
)
from motifold.catalog.search import column_weights
from motifold.catalog.vocabulary import COLUMNS, NO_WORD, Words
from motifold.catalog.wordwarp import (
    Surroundings,
    slid_inside,
    surroundings,
    warped,
    warped_inside,
    warped_path,
)

TABLE = np.ones((len(COLUMNS), 256, 256), np.float32)
_POINTS = np.random.default_rng(0).normal(size=(len(COLUMNS), 20, 2))
TABLE[:, :20, :20] = np.linalg.norm(_POINTS[:, :, None] - _POINTS[:, None], axis=3)
WEIGHTS = np.full(len(COLUMNS), 1 / len(COLUMNS))
SEEDS = st.integers(0, 2**32 - 1)


def said(seed: int, samples: int) -> Words:
    rng = np.random.default_rng([seed, samples])
    words = rng.integers(0, 20, (samples, len(COLUMNS)))
    words[rng.random(words.shape) < 0.05] = NO_WORD
    return words.astype(np.uint8)


def costs(some: Words, others: Words) -> np.ndarray:
    out = np.zeros((len(some), len(others)))
    for i, row in enumerate(some):
        for j, other in enumerate(others):
            out[i, j] = sum(
                WEIGHTS[k] * TABLE[k, a, b] for k, (a, b) in enumerate(zip(row, other, strict=True))
            )
    return out


def plainly_warped(cost: np.ndarray) -> float:
    total = np.full(cost.shape, np.inf)
    for i in range(cost.shape[0]):
        for j in range(cost.shape[1]):
            ways = [2 * cost[0, 0]] if i == j == 0 else []
            if i:
                ways.append(total[i - 1, j] + cost[i, j])
            if j:
                ways.append(total[i, j - 1] + cost[i, j])
            if i and j:
                ways.append(total[i - 1, j - 1] + 2 * cost[i, j])
            total[i, j] = min(ways)
    return float(total[-1, -1] / sum(cost.shape))


@settings(max_examples=30, deadline=None)
@given(SEEDS, st.integers(1, 12), st.integers(1, 12))
def test_warping_is_that_of_the_textbook(seed: int, some: int, others: int) -> None:
    query, clip = said(seed, some), said(seed + 1, others)
    cost = costs(query, clip)
    expected = plainly_warped(cost)
    beside = said(seed + 2, 9)
    found = warped(query, [beside, clip, query], TABLE, WEIGHTS)
    assert np.allclose(found[1], expected, rtol=1e-5)
    assert np.isclose(found[0], plainly_warped(costs(query, beside)), rtol=1e-5)
    rng = np.random.default_rng(seed)
    frames = [rng.normal(size=(n, 6)).astype(np.float32) for n in (some, others)]
    plain = np.linalg.norm(frames[0][:, None] - frames[1][None], axis=2)
    assert np.allclose(frame_distances(*frames), plain, atol=1e-3)
    assert np.isclose(warped_frames(*frames), plainly_warped(plain), atol=1e-3)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(4, 12), st.integers(0, 20), st.integers(0, 20))
def test_a_planted_span_is_found(seed: int, wide: int, before: int, after: int) -> None:
    query = said(seed, wide)
    query[query == NO_WORD] = 0
    clip = np.concatenate([said(seed + 1, before), query, said(seed + 2, after)])
    clips = [said(seed + 3, 5), clip, said(seed + 4, 40)]
    for find in (warped_inside, slid_inside):
        distance, first, last = (each[1] for each in find(query, clips, TABLE, WEIGHTS))
        assert (round(distance, 6), first, last) == (0.0, before, before + wide)
    assert np.allclose(warped_path(query, [clips[0], query], TABLE, WEIGHTS)[1], 0.0)


def plainly_inside(cost: np.ndarray) -> list[tuple[float, int]]:
    """The cheapest way to each end and where it began: one sample on, none and one, or two."""
    wide, long = cost.shape
    ways = {(0, j): (float(cost[0, j]), j) for j in range(long)}
    nowhere = (np.inf, 0)
    for i in range(1, wide):
        for j in range(1, long):
            slow, begun = ways.get((i - 2, j - 1), nowhere)
            total, begun = min(
                ways.get((i - 1, j - 1), nowhere),
                ways.get((i - 1, j - 2), nowhere),
                (slow + cost[i - 1, j], begun),
            )
            ways[i, j] = (total + cost[i, j], begun)
    return [ways.get((wide - 1, j), nowhere) for j in range(long)]


def plainly_beside(beside: Surroundings, clip: Words, first: int, last: int) -> float:
    """What surroundings add to a span of a clip, its last sample included."""
    near = [max(first - 2 * n, 0) for n in range(len(beside.before), 0, -1)]
    after = [min(last + 2 * n, len(clip) - 1) for n in range(1, len(beside.after) + 1)]
    words = np.concatenate(beside)
    return 0.1 * float(np.trace(costs(words, clip[[*near, *after]])))


@settings(max_examples=30, deadline=None)
@given(
    SEEDS,
    st.integers(1, 12),
    st.tuples(st.integers(0, 10), st.integers(0, 10)),
    st.lists(st.integers(1, 20), min_size=1, max_size=5),
)
def test_warping_inside_is_that_of_plain_loops(
    seed: int, wide: int, around: tuple[int, int], lengths: list[int]
) -> None:
    query = said(seed, wide)
    beside = Surroundings(said(seed + 50, around[0]), said(seed + 51, around[1]))
    clips = [said(seed + 1 + number, length) for number, length in enumerate(lengths)]
    warps, slides = (
        find(query, clips, TABLE, WEIGHTS, beside) for find in (warped_inside, slid_inside)
    )
    for number, clip in enumerate(clips):
        cost = costs(query, clip)
        ways = [
            (total + plainly_beside(beside, clip, begun, last)) / wide
            for last, (total, begun) in enumerate(plainly_inside(cost))
        ]
        assert np.allclose(warps[0][number], min(ways), rtol=1e-5)
        if min(ways) < np.inf:
            assert np.isclose(ways[warps[2][number] - 1], min(ways), rtol=1e-5)
        ends = [
            (
                sum(cost[i, at + i] if at + i < len(clip) else 1.0 for i in range(wide))
                + plainly_beside(beside, clip, at, min(at + wide, len(clip)) - 1)
            )
            / wide
            for at in range(max(len(clip) - wide, 0) + 1)
        ]
        assert np.isclose(slides[0][number], min(ends), rtol=1e-5)
        assert np.isclose(ends[slides[1][number]], min(ends), rtol=1e-5)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(1, 12), st.integers(1, 12))
def test_the_path_is_one_that_costs_least(seed: int, some: int, others: int) -> None:
    query, clip = said(seed, some), said(seed + 1, others)
    columns = warped_path(query, [clip], TABLE, WEIGHTS)[0]
    path = cheapest_path(costs(query, clip))
    plain = [
        np.mean([TABLE[k, query[i, k], clip[j, k]] for i, j in path]) for k in range(len(COLUMNS))
    ]
    assert np.allclose(columns, plain, rtol=1e-4)


def cheapest_path(cost: np.ndarray) -> list[tuple[int, int]]:
    """The path of `plainly_warped`, by taking steps back to what the total came from."""
    total = np.full((cost.shape[0] + 1, cost.shape[1] + 1), np.inf)
    total[0, 0] = 0.0
    for i, j in np.ndindex(*cost.shape):
        ways = total[i, j] + 2 * cost[i, j], min(total[i, j + 1], total[i + 1, j]) + cost[i, j]
        total[i + 1, j + 1] = min(ways)
    i, j = cost.shape
    path = []
    while i and j:
        path.append((i - 1, j - 1))
        here = cost[i - 1, j - 1]
        sources = {
            (i - 1, j - 1): total[i - 1, j - 1] + 2 * here,
            (i - 1, j): total[i - 1, j] + here,
            (i, j - 1): total[i, j - 1] + here,
        }
        i, j = min(sources, key=sources.__getitem__)
    return path


@given(arrays(np.float64, len(PARTS), elements=st.floats(0, 1)), st.floats(0, 1))
def test_a_part_counts_what_it_weighs_and_its_postures_their_share(
    parts: np.ndarray, share: float
) -> None:
    weights = dict(zip(COLUMNS, column_weights(parts, share), strict=True))
    for part, weight in zip(PARTS, parts, strict=True):
        postures = [weights[column] for column in COLUMNS if column.startswith(f"{part}_")]
        assert np.isclose(weights[part], (1 - share) * weight)
        assert np.allclose(postures, share * weight / len(postures))


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(4, 12), st.integers(3, 9))
def test_of_a_motion_twice_in_a_clip_the_one_with_the_same_surroundings_is_found(
    seed: int, wide: int, between: int
) -> None:
    """Of two equal spans it is the one before and after which the same happens."""
    again = said(seed, wide)
    apart = [said(seed + n, between) for n in range(1, 4)]
    query = np.concatenate([apart[0], again, apart[1], again, apart[2]])
    clip = np.concatenate([said(seed + 9, 30), *apart[:1], again, apart[1], again, *apart[2:]])
    starts = [between, 2 * between + wide]
    for start in starts:
        beside = surroundings(query, start, start + wide)
        for find in (warped_inside, slid_inside):
            first = find(again, [clip], TABLE, WEIGHTS, beside)[1]
            assert first[0] == 30 + start


def test_surroundings_are_two_seconds_at_every_second_sample() -> None:
    words = np.arange(100, dtype=np.uint8)[:, None].repeat(len(COLUMNS), axis=1)
    before, after = (each[:, 0].tolist() for each in surroundings(words, 40, 55))
    assert before == list(range(20, 40, 2))
    assert after == list(range(56, 76, 2))
    assert [len(each) for each in surroundings(words, 0, 100)] == [0, 0]
    assert surroundings(words, 5, 97).before[:, 0].tolist() == [1, 3]
    assert surroundings(words, 5, 97).after[:, 0].tolist() == [98]


def test_a_clip_too_short_to_warp_is_infinitely_far() -> None:
    clips = [said(1, 3), said(1, 12)]
    assert np.isinf(warped_inside(said(0, 9), clips, TABLE, WEIGHTS)[0]).tolist() == [True, False]
    assert np.isfinite(slid_inside(said(0, 9), clips, TABLE, WEIGHTS)[0]).all()


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(2, 15), st.integers(0, 9))
def test_a_planted_span_of_frames_is_found(seed: int, wide: int, before: int) -> None:
    rng = np.random.default_rng(seed)
    clip = rng.normal(size=(30, 6)).astype(np.float32)
    distance, first, last = warped_span(clip[before : before + wide], clip)
    assert distance < 1e-2
    assert (first, last) == (before, before + wide)
    path = warping_path(clip, clip)
    assert np.array_equal(path, np.column_stack([np.arange(30)] * 2))


@given(st.lists(st.integers(0, 400), min_size=1, max_size=8))
def test_passages_cover_every_sample(lengths: list[int]) -> None:
    starts = np.concatenate([[0], np.cumsum(lengths)])
    spans = passages_of(starts)
    for clip, length in enumerate(lengths):
        own = spans[spans[:, 0] == clip]
        assert len(own) >= 1
        assert (own[:, 2] - own[:, 1] <= PASSAGE).all()
        covered = set().union(*(range(first, last) for _, first, last in own.tolist()))
        assert covered == set(range(length))


@settings(max_examples=15, deadline=None)
@given(SEEDS, st.lists(st.integers(1, 200), min_size=1, max_size=5))
def test_postings_hold_the_roots_of_shares(seed: int, lengths: list[int]) -> None:
    words = said(seed, sum(lengths))
    starts = np.concatenate([[0], np.cumsum(lengths)])
    spans = passages_of(starts)
    soft = [0.75 * np.eye(20) + 0.25 * np.roll(np.eye(20), 1, axis=1) for _ in PARTS]
    made = make_postings(words, starts, spans, soft, (np.zeros(TERMS_A_PART * 7, np.int64), 0))
    dense = np.zeros((len(spans), TERMS_A_PART * len(PARTS)))
    for number, (clip, first, last) in enumerate(spans.tolist()):
        for part in range(len(PARTS)):
            column = [
                w
                for w in words.astype(int)[starts[clip] + first : starts[clip] + last, part]
                if w < 255
            ]
            for word in column:
                dense[number, part * TERMS_A_PART + word] += 0.75 / len(column)
                dense[number, part * TERMS_A_PART + (word + 1) % 20] += 0.25 / len(column)
    dense = np.sqrt(np.where(dense < 0.01 - 1e-9, 0.0, dense))
    factors = np.random.default_rng(seed).random(dense.shape[1]).astype(np.float32)
    out = np.zeros(len(spans), np.float32)
    terms = np.arange(dense.shape[1])
    add_scores(made.starts, made.passages, made.weights, terms, factors, out)
    assert np.allclose(out / SCALE, dense @ factors, atol=0.3)
    again = np.zeros_like(out)
    made.add_scores(terms, factors, again)
    assert np.allclose(again, out, rtol=1e-5)
    rare = np.log((1 + len(spans)) / (1 + (np.rint(SCALE * dense) > 0).sum(axis=0)))
    norms = (dense**2 * rare).reshape(len(spans), len(PARTS), -1).sum(axis=2)
    assert np.allclose(made.norms, norms, atol=0.02)


def test_postings_that_point_beyond_the_passages_are_passed_over() -> None:
    out = np.zeros(2, np.float32)
    lists = np.array([0, 7, 1], np.uint32), np.full(3, 255, np.uint8)
    add_scores(np.array([0, 3]), *lists, np.array([0]), np.ones(1, np.float32), out)
    assert out.tolist() == [255.0, 255.0]
    again = np.zeros(2, np.float32)
    damaged = Postings(np.array([0, 3]), *lists, np.zeros((2, 7), np.float32))
    damaged.add_scores(np.array([0]), np.ones(1, np.float32), again)
    assert again.tolist() == [255.0, 255.0]
