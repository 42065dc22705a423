"""Any split of a text is reassembled, and unfinished messages use limited memory."""

from __future__ import annotations

import random
import tracemalloc
from typing import Any

import orjson
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.console import fragments as limits
from lupin_runtime.console.encoding import fragments
from lupin_runtime.console.fragments import BadFragment, Defragmenter


@given(text=st.text(min_size=1, max_size=200), size=st.integers(1, 50), seed=st.integers(0, 99))
def test_fragments_in_any_order_are_reassembled(text: str, size: int, seed: int) -> None:
    parts = [orjson.loads(part) for part in fragments(text.encode("utf-8", "replace"), size, "7")]
    random.Random(seed).shuffle(parts)
    defragmenter = Defragmenter()
    results = [defragmenter.add(part, 0.0) for part in parts]
    assert results[:-1] == [None] * (len(parts) - 1)
    assert results[-1] == text.encode("utf-8", "replace").decode()


@pytest.mark.parametrize(
    "fragment",
    [
        {},
        {"id": "a", "data": "x", "num": 0, "total": 0},
        {"id": "a", "data": "x", "num": 2, "total": 2},
        {"id": "a", "data": "x", "num": -1, "total": 2},
        {"id": "a", "data": 3, "num": 0, "total": 2},
        {"id": "a", "data": "x", "num": True, "total": 2},
        {"id": "a", "data": "x", "num": 0, "total": 10**9},
    ],
)
def test_bad_fragment_is_refused(fragment: dict[str, Any]) -> None:
    with pytest.raises(BadFragment):
        Defragmenter().add(fragment, 0.0)


def test_repeated_fragment_and_changed_total_are_refused() -> None:
    defragmenter = Defragmenter()
    defragmenter.add({"id": 1, "data": "x", "num": 0, "total": 2}, 0.0)
    for total in (2, 3):
        with pytest.raises(BadFragment, match="does not fit"):
            defragmenter.add({"id": 1, "data": "x", "num": 0, "total": total}, 0.0)


def test_unfinished_messages_are_limited_and_expire(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "MAX_CHARACTERS", 1000)
    defragmenter = Defragmenter()
    for number in range(1000):
        defragmenter.add({"id": number, "data": "x" * 100, "num": 0, "total": 2}, 0.0)
    assert defragmenter.waiting_characters <= 1000
    defragmenter.add({"id": "late", "data": "y", "num": 0, "total": 2}, limits.TIMEOUT_S + 1)
    assert defragmenter.waiting_characters == 1 + limits.FRAGMENT_CHARACTERS


def test_empty_fragments_count_as_memory() -> None:
    defragmenter = Defragmenter()
    tracemalloc.start()
    try:
        for message in range(limits.MAX_MESSAGES):
            for number in range(limits.MAX_FRAGMENTS - 1):
                defragmenter.add({"id": message, "data": "", "num": number, "total": limits.MAX_FRAGMENTS}, 0.0)
        assert tracemalloc.get_traced_memory()[0] < limits.MAX_CHARACTERS
    finally:
        tracemalloc.stop()
    assert defragmenter.waiting_characters <= limits.MAX_CHARACTERS
