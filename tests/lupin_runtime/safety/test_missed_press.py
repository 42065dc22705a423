"""Only a stop that the bridge missed or forgot is remembered, until the e-stop has engaged and nothing holds it any more."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety.missed_press import ANSWER_S, HOLD_S, MissedPress

S = 1_000_000_000
ANSWER_NS, HOLD_NS = int(ANSWER_S * S), int(HOLD_S * S)


def test_unanswered_press_is_missed_until_the_stop_was_held() -> None:
    press = MissedPress()
    press.button(False, 0)
    press.button(True, S)
    press.button(False, S + S // 10)
    assert not press.tick(S + ANSWER_NS)
    assert press.tick(S + ANSWER_NS + 1)
    press.state(False, 3 * S)  # the bridge is back, and knows of no press
    assert press.tick(3 * S)
    press.state(True, 4 * S)
    assert press.tick(4 * S + HOLD_NS - 1)
    press.state(True, 4 * S + HOLD_NS - 1)
    assert not press.tick(4 * S + HOLD_NS)
    assert not press.tick(9 * S)


def test_console_that_holds_the_stop_counts_as_a_press() -> None:
    press = MissedPress()
    press.press(S)
    assert press.tick(S + ANSWER_NS + 1)


def test_pressed_button_in_the_first_message_counts_as_a_press() -> None:
    press = MissedPress()
    press.button(True, S)
    assert press.tick(S + ANSWER_NS + 1)


def run(press: MissedPress, start_ns: int, end_ns: int, state: bool | None) -> bool:
    """Repeat the e-stop's state at 5 Hz, as a bridge does; None stands for no bridge. Return whether a stop is missed."""
    missed = press.missed
    for now_ns in range(start_ns, end_ns, S // 5):
        if state is not None:
            press.state(state, now_ns)
        missed = press.tick(now_ns)
    return missed


@pytest.mark.parametrize("is_button", [True, False])
def test_held_stop_is_missed_once_its_bridge_is_gone(is_button: bool) -> None:
    press = MissedPress()

    def hold(held: bool) -> None:
        if is_button:
            press.button(held, 0)
        else:
            press.lose_stop(held)

    hold(True)
    assert not run(press, 0, 10 * S, True)
    assert run(press, 10 * S, 12 * S, None), "before the next bridge says anything"
    assert run(press, 12 * S, 20 * S, True), "the next bridge engages only because of this"
    hold(False)
    assert not run(press, 20 * S, 21 * S, True)
    assert not run(press, 21 * S, 30 * S, False)


def test_button_held_against_a_released_state_is_missed() -> None:
    press = MissedPress()
    press.button(True, 0)
    assert not run(press, 0, S, True)
    assert run(press, S, 3 * S, False)


@given(st.lists(st.integers(0, ANSWER_NS), min_size=4, max_size=4))
def test_hold_that_ends_with_its_state_is_not_missed(delays: list[int]) -> None:
    press = MissedPress()
    pressed, engaged, let_go, released = (at + delay for at, delay in zip((S, S, 9 * S, 9 * S), delays))
    down = False
    for now_ns in range(0, 20 * S, S // 20):
        if (pressed <= now_ns < let_go) is not down:
            down = not down
            press.button(down, now_ns)
        if now_ns % (S // 5) == 0:
            press.state(engaged <= now_ns < released, now_ns)
        assert not press.tick(now_ns)


@given(
    st.integers(0, ANSWER_NS),
    st.integers(0, ANSWER_NS),
    st.lists(st.integers(0, ANSWER_NS), max_size=5),
)
def test_answered_press_is_not_missed_in_any_order_of_arrival(at: int, answer: int, repeats: list[int]) -> None:
    press = MissedPress()
    press.state(False, 0)
    events = [(S + at, "press"), (S + answer, "engaged"), (S + answer, "released"), *((S + time, "press") for time in repeats)]
    for now_ns, event in sorted(events, key=lambda row: row[0]):
        if event == "press":
            press.button(True, now_ns)
        else:
            press.state(event == "engaged", now_ns)
    assert not press.tick(9 * S)


def test_state_engaged_for_an_unheard_source_answers_no_press() -> None:
    press = MissedPress()
    press.state(True, S)
    press.note_no_press()
    press.button(True, S)
    press.button(False, S)
    press.note_no_press()
    assert press.tick(S + ANSWER_NS + 1)
