"""The state of a pad: when its dead-man button counts as held, and that no garbage makes it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.teleop.events import ABS_RX, ABS_X, ABS_Y, BTN_TL, BTN_TR, EV_KEY, Event, EventParser, encode_event
from lupin_runtime.teleop.pad_maps import USB
from lupin_runtime.teleop.pad_state import MAX_EVENTS, QUIET_S, STALE_S, DeadMan, PadState, Snapshot
from lupin_runtime.teleop.velocity import Sticks
from tests.support.pad_events import CONNECTED_NS, MS, SETTLED_NS, axis, dropped, held_state, key, new_state, report, xbox

NOW_NS = SETTLED_NS + 100 * MS
LATE_NS = NOW_NS - int(STALE_S * 1e9) - MS


def button(state: PadState) -> DeadMan:
    return state.dead_man


def test_press_counts_only_after_a_release_was_seen() -> None:
    state = new_state()
    state.handle(key(BTN_TL, 1, NOW_NS), NOW_NS)
    assert button(state) is DeadMan.UNKNOWN
    state.handle(key(BTN_TL, 0, NOW_NS), NOW_NS)
    state.handle(key(BTN_TL, 1, NOW_NS), NOW_NS)
    assert button(state) is DeadMan.HELD


def test_press_just_after_the_connection_does_not_count() -> None:
    at_ns = CONNECTED_NS + 10 * MS
    state = new_state()
    state.resynchronize(Snapshot((), {}))
    state.handle(key(BTN_TL, 1, at_ns), at_ns)
    assert state.dead_man is DeadMan.UNKNOWN


def test_release_does_not_wait_for_the_end_of_its_report() -> None:
    state = held_state(NOW_NS)
    state.handle(key(BTN_TL, 0, NOW_NS)[:1], NOW_NS)
    assert state.dead_man is DeadMan.RELEASED


def test_press_waits_for_the_end_of_its_report() -> None:
    state = new_state()
    state.handle(key(BTN_TL, 0, NOW_NS) + key(BTN_TL, 1, NOW_NS)[:1], NOW_NS)
    assert state.dead_man is DeadMan.RELEASED


def send_endless_report(state: PadState) -> None:
    for _ in range(2):
        state.handle(axis(ABS_X, 1, NOW_NS)[:1] * MAX_EVENTS, NOW_NS)


LOSSES: dict[str, Callable[[PadState], None]] = {
    "events were lost": lambda state: state.handle([dropped(NOW_NS), report(NOW_NS)], NOW_NS),
    "an event came late": lambda state: state.handle(axis(ABS_X, 1, LATE_NS), NOW_NS),
    "events were not read": lambda state: state.handle([], NOW_NS + int(STALE_S * 1e9) + MS),
    "a value is no state": lambda state: state.handle(key(BTN_TL, 7, NOW_NS), NOW_NS),
    "too many events": lambda state: state.handle(axis(ABS_X, 1, NOW_NS) * MAX_EVENTS, NOW_NS),
    "a report without an end": send_endless_report,
}


@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_dead_man_must_be_pressed_anew(loss: Callable[[PadState], None]) -> None:
    state = held_state(NOW_NS)
    loss(state)
    assert button(state) is DeadMan.UNKNOWN
    later_ns = NOW_NS + int(STALE_S * 1e9) + 2 * MS
    state.handle([report(later_ns), *key(BTN_TL, 1, later_ns)], later_ns)
    assert button(state) is DeadMan.UNKNOWN
    state.handle(key(BTN_TL, 0, later_ns) + key(BTN_TL, 1, later_ns), later_ns)
    assert button(state) is DeadMan.HELD


@pytest.mark.parametrize("is_repeated", [False, True], ids=["silent", "repeated-by-the-kernel"])
def test_silent_pad_is_not_believed_for_ever(is_repeated: bool) -> None:
    state = held_state(NOW_NS)
    step_ns = int(STALE_S * 1e9 / 2)
    for at_ns in range(NOW_NS, NOW_NS + int(QUIET_S * 1e9), step_ns):
        state.handle(key(BTN_TL, 2, at_ns) if is_repeated else [], at_ns)
        assert state.dead_man is DeadMan.HELD
    state.handle([], at_ns + 2 * step_ns)
    assert state.dead_man is DeadMan.UNKNOWN
    assert "changed nothing for 3 s" in state.take_problem() and state.take_problem() == ""


def test_pad_on_a_cable_may_be_held_still() -> None:
    state = PadState(xbox(), USB, {}, CONNECTED_NS, quiet_s=None)
    state.handle(key(BTN_TL, 0, NOW_NS) + key(BTN_TL, 1, NOW_NS), NOW_NS)
    for at_ns in range(NOW_NS, NOW_NS + int(4 * QUIET_S * 1e9), int(STALE_S * 1e9)):
        state.handle([], at_ns)
    assert state.dead_man is DeadMan.HELD


def test_events_between_a_loss_and_the_next_report_are_ignored() -> None:
    state = held_state(NOW_NS)
    lost = [dropped(NOW_NS), *key(BTN_TL, 0, NOW_NS), *key(BTN_TL, 1, NOW_NS)]
    state.handle(lost, NOW_NS)
    assert state.dead_man is DeadMan.UNKNOWN


@pytest.mark.parametrize(("keys", "known"), [((), DeadMan.RELEASED), ((BTN_TL,), DeadMan.UNKNOWN)])
def test_snapshot_tells_whether_a_press_will_count(keys: tuple[int, ...], known: DeadMan) -> None:
    state = held_state(NOW_NS)
    state.resynchronize(Snapshot((*keys, BTN_TR), {ABS_Y: -32768, 99: 5}))
    assert state.dead_man is known
    assert state.turbo
    assert state.sticks.forward == 1.0


def test_sticks_are_forward_left_and_left() -> None:
    state = held_state(NOW_NS)
    state.handle([event for code in (ABS_X, ABS_Y, ABS_RX) for event in axis(code, -32768, NOW_NS)], NOW_NS)
    assert state.sticks == Sticks(1.0, 1.0, 1.0)


def test_value_far_outside_the_range_counts_as_centered() -> None:
    state = held_state(NOW_NS)
    state.handle(axis(ABS_Y, -(2**31), NOW_NS), NOW_NS)
    assert state.sticks == Sticks()


EVENTS = st.builds(
    Event,
    st.sampled_from([NOW_NS, LATE_NS, 0]) | st.integers(0, 2**62),
    st.integers(0, 3) | st.integers(0, 0xFFFF),
    st.integers(0, 5) | st.sampled_from([BTN_TL, BTN_TR]) | st.integers(0, 0xFFFF),
    st.integers(-2, 2) | st.integers(-(2**31), 2**31 - 1),
)


@given(st.lists(EVENTS, max_size=60))
def test_held_means_released_and_then_pressed_in_time(events: list[Event]) -> None:
    state = new_state()
    for event in events:
        state.handle([event], NOW_NS)
        if state.dead_man is DeadMan.HELD:
            break
    else:
        return
    of_button = [event.value for event in events if (event.type, event.code) == (EV_KEY, BTN_TL)]
    assert 0 in of_button
    assert 1 in of_button[of_button.index(0) :]


@given(st.binary(max_size=4000), st.lists(st.integers(1, 200), max_size=40))
def test_random_bytes_never_hold_the_dead_man(data: bytes, lengths: list[int]) -> None:
    parser, state = EventParser(), new_state()
    for length in [*lengths, len(data)]:
        chunk, data = data[:length], data[length:]
        state.handle(parser.feed(chunk), NOW_NS)
        assert state.dead_man is not DeadMan.HELD
        assert all(-1.0 <= value <= 1.0 for value in vars(state.sticks).values())


@given(st.lists(EVENTS, max_size=20), st.lists(st.integers(1, 50), max_size=40))
def test_parser_joins_what_a_pipe_splits(events: list[Event], lengths: list[int]) -> None:
    events = [event._replace(time_ns=event.time_ns // 1000 * 1000) for event in events]
    data, parser, found = b"".join(map(encode_event, events)), EventParser(), []
    for length in [*lengths, len(data)]:
        chunk, data = data[:length], data[length:]
        found += parser.feed(chunk)
    assert found == events
