"""Only a press that the bridge missed is remembered until the e-stop has engaged."""

from __future__ import annotations

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
