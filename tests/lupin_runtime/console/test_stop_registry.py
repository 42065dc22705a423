"""The combined stop of several clients: any client engages it, and so does the loss or silence of one that drives."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.console.stop_registry import DRIVING_S, SILENCE_TIMEOUT_S, StopRegistry

SECOND = 1_000_000_000


def registry(*names: str) -> StopRegistry:
    stops = StopRegistry()
    for name in names:
        stops.join(name, name)
    return stops


def test_stops_of_all_clients_are_combined() -> None:
    stops = registry("anne", "ben", "script")
    stops.set_stop("anne", False, 0)
    stops.set_stop("ben", True, 0)
    assert stops.reasons() == ["ben holds the stop"]
    stops.set_stop("ben", False, 1)
    assert stops.reasons() == []


def test_only_silence_of_client_in_control_engages_the_stop() -> None:
    stops = registry("anne", "ben", "script")
    for name in ("anne", "anne", "ben", "ben", "script"):
        stops.set_stop(name, False, 0)
    late_ns = int((SILENCE_TIMEOUT_S + 0.1) * SECOND)
    stops.check_silence(late_ns, "script")
    assert stops.reasons() == [], "a script does not repeat the state of its stop"
    stops.check_silence(late_ns, "anne")
    assert stops.reasons() == ["anne was silent for more than 1.5 s"]
    stops.set_stop("anne", False, late_ns)
    stops.check_silence(late_ns, None)
    assert stops.reasons() == ["anne was silent for more than 1.5 s"], "it is released only on request"


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
    assert len(stops.reasons()) == 3
    stops.release_lost()
    assert stops.reasons() == []


def test_stop_withdrawn_without_control_stays_engaged() -> None:
    stops = registry("viewer", "driver")
    stops.set_stop("viewer", True, 0)
    stops.release_lost()
    assert stops.reasons() == ["viewer holds the stop"], "still pressed"
    stops.withdraw("viewer", 1)
    assert stops.reasons() == ["viewer stopped the robot"] and not stops.holds("viewer")
    stops.release_lost()
    assert stops.reasons() == []


def test_stop_without_connection_stays_until_released() -> None:
    stops = registry()
    stops.hold_for("phone-1")
    assert stops.reasons() == ["phone-1 stopped the robot"]
    stops.release_lost()
    assert stops.reasons() == []


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
        assert bool(stops.reasons()) == any(last.values())
