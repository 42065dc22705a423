"""The mission's clock for timeouts, while the system's clock is set."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.mission.adapters import MAX_STEP_S, NodeClock


class FakeNode:
    """The part of a node that NodeClock uses, with a clock that the test sets."""

    def __init__(self) -> None:
        self.ns = 1_000_000_000_000

    def elapsed_clock_ns(self) -> int:
        return self.ns


def make_clock() -> tuple[FakeNode, NodeClock]:
    node = FakeNode()
    made = NodeClock(node)  # type: ignore[arg-type]
    made.now_s()
    return node, made


def test_clock_set_back_does_not_delay_timeouts() -> None:
    node, made = make_clock()
    before = made.now_s()
    node.ns -= 3_600_000_000_000
    assert made.now_s() == before
    node.ns += 1_500_000_000
    assert made.now_s() == before + 1.5


def test_clock_set_forward_does_not_expire_timeouts() -> None:
    node, made = make_clock()
    before = made.now_s()
    node.ns += 3_600_000_000_000
    assert made.now_s() == before + MAX_STEP_S


@given(st.lists(st.integers(-(10**13), 10**13), max_size=30))
def test_clock_never_decreases_and_steps_are_bounded(steps: list[int]) -> None:
    node, made = make_clock()
    for step in steps:
        before = made.now_s()
        node.ns += step
        assert 0.0 <= made.now_s() - before <= MAX_STEP_S + 1e-6
