"""The stops of the console's servers: the last statements hold, and silence engages only while a browser drives."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety.console_server_stop import EXPIRY_S, HOLDS, LOST, MAX_SERVERS, ConsoleServerStop

S = 1_000_000_000
LATE_NS = int((EXPIRY_S + 0.1) * S)


def say(
    stop: ConsoleServerStop, now_ns: int, *, engaged: bool = False, driving: bool = False, releases: int = 0, server: str = "a"
) -> bool:
    statement = {"server": server, "engaged": engaged, "driving": driving, "releases": releases}
    return stop.update(json.dumps(statement), now_ns)


def test_stop_of_a_server_that_crashed_holds_until_somebody_releases_it_on_the_next() -> None:
    stop = ConsoleServerStop()
    assert say(stop, 0, engaged=True)
    assert stop.reason(100 * S) == HOLDS
    say(stop, 100 * S, server="b")
    assert stop.reason(101 * S) == HOLDS, "the next server was told nothing yet"
    say(stop, 102 * S, server="b", releases=1)
    assert stop.reason(102 * S) is None


def test_server_that_crashes_stops_no_mission() -> None:
    stop = ConsoleServerStop()
    say(stop, 0)
    assert stop.reason(100 * S) is None


def test_server_that_is_lost_while_a_browser_drives_engages_until_a_release() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, driving=True)
    assert stop.reason(S) is None
    assert stop.reason(LATE_NS) == LOST
    say(stop, LATE_NS, driving=True)
    assert stop.reason(LATE_NS) == LOST, "driving releases nothing"
    say(stop, LATE_NS, engaged=True)
    assert stop.reason(LATE_NS) == LOST
    say(stop, LATE_NS, releases=1)
    assert stop.reason(LATE_NS) is None


def test_driving_that_ended_is_no_reason() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, driving=True)
    say(stop, S)
    assert stop.reason(100 * S) is None


def test_one_server_does_not_release_what_another_holds() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, engaged=True)
    say(stop, 1, server="b", releases=3)
    assert stop.reason(1) == HOLDS
    say(stop, S, server="b", releases=4)
    assert stop.reason(S) == HOLDS, "it is alive, and its browsers hold the stop"
    say(stop, 2 * S, releases=1)
    assert stop.reason(2 * S) is None


def test_release_of_before_is_none_of_what_was_left_since() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, server="b", releases=7)
    say(stop, 1, engaged=True)
    for second in range(1, 10):
        say(stop, second * S, server="b", releases=7)
    assert stop.reason(10 * S) == HOLDS
    say(stop, 10 * S, server="b", releases=8)
    assert stop.reason(10 * S) is None


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "3",
        "{}",
        '{"server": "a", "engaged": 1, "driving": true, "releases": 0}',
        '{"server": "a", "engaged": false, "driving": 0, "releases": 0}',
        '{"server": 3, "engaged": false, "driving": false, "releases": 0}',
        '{"server": "a", "engaged": false, "driving": false, "releases": true}',
    ],
)
def test_malformed_statement_engages_until_a_release(text: str) -> None:
    stop = ConsoleServerStop()
    assert stop.update(text, 0)
    assert stop.reason(0) == HOLDS
    say(stop, LATE_NS, releases=1)
    assert stop.reason(LATE_NS) is None


def test_servers_that_come_and_go_are_forgotten_and_their_stops_are_not() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, engaged=True, server="holder")
    for number in range(10 * MAX_SERVERS):
        say(stop, number, server=f"{number}")
    assert len(stop._servers) <= MAX_SERVERS + 1
    assert stop.reason(S) == HOLDS


@given(
    st.lists(st.tuples(st.sampled_from("ab"), st.booleans(), st.booleans(), st.booleans(), st.integers(0, 3 * S)), max_size=20)
)
def test_only_a_release_or_its_own_server_ends_a_stop(steps: list[tuple[str, bool, bool, bool, int]]) -> None:
    stop, now_ns, releases = ConsoleServerStop(), 0, dict.fromkeys("ab", 0)
    held = dict.fromkeys("ab", False)
    for server, engaged, driving, release, step_ns in steps:
        now_ns += step_ns
        before = stop.reason(now_ns)
        releases[server] += release
        say(stop, now_ns, engaged=engaged, driving=driving, releases=releases[server], server=server)
        after = stop.reason(now_ns)
        assert not (before and not after) or release or held[server]
        assert after or not engaged
        held[server] = engaged
