"""The stops of several clients: any engages, silence engages, and what a lost client held remains."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.console.stop_registry import DRIVING_S, EXPIRY_S, StopRegistry

SECOND = 1_000_000_000


def registry(*names: str) -> StopRegistry:
    stops = StopRegistry()
    for name in names:
        stops.join(name, name)
    return stops


def test_stops_of_all_clients_are_combined() -> None:
    stops = registry("anne", "ben", "script")
    stops.state("anne", False, 0)
    stops.state("ben", True, 0)
    assert stops.reasons(0) == ["ben holds the stop"]
    stops.state("ben", False, 1)
    assert stops.reasons(1) == []


def test_console_that_falls_silent_is_engaged_and_a_script_is_not() -> None:
    stops = registry("anne", "script")
    stops.state("anne", False, 0)
    later_ns = int((EXPIRY_S + 0.1) * SECOND)
    assert stops.reasons(later_ns) == ["anne is silent for more than 1.5 s"]
    assert stops.is_engaged("anne", later_ns)


def test_client_lost_while_driving_or_holding_or_in_control_leaves_the_stop() -> None:
    stops = registry("driver", "stopper", "holder", "idle", "visitor")
    stops.velocity("driver", True, 0)
    stops.velocity("idle", True, 0)
    stops.state("stopper", True, 0)
    now_ns = int(DRIVING_S * SECOND)
    assert stops.leave("driver", now_ns, False)
    assert not stops.leave("stopper", now_ns, False)
    assert not stops.leave("holder", now_ns, True)
    assert not stops.leave("idle", now_ns + 1, False)
    assert len(stops.reasons(now_ns)) == 3
    assert stops.is_engaged("visitor", now_ns)
    stops.release_lost()
    assert stops.reasons(now_ns) == []


@given(st.lists(st.tuples(st.sampled_from("abc"), st.booleans(), st.integers(0, SECOND)), max_size=20))
def test_stop_is_engaged_while_any_client_states_it(statements: list[tuple[str, bool, int]]) -> None:
    stops = registry("a", "b", "c")
    now_ns, last = 0, {}
    for name, engaged, step_ns in statements:
        now_ns += step_ns
        stops.state(name, engaged, now_ns)
        last[name] = (engaged, now_ns)
        expected = any(held or now_ns - then > EXPIRY_S * SECOND for held, then in last.values())
        assert bool(stops.reasons(now_ns)) == expected
