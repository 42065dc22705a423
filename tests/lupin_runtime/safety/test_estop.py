"""The e-stop combines button and console, and reports sources that are silent."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety import ConsoleStop, EstopSources
from lupin_runtime.safety.console_stop import CONSOLE_HOLDS_STOP
from lupin_runtime.safety.estop import MISSED_PRESS, MISSED_PRESS_OR_SILENCE

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


def test_estop_without_sources_is_released_with_a_warning() -> None:
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
    stop.missed_press = True
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
