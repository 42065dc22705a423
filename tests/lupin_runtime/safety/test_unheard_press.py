"""Presses that a node did not hear: the bridge's count tells of them, whatever was lost in between."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety.unheard_press import RECENT_PRESS_S, PressCounter, UnheardPress

S = 1_000_000_000


def text(counter: PressCounter) -> str:
    return json.dumps({"engaged": False, "reasons": [], **counter.report()})


def test_press_during_a_gap_is_detected_once() -> None:
    counter, node = PressCounter(), UnheardPress()
    assert not node.status(text(counter), 0)
    counter.count(5 * S)
    assert node.status(text(counter), 9 * S)
    assert not node.status(text(counter), 10 * S)


def test_press_of_a_replaced_bridge_is_detected() -> None:
    counter, node = PressCounter(), UnheardPress()
    node.status(text(counter), 0)
    replaced = PressCounter()
    assert not node.status(text(replaced), S)
    another = PressCounter()
    another.count(2 * S)
    assert node.status(text(another), 3 * S)


@pytest.mark.parametrize(
    ("ago_s", "expected"), [(0.0, True), (RECENT_PRESS_S, True), (RECENT_PRESS_S + 1, False), (-1.0, False)]
)
def test_node_that_has_just_started_takes_over_a_recent_press(ago_s: float, expected: bool) -> None:
    counter = PressCounter()
    counter.count(100 * S)
    assert UnheardPress().status(text(counter), int((100 + ago_s) * S)) is expected


@pytest.mark.parametrize("damaged", ["", "{", "[]", "null", "{}", '{"bridge": 1, "presses": 2, "pressed_ns": 3}'])
def test_damaged_status_tells_nothing(damaged: str) -> None:
    assert not UnheardPress().status(damaged, 0)


@given(st.lists(st.tuples(st.sampled_from(["press", "lost status", "status", "new bridge"]), st.integers(1, 10)), max_size=40))
def test_no_press_before_the_last_status_stays_undetected(events: list[tuple[str, int]]) -> None:
    counter, node, now_ns, pressed = PressCounter(), UnheardPress(), 0, False
    node.status(text(counter), 0)
    for event, seconds in events:
        now_ns += seconds * S
        if event == "press":
            counter.count(now_ns)
            pressed = True
        elif event == "new bridge":
            # The witness in another process reports what the old bridge's end swallowed.
            counter, pressed = PressCounter(), False
        elif event == "status":
            assert node.status(text(counter), now_ns) == pressed
            pressed = False
