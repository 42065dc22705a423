"""One client's requests for one topic: the most demanding value of each option counts."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.console.subscription import ClientSubscription, Request

MILLISECOND = 1_000_000


def test_requests_are_merged_and_separated_again() -> None:
    merged = ClientSubscription()
    merged.add("slow", Request(throttle_ms=500, queue_length=5, compression="png"))
    merged.add("fast", Request(throttle_ms=100, queue_length=2, compression="cbor"))
    assert (merged.queue_length, merged.compression) == (2, "cbor")
    merged.remove("fast")
    assert (merged.queue_length, merged.compression) == (5, "png")
    merged.remove("unknown")
    assert merged
    merged.remove(None)
    assert not merged


@given(st.lists(st.integers(0, 200), min_size=1, max_size=40))
def test_messages_are_throttled_and_first_is_sent_at_once(steps_ms: list[int]) -> None:
    merged = ClientSubscription()
    merged.add(None, Request(throttle_ms=100))
    now_ms, sent_ms = 0, []
    for step_ms in steps_ms:
        now_ms += step_ms
        if merged.due(now_ms * MILLISECOND):
            sent_ms.append(now_ms)
    assert sent_ms[0] == steps_ms[0]
    assert all(later - earlier >= 100 for earlier, later in itertools.pairwise(sent_ms))


def test_clock_set_back_does_not_silence_subscription() -> None:
    merged = ClientSubscription()
    merged.add(None, Request(throttle_ms=100))
    assert merged.due(10**15)
    assert merged.due(5)
