"""The stops of the console's servers: the last statements stay valid, and silence engages only while a browser drives."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety.console_server_stop import (
    BROWSER_HOLDS_STOP,
    EXPIRY_S,
    HOLD_S,
    LOST,
    MAX_SERVERS,
    UNHEARD,
    ConsoleServerStop,
)

S = 1_000_000_000
LATE_NS = int((EXPIRY_S + 0.1) * S)


def say(
    stop: ConsoleServerStop,
    now_ns: int,
    *,
    engaged: bool = False,
    driving: bool = False,
    presses: int = 0,
    releases: int = 0,
    server: str = "a",
) -> bool:
    counts = {"presses": presses, "releases": releases}
    statement = {"server": server, "engaged": engaged, "driving": driving, **counts}
    return stop.update(json.dumps(statement), now_ns)


def test_stop_of_crashed_server_lasts_until_released_on_another() -> None:
    stop = ConsoleServerStop()
    assert say(stop, 0, engaged=True)
    assert stop.reason(100 * S) == BROWSER_HOLDS_STOP
    say(stop, 100 * S, server="b")
    assert stop.reason(101 * S) == BROWSER_HOLDS_STOP, "nobody has released the stop yet"
    say(stop, 102 * S, server="b", releases=1)
    assert stop.reason(102 * S) is None


def test_stop_held_while_the_link_was_cut_engages_for_a_while() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, presses=3)
    assert stop.reason(0) is None, "what was pressed before this process listened is past"
    assert say(stop, 10 * S, presses=4, releases=1)
    assert stop.reason(10 * S) == UNHEARD
    say(stop, 11 * S, presses=4, releases=1)
    assert stop.reason(11 * S) == UNHEARD
    assert stop.reason(10 * S + int(HOLD_S * S) + 1) is None


def test_stop_that_was_heard_counts_once() -> None:
    stop = ConsoleServerStop()
    say(stop, 0)
    assert say(stop, S, engaged=True, presses=1)
    assert not say(stop, 2 * S, presses=1, releases=1)
    assert stop.reason(2 * S) is None


def test_crash_of_an_idle_server_does_not_engage() -> None:
    stop = ConsoleServerStop()
    say(stop, 0)
    assert stop.reason(100 * S) is None


def test_server_lost_while_a_browser_drives_engages_the_stop() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, driving=True)
    assert stop.reason(S) is None
    assert stop.reason(LATE_NS) == LOST
    say(stop, LATE_NS, driving=True)
    assert stop.reason(LATE_NS) == LOST, "driving does not release the stop"
    say(stop, LATE_NS, engaged=True)
    assert stop.reason(LATE_NS) == LOST
    say(stop, LATE_NS, releases=1)
    assert stop.reason(LATE_NS) is None


def test_server_lost_after_driving_does_not_engage() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, driving=True)
    say(stop, S)
    assert stop.reason(100 * S) is None


def test_server_does_not_release_the_stop_of_a_live_one() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, engaged=True)
    say(stop, 1, server="b", releases=3)
    assert stop.reason(1) == BROWSER_HOLDS_STOP
    say(stop, S, server="b", releases=4)
    assert stop.reason(S) == BROWSER_HOLDS_STOP, "server a is alive, and its browsers hold the stop"
    say(stop, 2 * S, releases=1)
    assert stop.reason(2 * S) is None


@pytest.mark.parametrize("engaged", [True, False])
def test_old_releases_of_new_server_do_not_end_a_stop(engaged: bool) -> None:
    stop = ConsoleServerStop()
    say(stop, 0, engaged=engaged, driving=True)
    reason = stop.reason(LATE_NS)
    assert reason is not None
    say(stop, LATE_NS, server="b", releases=1)
    assert stop.reason(LATE_NS) == reason, "it was released before it was heard"
    say(stop, LATE_NS + 1, server="b", releases=2)
    assert stop.reason(LATE_NS + 1) is None


def test_release_during_a_gap_does_not_end_a_newer_stop() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, server="b", releases=1)
    say(stop, 5 * S, engaged=True)
    say(stop, 10 * S, server="b", releases=2)
    assert stop.reason(10 * S) == BROWSER_HOLDS_STOP, "the release may be older than the stop"
    say(stop, 11 * S, server="b", releases=3)
    assert stop.reason(11 * S) is None


def test_old_release_count_does_not_end_a_newer_stop() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, server="b", releases=7)
    say(stop, 1, engaged=True)
    for second in range(1, 10):
        say(stop, second * S, server="b", releases=7)
    assert stop.reason(10 * S) == BROWSER_HOLDS_STOP
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
        '{"server": "a", "engaged": 1, "driving": true, "presses": 0, "releases": 0}',
        '{"server": "a", "engaged": false, "driving": 0, "presses": 0, "releases": 0}',
        '{"server": 3, "engaged": false, "driving": false, "presses": 0, "releases": 0}',
        '{"server": "a", "engaged": false, "driving": false, "presses": 0, "releases": true}',
    ],
)
def test_malformed_statement_engages_until_a_release(text: str) -> None:
    stop = ConsoleServerStop()
    assert stop.update(text, 0)
    assert stop.reason(0) == BROWSER_HOLDS_STOP
    say(stop, 1, releases=1)
    assert stop.reason(LATE_NS) == BROWSER_HOLDS_STOP, "that release may be older"
    say(stop, LATE_NS, releases=2)
    assert stop.reason(LATE_NS) is None


def test_stop_is_lost_while_no_server_repeats_it() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, engaged=True)
    assert not stop.is_lost(S), "its server repeats it"
    assert stop.is_lost(LATE_NS)
    say(stop, LATE_NS)
    assert not stop.is_lost(LATE_NS)
    say(stop, LATE_NS, driving=True)
    assert stop.is_lost(3 * LATE_NS)
    say(stop, 3 * LATE_NS)
    assert stop.is_lost(3 * LATE_NS), "it is back, but has released nothing"
    say(stop, 3 * LATE_NS, releases=1)
    assert not stop.is_lost(3 * LATE_NS)


def test_old_servers_are_forgotten_unless_they_hold_the_stop() -> None:
    stop = ConsoleServerStop()
    say(stop, 0, engaged=True, server="holder")
    for number in range(10 * MAX_SERVERS):
        say(stop, number, server=f"{number}")
    assert len(stop._servers) <= MAX_SERVERS + 1
    assert stop.reason(S) == BROWSER_HOLDS_STOP


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
