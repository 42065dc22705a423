"""The e-stop combines button and console, and reports sources that are silent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety import ConsoleStop, EstopSources
from lupin_runtime.safety.console_stop import CONSOLE_HOLDS_STOP
from lupin_runtime.safety.estop import MISSED_PRESS, MISSED_PRESS_OR_SILENCE
from lupin_runtime.safety.expected_sources import (
    BUTTON,
    CONSOLE,
    ESTOP_BUTTON,
    UNHEARD,
    UNHEARD_BUTTON,
    WITNESS,
    tells_of_no_press,
    waits_for_sources,
)

S = 10**9


def sources(**options: Any) -> EstopSources:
    return EstopSources(ConsoleStop(), **options)


@given(st.booleans(), st.booleans(), st.booleans())
def test_estop_is_the_or_of_button_and_console(engaged_value: bool, button: bool, console: bool) -> None:
    stop = sources(engaged_value=engaged_value)
    stop.button(button, S, S)
    stop.consoles.update(console, S)
    state = stop.state(S, S)
    assert state.engaged == ((button == engaged_value) or console) == bool(state.reasons)


def test_estop_that_expects_no_source_is_released_with_a_warning() -> None:
    state = sources().state(0, 0)
    assert not state.engaged and state.warnings == ("no message from the button yet",)


@pytest.mark.parametrize("pressed", [False, True])
def test_silent_button_keeps_its_value_if_configured(pressed: bool) -> None:
    stop = sources(button_silence_engages=False)
    stop.button(pressed, S, S)
    state = stop.state(4 * S, 4 * S)
    assert state.engaged == pressed and "silent" in state.warnings[0]


def test_missed_stop_is_a_reason_only_without_another() -> None:
    stop = sources()
    stop.missed_press(True)
    assert stop.state(0, 0).reasons == (MISSED_PRESS_OR_SILENCE,)
    stop.consoles.update(True, 0)
    assert stop.state(0, 0).reasons == (CONSOLE_HOLDS_STOP,)
    stop.button(True, 0, 0)
    assert MISSED_PRESS not in stop.state(0, 0).reasons


def test_silent_button_engages() -> None:
    stop = sources()
    assert not stop.state(100 * S, 100 * S).engaged, "no message yet is not silence"
    stop.button(False, 100 * S, 100 * S)
    assert not stop.state(102 * S, 102 * S).engaged
    assert stop.state(103 * S, 103 * S).engaged
    stop.button(False, 104 * S, 104 * S)
    assert not stop.state(104 * S, 104 * S).engaged


@pytest.mark.parametrize(("now_s", "real_s"), [(100, 12), (12, 100), (-50, 12)])
def test_button_silent_on_only_one_clock_is_not_silent(now_s: int, real_s: int) -> None:
    stop = sources()
    stop.button(False, 11 * S, 11 * S)
    assert not stop.state(now_s * S, real_s * S).engaged


STATEMENT = '{"server": "a", "engaged": %s, "driving": false, "presses": 0, "releases": 0}'
# Source → its message that holds the stop, or does not.
MESSAGES: dict[str, Callable[[EstopSources, bool], None]] = {
    BUTTON: lambda stop, holds: stop.button(holds, S, S),
    CONSOLE: lambda stop, holds: stop.console_server(STATEMENT % str(holds).lower(), S),
    WITNESS: lambda stop, holds: stop.missed_press(holds),
}
SOURCES = list(MESSAGES)


def test_unheard_button_engages_and_its_reason_names_the_way_out() -> None:
    state = sources(expected=(BUTTON,)).state(3600 * S, 3600 * S)
    assert state.engaged and not state.stops and not state.warnings
    assert state.unheard == (BUTTON,) and state.reasons == (UNHEARD[BUTTON],)
    assert UNHEARD_BUTTON in state.reasons[0] and f"{ESTOP_BUTTON}=no" in state.reasons[0]


@pytest.mark.parametrize("source", SOURCES)
def test_source_that_is_heard_later_releases(source: str) -> None:
    stop = sources(expected=(source,))
    assert stop.state(0, 0).engaged
    MESSAGES[source](stop, False)
    assert not stop.state(S, S).engaged


@pytest.mark.parametrize("source", SOURCES)
def test_source_that_holds_the_stop_at_its_first_message_engages(source: str) -> None:
    stop = sources(expected=(source,))
    MESSAGES[source](stop, True)
    state = stop.state(S, S)
    assert state.engaged and not state.unheard and UNHEARD[source] not in state.reasons


def test_source_that_was_heard_stays_heard() -> None:
    stop = sources(expected=SOURCES, button_silence_engages=False)
    for source in SOURCES:
        MESSAGES[source](stop, False)
    state = stop.state(3600 * S, 3600 * S)
    assert not state.engaged and "silent" in state.warnings[0]


def test_press_is_named_before_sources_that_are_unheard() -> None:
    stop = sources(expected=(BUTTON, CONSOLE))
    stop.button(True, S, S)
    state = stop.state(S, S)
    assert state.stops == ("the button is pressed",) and state.reasons == (*state.stops, UNHEARD[CONSOLE])


def test_browser_without_a_server_is_not_the_expected_console() -> None:
    stop = sources(expected=(CONSOLE,))
    stop.consoles.update(False, S)
    assert stop.state(S, S).unheard == (CONSOLE,)


def test_unknown_source_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown e-stop source lever, expected some of button, console, witness"):
        sources(expected=("lever", BUTTON))


@given(
    st.sets(st.sampled_from(SOURCES)), st.lists(st.tuples(st.sampled_from(SOURCES), st.booleans()), max_size=8), st.booleans()
)
def test_released_needs_a_message_of_every_expected_source(
    expected: set[str], messages: list[tuple[str, bool]], silence_engages: bool
) -> None:
    stop = sources(expected=expected, button_silence_engages=silence_engages)
    last: dict[str, bool] = {}
    for source, holds in [("", False), *messages]:
        if source:
            MESSAGES[source](stop, holds)
            last[source] = holds
        state = stop.state(S, S)
        assert state.engaged == bool(expected - last.keys() or any(last.values())) == bool(state.reasons)
        assert set(state.unheard) == expected - last.keys()


@pytest.mark.parametrize(
    ("status", "waits", "no_press"),
    [
        ('{"engaged": true, "unheard": ["button"], "presses": 0}', True, True),
        ('{"engaged": true, "unheard": ["button"], "presses": 1}', True, False),
        ('{"engaged": false, "unheard": [], "presses": 0}', False, True),
        ('{"engaged": true, "unheard": [], "presses": 3}', False, False),
        ('{"engaged": true, "presses": false}', False, False),
        ('{"engaged": true}', False, False),
        ("[]", False, False),
        ("1", False, False),
        ("", False, False),
    ],
)
def test_status_tells_a_press_from_an_unheard_source(status: str, waits: bool, no_press: bool) -> None:
    assert (waits_for_sources(status), tells_of_no_press(status)) == (waits, no_press)
