"""The mission's clock for time-outs, over a clock that is set while it runs."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.mission.adapters import LONGEST_STEP_S, NodeClock


class SetNode:
    """The part of a node that a NodeClock asks, with a clock that the test sets."""

    def __init__(self) -> None:
        self.ns = 1_000_000_000_000

    def elapsed_clock_ns(self) -> int:
        return self.ns


def clock() -> tuple[SetNode, NodeClock]:
    node = SetNode()
    made = NodeClock(node)  # type: ignore[arg-type]
    made.now_s()
    return node, made


def test_a_clock_that_is_set_back_holds_no_wait_up():
    node, made = clock()
    before = made.now_s()
    node.ns -= 3_600_000_000_000
    assert made.now_s() == before
    node.ns += 1_500_000_000
    assert made.now_s() == before + 1.5


def test_a_clock_that_is_set_forward_expires_no_long_wait():
    node, made = clock()
    before = made.now_s()
    node.ns += 3_600_000_000_000
    assert made.now_s() == before + LONGEST_STEP_S


@given(st.lists(st.integers(-(10**13), 10**13), max_size=30))
def test_it_never_goes_back_and_never_far_ahead(steps):
    node, made = clock()
    for step in steps:
        before = made.now_s()
        node.ns += step
        assert 0.0 <= made.now_s() - before <= LONGEST_STEP_S + 1e-6
