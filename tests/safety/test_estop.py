from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety import ConsoleLane, EstopSources

S = 10**9


def sources(**options) -> EstopSources:
    return EstopSources(ConsoleLane(), **options)


@given(st.booleans(), st.booleans(), st.booleans())
def test_the_stop_is_the_or_of_button_and_console(engaged_value, button, console):
    stop = sources(engaged_value=engaged_value)
    stop.button(button, S)
    stop.consoles.heard(console, S)
    state = stop.state(S, S)
    assert state.engaged == ((button == engaged_value) or console) == bool(state.reasons)


def test_with_no_source_heard_it_is_released_and_warns():
    state = sources().state(0, 0)
    assert not state.engaged and state.warnings == ("the button has not been heard",)


@pytest.mark.parametrize("pressed", [False, True])
def test_a_button_that_falls_silent_keeps_its_last_value_and_warns(pressed):
    stop = sources()
    stop.button(pressed, S)
    state = stop.state(4 * S, 0)
    assert state.engaged == pressed and "silent" in state.warnings[0]


def test_a_button_that_falls_silent_engages_where_told_to():
    stop = sources(button_silence_engages=True)
    assert not stop.state(100 * S, 0).engaged, "a button never heard is not one that fell silent"
    stop.button(False, 100 * S)
    assert not stop.state(102 * S, 0).engaged
    assert stop.state(103 * S, 0).engaged
    stop.button(False, 104 * S)
    assert not stop.state(104 * S, 0).engaged
