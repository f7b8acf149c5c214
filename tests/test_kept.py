"""What was made last is kept, as far as there is room."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motifold.codec.version2.motiondecode import Decoded, decode_states
from motifold.pipeline import Archive, shelf
from motifold.pipeline.kept import Kept

FROZEN = Path(__file__).parent / "fixtures" / "v5" / "archive"


@given(st.integers(0, 20), st.lists(st.tuples(st.booleans(), st.integers(0, 5))))
def test_it_is_what_a_list_of_the_latest_would_hold(
    room: int, steps: list[tuple[bool, int]]
) -> None:
    kept: Kept[int, str] = Kept(room)
    latest: list[int] = []
    for put, key in steps:
        if put:
            assert kept.keep(key, f"value {key}", key + 1) == f"value {key}"
            if key not in latest:
                latest.append(key)
            while len(latest) > 1 and sum(each + 1 for each in latest) > room:
                latest.pop(0)
        else:
            assert kept.get(key) == (f"value {key}" if key in latest else None)
            if key in latest:
                latest.remove(key)
                latest.append(key)
    for key in range(6):
        assert (kept.get(key) is not None) == (key in latest)


def test_the_first_key_that_is_known_counts() -> None:
    kept: Kept[str, int] = Kept(10)
    kept.keep("b", 2, 1)
    kept.keep("c", 3, 1)
    assert kept.get("a", "b", "c") == 2
    assert kept.get("a") is None
    assert kept.keep("b", 5, 1) == 2  # another thread was quicker


def test_threads_share_it() -> None:
    kept: Kept[int, int] = Kept(64)

    def use(number: int) -> bool:
        key = number % 13
        return kept.keep(key, key, 8) == key and kept.get(key) in (key, None)

    with ThreadPoolExecutor(8) as threads:
        assert all(threads.map(use, range(4000)))


def test_every_clip_of_an_archive_is_decoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though others refer to it, and to its mirror image, before and after."""
    decoded = []

    def counted(*known: object, **options: object) -> Decoded:
        decoded.append(known[0])
        return decode_states(*known, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(shelf, "decode_states", counted)
    with Archive(FROZEN) as archive:
        for clip in archive.values():
            clip.decode()
        files = {row.index for row in archive.numbered}  # of replaced clips, too
    assert len(decoded) == len(files)
