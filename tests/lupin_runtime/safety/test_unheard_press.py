"""Presses that a node did not hear: the bridge's count tells of them, whatever was lost in between."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety.unheard_press import RECENT_S, REPORTED_S, PressCounter, UnheardPress

S = 1_000_000_000


LAPTOP_NS = -4_000 * S  # what the laptop's clock shows when the robot's shows 0


def text(counter: PressCounter, now_ns: int = 0) -> str:
    return json.dumps({"engaged": False, "reasons": [], **counter.report(now_ns)})


def press(counter: PressCounter, pressed_s: float, released_s: float | None = None) -> None:
    counter.update(True, int(pressed_s * S))
    counter.update(True, int((pressed_s if released_s is None else released_s) * S))
    counter.update(False, int((pressed_s if released_s is None else released_s) * S) + 1)


def test_press_during_a_gap_is_detected_once() -> None:
    counter, node = PressCounter(), UnheardPress()
    assert not node.status(text(counter), 0)
    press(counter, 5)
    assert node.status(text(counter), 9 * S)
    assert not node.status(text(counter), 10 * S)


def test_press_of_a_replaced_bridge_is_detected() -> None:
    counter, node = PressCounter(), UnheardPress()
    node.status(text(counter), 0)
    replaced = PressCounter()
    assert not node.status(text(replaced), S)
    another = PressCounter()
    press(another, 2)
    assert node.status(text(another), 3 * S)


@pytest.mark.parametrize(("ago_s", "expected"), [(0.0, True), (RECENT_S - 0.1, True), (RECENT_S + 1, False)])
@pytest.mark.parametrize("held_s", [0.0, 300.0])
def test_node_that_has_just_started_takes_over_a_recent_press(ago_s: float, held_s: float, expected: bool) -> None:
    counter = PressCounter()
    press(counter, 100, 100 + held_s)
    now_ns = int((100 + held_s + ago_s) * S)
    assert UnheardPress().status(text(counter, now_ns), now_ns + LAPTOP_NS) is expected


@pytest.mark.parametrize(("pressed_s", "expected"), [(49.0, False), (50.0, True), (99.0, True)])
def test_press_since_the_command_is_told_by_the_first_status(pressed_s: float, expected: bool) -> None:
    counter = PressCounter()
    press(counter, pressed_s)
    assert UnheardPress(since_ns=50 * S + LAPTOP_NS).status(text(counter, 100 * S), 100 * S + LAPTOP_NS) is expected


def test_status_is_repeated_while_its_age_matters() -> None:
    counter = PressCounter()
    assert not counter.is_recent(0)
    press(counter, 10)
    assert counter.is_recent(11 * S) and not counter.is_recent(int((11 + REPORTED_S) * S))


@pytest.mark.parametrize(
    "damaged",
    [
        "",
        "{",
        "[]",
        "null",
        "{}",
        '{"bridge": 1, "presses": 2, "engaged_s_ago": 3}',
        '{"bridge": "a", "presses": 2, "engaged_s_ago": 1%s}' % ("0" * 400),
        '{"bridge": "a", "presses": 2, "engaged_s_ago": 1%s}' % ("0" * 300),
        '{"bridge": "a", "presses": 2, "engaged_s_ago": NaN}',
    ],
)
def test_damaged_status_tells_nothing(damaged: str) -> None:
    assert not UnheardPress().status(damaged, 0)


@given(st.lists(st.tuples(st.sampled_from(["press", "lost status", "status", "new bridge"]), st.integers(1, 10)), max_size=40))
def test_no_press_before_the_last_status_stays_undetected(events: list[tuple[str, int]]) -> None:
    counter, node, now_ns, pressed = PressCounter(), UnheardPress(), 0, False
    node.status(text(counter), 0)
    for event, seconds in events:
        now_ns += seconds * S
        if event == "press":
            press(counter, now_ns / S)
            pressed = True
        elif event == "new bridge":
            # The witness in another process reports what the old bridge's end swallowed.
            counter, pressed = PressCounter(), False
        elif event == "status":
            assert node.status(text(counter), now_ns) == pressed
            pressed = False
