"""The combined stop of several clients: any client engages it, and so does the loss or silence of one that drives."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.console.stop_registry import DRIVING_S, RETURN_TIMEOUT_S, SILENCE_TIMEOUT_S, StopRegistry, press_name

SECOND = 1_000_000_000
RETURN_NS = int(RETURN_TIMEOUT_S * SECOND)


def texts(stops: StopRegistry) -> list[str]:
    return [hold.text for hold in stops.reasons()]


def registry(*names: str) -> StopRegistry:
    stops = StopRegistry()
    for name in names:
        stops.join(name, name, 0)
    return stops


def test_stops_of_all_clients_are_combined() -> None:
    stops = registry("anne", "ben", "script")
    stops.set_stop("anne", False, 0)
    stops.set_stop("ben", True, 0)
    assert texts(stops) == ["ben holds the stop"]
    stops.set_stop("ben", False, 1)
    assert texts(stops) == []


def test_only_silence_of_client_in_control_engages_the_stop() -> None:
    stops = registry("anne", "ben", "script")
    for name in ("anne", "anne", "ben", "ben", "script"):
        stops.set_stop(name, False, 0)
    late_ns = int((SILENCE_TIMEOUT_S + 0.1) * SECOND)
    stops.check_silence(late_ns, "script")
    assert texts(stops) == [], "a script does not repeat the state of its stop"
    stops.check_silence(late_ns, "anne")
    assert texts(stops) == ["anne was silent for more than 1.5 s"]
    stops.set_stop("anne", False, late_ns)
    stops.check_silence(late_ns, None)
    assert texts(stops) == ["anne was silent for more than 1.5 s"], "it is released only on request"


def test_dead_connection_of_a_page_that_is_back_stops_nothing() -> None:
    stops = registry("anne")
    for _ in range(2):
        stops.set_stop("anne", False, 0)
    stops.join("anne again", "anne", 0)
    now_ns = int((SILENCE_TIMEOUT_S + 1.0) * SECOND)
    stops.check_silence(now_ns, "anne")
    assert not stops.leave("anne", now_ns, True) and texts(stops) == []
    for _ in range(2):
        stops.set_stop("anne again", False, now_ns)
    stops.check_silence(2 * now_ns, "anne")
    assert texts(stops) == ["anne was silent for more than 1.5 s"]


def test_page_that_connects_again_and_freezes_is_stopped() -> None:
    stops = registry("anne")
    for _ in range(2):
        stops.set_stop("anne", False, 0)
    stops.join("anne again", "anne", SECOND)
    stops.join("anne once more", "anne", 3 * SECOND)
    stops.set_stop("anne once more", False, 3 * SECOND)
    stops.check_silence(SECOND + RETURN_NS, "anne")
    assert texts(stops) == []
    stops.check_silence(SECOND + RETURN_NS + 1, "anne")
    assert texts(stops) == ["anne has not repeated its state since it connected again"]


def test_page_that_connects_again_and_closes_is_stopped() -> None:
    stops = registry("anne")
    for _ in range(2):
        stops.set_stop("anne", False, 0)
    stops.join("anne again", "anne", SECOND)
    assert not stops.leave("anne", SECOND, True) and texts(stops) == []
    assert not stops.leave("anne again", SECOND, True)
    assert texts(stops) == ["anne was lost while it had control"]


def test_second_tab_does_not_replace_a_first_that_closes_at_once() -> None:
    stops = registry("first tab")
    for _ in range(2):
        stops.set_stop("first tab", False, 0)
    stops.join("second tab", "first tab", 0)
    assert not stops.leave("first tab", SECOND // 5, True)
    assert texts(stops) == [], "the second tab may take over"
    stops.check_silence(RETURN_NS + 1, "first tab")
    assert texts(stops) == ["first tab has not repeated its state since it connected again"]


def test_page_without_control_need_not_return() -> None:
    stops = registry("anne")
    for _ in range(2):
        stops.set_stop("anne", False, 0)
    stops.join("anne again", "anne", 0)
    stops.check_silence(SECOND, "ben")
    stops.check_silence(RETURN_NS + 1, "anne")
    assert texts(stops) == []


def test_tab_that_took_over_covers_the_silence_of_the_other() -> None:
    stops = registry("first tab")
    for _ in range(2):
        stops.set_stop("first tab", False, 0)
    stops.join("second tab", "first tab", 0)
    for now_ns in (0, SECOND, 2 * SECOND):
        stops.set_stop("first tab", False, 0)
        stops.set_stop("second tab", False, now_ns)
    stops.check_silence(2 * SECOND, "first tab")
    assert not stops.leave("first tab", 2 * SECOND, True)
    assert texts(stops) == [], "the tab that left only watched"
    assert not stops.leave("second tab", 2 * SECOND, True)
    assert texts(stops) == ["first tab was lost while it had control"]


def test_watching_tab_does_not_replace_the_one_that_left() -> None:
    stops = registry("first tab")
    for _ in range(2):
        stops.set_stop("first tab", False, 0)
    stops.join("second tab", "first tab", 0)
    for _ in range(2):
        stops.set_stop("first tab", False, 0)
        stops.set_stop("second tab", False, 0)
    late_ns = int((SILENCE_TIMEOUT_S + 1.0) * SECOND)
    stops.set_stop("second tab", False, late_ns)
    assert not stops.leave("second tab", late_ns, True)
    assert texts(stops) == ["first tab was lost while it had control"], "the first has been silent for too long"


def test_client_lost_while_driving_or_stopping_leaves_the_stop() -> None:
    stops = registry("driver", "stopper", "holder", "idle", "visitor")
    assert stops.note_velocity("driver", True, 0)
    stops.note_velocity("idle", True, 0)
    stops.set_stop("stopper", True, 0)
    stops.set_stop("holder", False, 0)
    stops.set_stop("holder", False, 1)
    now_ns = int(DRIVING_S * SECOND)
    assert stops.leave("driver", now_ns, False)
    assert not stops.leave("stopper", now_ns, False)
    assert not stops.leave("holder", now_ns, True)
    assert not stops.leave("idle", now_ns + 1, False)
    assert len(texts(stops)) == 3
    stops.release_lost("driver")
    assert texts(stops) == []


def presses(stops: StopRegistry) -> list[str]:
    return [hold.press for hold in stops.reasons()]


def test_holder_lets_go_of_its_own_stop_only() -> None:
    stops = registry("viewer", "driver")
    stops.set_stop("viewer", True, 0, "press:1")
    stops.set_stop("driver", True, 0, "press:2")
    stops.release_lost("driver")
    assert texts(stops) == ["viewer holds the stop", "driver holds the stop"], "still pressed"
    stops.set_stop("viewer", False, 1, "press:1")
    assert texts(stops) == ["driver holds the stop"] and not stops.holds("viewer")


def test_released_press_is_over_until_the_next_one() -> None:
    stops = registry("page")
    stops.set_stop("page", True, 0, "press:1")
    stops.release(["press:1"], "driver")
    assert texts(stops) == [] and not stops.holds("page")
    assert stops.set_stop("page", True, 1, "press:1") == "driver", "the page repeats what it does not know to be over"
    assert texts(stops) == []
    assert stops.set_stop("page", True, 2, "press:2") == ""
    assert presses(stops) == ["press:2"]


def test_press_that_was_not_seen_is_not_released() -> None:
    stops = registry("page", "other")
    stops.set_stop("page", True, 0, "press:1")
    stops.set_stop("page", True, 1, "press:2")
    stops.set_stop("other", True, 1, "press:3")
    stops.hold_for("phone-1", 1)
    stops.release(["press:1", "press:3"], "driver")
    assert sorted(texts(stops)) == ["page holds the stop", "phone-1 stopped the robot"]
    assert stops.set_stop("page", True, 2, "press:2") == ""


@pytest.mark.parametrize("left", [True, False])
def test_session_lets_go_of_its_own_press_only(left: bool) -> None:
    stops = registry("page", "phone-1")
    if left:
        stops.hold_for("page", 0, "press:1")
    else:
        stops.set_stop("page", True, 0, "press:1")
        stops.leave("page", SECOND, False)
    stops.hold_for("phone-1", 1, "press:2")
    assert not stops.withdraw("press:2", "page") and not stops.withdraw("press:1", "phone-1")
    assert len(texts(stops)) == 2
    assert stops.withdraw("press:1", "page") and texts(stops) == ["phone-1 stopped the robot"]


def test_stop_of_a_page_lost_while_driving_is_not_withdrawn() -> None:
    stops = registry("page")
    stops.note_velocity("page", True, 0)
    stops.leave("page", 1, True)
    (hold,) = stops.reasons()
    assert not stops.withdraw(hold.press, "page") and stops.reasons() == [hold]


def test_released_press_of_a_lost_page_is_over_when_it_is_back() -> None:
    stops = registry("page")
    stops.set_stop("page", True, 0, "press:1")
    stops.leave("page", SECOND, False)
    assert [(hold.text, hold.since_ns) for hold in stops.reasons()] == [("page was lost while it held the stop", 0)]
    stops.release(["press:1"], "driver")
    stops.join("page", "page", SECOND)
    assert stops.set_stop("page", True, SECOND, "press:1") == "driver" and texts(stops) == []


def test_program_that_repeats_its_stop_engages_it_again() -> None:
    stops = registry("program")
    stops.set_stop("program", True, 0)
    stops.release(presses(stops), "driver")
    assert texts(stops) == []
    stops.set_stop("program", True, 1)
    assert texts(stops) == ["program holds the stop"], "nothing tells its repetition from a new press"


def test_stop_that_came_by_two_ways_is_let_go_by_one_word() -> None:
    stops = registry("page")
    stops.hold_for("page", 0, "press:1")
    stops.set_stop("page", True, 1, "press:1")
    stops.set_stop("page", False, 2, "press:1")
    assert texts(stops) == []
    stops.hold_for("page", 3, "press:2")
    stops.set_stop("page", False, 4, "press:3")
    assert presses(stops) == ["press:2"], "that of another tab"


def test_presses_of_which_nothing_is_known_are_not_remembered() -> None:
    stops = registry("page")
    stops.release(["press:1"], "driver")
    assert stops.set_stop("page", True, 0, "press:1") == "" and presses(stops) == ["press:1"]


def test_control_that_is_taken_again_is_not_silent_since_before() -> None:
    stops = registry("anne")
    for _ in range(2):
        stops.set_stop("anne", False, 0)
    taken_ns = 60 * SECOND
    limit_ns = int(SILENCE_TIMEOUT_S * SECOND)
    stops.check_silence(taken_ns + limit_ns, "anne", taken_ns)
    assert texts(stops) == []
    stops.check_silence(taken_ns + limit_ns + 1, "anne", taken_ns)
    assert texts(stops) == ["anne was silent for more than 1.5 s"]


@pytest.mark.parametrize("identifier", [None, 3, True, "", "publish:/lupin/hmi/estop:7", "press:" + 100 * "x", ["press:1"]])
def test_only_pages_name_their_presses(identifier: object) -> None:
    assert press_name(identifier) == ""
    assert press_name("press:a1-2") == "press:a1-2"


def test_stop_without_connection_stays_until_released() -> None:
    stops = registry()
    stops.hold_for("phone-1", 0)
    assert texts(stops) == ["phone-1 stopped the robot"]
    stops.release_lost("driver")
    assert texts(stops) == []


def test_driving_starts_once_and_ends_with_control() -> None:
    stops = registry("anne")
    assert stops.note_velocity("anne", True, 0)
    assert not stops.note_velocity("anne", True, SECOND // 10), "the same drive"
    assert stops.end_driving(SECOND // 5)
    assert not stops.end_driving(SECOND // 5)
    assert not stops.note_velocity("anne", False, SECOND // 5)


@given(st.lists(st.tuples(st.sampled_from("abc"), st.booleans(), st.integers(0, SECOND)), max_size=20))
def test_stop_is_engaged_while_any_client_holds_it(statements: list[tuple[str, bool, int]]) -> None:
    stops = registry("a", "b", "c")
    now_ns, last = 0, dict.fromkeys("abc", False)
    for name, engaged, step_ns in statements:
        now_ns += step_ns
        stops.set_stop(name, engaged, now_ns)
        last[name] = engaged
        assert bool(texts(stops)) == any(last.values())


TABS = st.sampled_from("abc")
STEPS = st.tuples(st.sampled_from(["join", "leave", "state", "state", "nothing"]), TABS, st.integers(0, SECOND // 2))


@given(st.lists(STEPS, max_size=60))
def test_session_that_repeated_is_silent_for_a_bounded_time(steps: list[tuple[str, str, int]]) -> None:
    stops = registry()
    stops.join("page", "anne", 0)
    for _ in range(2):
        stops.set_stop("page", False, 0)
    now_ns = stated_ns = 0
    tabs = set()
    for what, tab, step_ns in steps:
        now_ns += step_ns
        stops.check_silence(now_ns, "anne")
        if what == "join" and tab not in tabs:
            tabs.add(tab)
            stops.join(tab, "anne", now_ns)
        elif what == "leave" and tab in tabs:
            tabs.remove(tab)
            stops.leave(tab, now_ns, True)
        elif what == "state" and tab in tabs:
            stops.set_stop(tab, False, now_ns)
            stated_ns = now_ns
        limit_ns = int((SILENCE_TIMEOUT_S + RETURN_TIMEOUT_S + 0.5) * SECOND)
        assert stops.reasons() or now_ns - stated_ns <= limit_ns


def kinds(stops: StopRegistry) -> list[tuple[str, str, str]]:
    return [(event.kind.value, event.name, event.other) for event in stops.take_events()]


def test_every_stop_and_its_end_is_an_event_once() -> None:
    stops = registry("page", "phone")
    for now_ns in (0, 1, 2):
        stops.set_stop("page", True, now_ns, "press:1")
    stops.set_stop("page", False, 3, "press:1")
    assert kinds(stops) == [("stop_pressed", "page", ""), ("stop_withdrawn", "page", "")]
    stops.set_stop("page", True, 4, "press:2")
    stops.release(["press:2", "press:unknown"], "phone")
    assert kinds(stops) == [("stop_pressed", "page", ""), ("stop_released", "phone", "page")]
    assert kinds(stops) == [], "they were taken"


def test_silence_and_loss_are_events() -> None:
    stops = registry("anne", "ben")
    for _ in range(2):
        stops.set_stop("anne", False, 0)
    for _ in range(3):
        stops.check_silence(10 * SECOND, "anne")
    assert kinds(stops) == [("stop_silent", "anne", "")]
    stops.note_velocity("ben", True, 0)
    stops.leave("ben", 1, True)
    stops.release_lost("anne")
    released = [("stop_released", "anne", "anne"), ("stop_released", "anne", "ben")]
    assert kinds(stops) == [("stop_lost_driving", "ben", ""), *released]


def test_repeated_press_of_a_page_that_is_back_is_no_new_event() -> None:
    stops = registry("page")
    stops.set_stop("page", True, 0, "press:1")
    stops.leave("page", SECOND, False)
    stops.join("page", "page", SECOND)
    stops.set_stop("page", True, SECOND, "press:1")
    assert [kind for kind, *_ in kinds(stops)] == ["stop_pressed", "stop_lost_holding"]
    stops.set_stop("page", False, SECOND, "press:1")
    assert [kind for kind, *_ in kinds(stops)] == ["stop_withdrawn"]
