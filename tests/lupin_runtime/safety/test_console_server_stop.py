"""The stop of the console's server: its last statement holds, and silence engages it only while a browser drives."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety.console_server_stop import EXPIRY_S, HOLDS, LOST, ConsoleServerStop

S = 1_000_000_000
LATE_NS = int((EXPIRY_S + 0.1) * S)


def say(stop: ConsoleServerStop, engaged: bool | None, driving: bool, now_ns: int) -> bool:
    return stop.update(json.dumps({"engaged": engaged, "driving": driving}), now_ns)


def test_last_statement_holds_when_the_server_crashes() -> None:
    stop = ConsoleServerStop()
    assert say(stop, True, False, 0)
    assert stop.reason(100 * S) == HOLDS
    assert say(stop, None, False, 101 * S), "the next server does not know of the stop yet"
    assert stop.reason(101 * S) == HOLDS
    say(stop, False, False, 102 * S)
    assert stop.reason(200 * S) is None, "and its silence is no reason to stop a mission"


def test_server_that_is_lost_while_a_browser_drives_engages_until_it_is_released() -> None:
    stop = ConsoleServerStop()
    say(stop, None, True, 0)
    assert stop.reason(S) is None
    assert stop.reason(LATE_NS) == LOST
    say(stop, None, True, LATE_NS)
    assert stop.reason(LATE_NS) == LOST, "driving releases nothing"
    say(stop, True, False, LATE_NS)
    assert stop.reason(LATE_NS) == LOST
    say(stop, False, False, LATE_NS)
    assert stop.reason(LATE_NS) is None


def test_driving_that_ended_is_no_reason() -> None:
    stop = ConsoleServerStop()
    say(stop, None, True, 0)
    say(stop, None, False, S)
    assert stop.reason(100 * S) is None


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "3", "{}", '{"engaged": 1.5, "driving": true}', '{"engaged": "x", "driving": 0}']
)
def test_malformed_statement_engages(text: str) -> None:
    stop = ConsoleServerStop()
    assert stop.update(text, 0)
    assert stop.reason(0) == HOLDS


@given(st.lists(st.tuples(st.sampled_from([True, False, None]), st.booleans(), st.integers(0, 3 * S)), max_size=20))
def test_only_a_release_ends_a_stop(statements: list[tuple[bool | None, bool, int]]) -> None:
    stop, now_ns = ConsoleServerStop(), 0
    for engaged, driving, step_ns in statements:
        now_ns += step_ns
        before = stop.reason(now_ns)
        say(stop, engaged, driving, now_ns)
        after = stop.reason(now_ns)
        assert not (before and not after) or engaged is False
        assert engaged is not True or after
