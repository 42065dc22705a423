"""Battery and e-stop monitors report every edge once."""

from __future__ import annotations

import itertools
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety import BatteryEdge, BatteryMonitor, EStopEdge, EStopMonitor, normalize
from lupin_runtime.safety.estop_monitor import QUIET_S, RELEASE_COUNT


@given(st.one_of(st.floats(), st.integers(-10, 200)))
def test_normalized_battery_is_a_fraction_or_none(value: float) -> None:
    out = normalize(value)
    if not math.isfinite(value) or value < 0:
        assert out is None
    else:
        assert out is not None and 0.0 <= out <= 1.0


@given(st.floats(2, 100))
def test_battery_percent_and_fraction_are_equivalent(percent: float) -> None:
    assert normalize(percent) == pytest.approx(normalize(percent / 100.0))


@pytest.mark.parametrize("junk", [None, "80", True, math.nan, math.inf, -math.inf, -1, -0.01, [0.5]])
def test_invalid_battery_percentage_keeps_the_last_value(junk: Any) -> None:
    monitor = BatteryMonitor()
    monitor.update(0.5)
    assert monitor.update(junk) is None
    assert (monitor.percentage, monitor.low) == (0.5, False)


@given(st.lists(st.one_of(st.floats(0, 1), st.floats(2, 150), st.just(math.nan)), max_size=40))
def test_battery_edges_alternate_and_match_the_state(values: list[float]) -> None:
    monitor, edges = BatteryMonitor(), []
    for value in values:
        edge = monitor.update(value)
        if edge:
            edges.append(edge)
            assert (edge is BatteryEdge.LOW) == monitor.low == (monitor.percentage < 0.20)
    assert all(a is not b for a, b in itertools.pairwise(edges))
    assert not edges or edges[0] is BatteryEdge.LOW


def test_battery_at_the_threshold_is_not_low() -> None:
    monitor = BatteryMonitor()
    assert monitor.update(0.20) is None
    assert monitor.update(0.19999) is BatteryEdge.LOW
    assert monitor.update(20.0) is BatteryEdge.RECOVERED


def test_battery_threshold_in_percent_is_refused() -> None:
    with pytest.raises(ValueError, match="fraction"):
        BatteryMonitor(20.0)


MS = 1_000_000
MESSAGES = st.lists(st.tuples(st.sampled_from([0, 10, 100, 200, 200, 300, 600]), st.booleans()), max_size=60)


@given(MESSAGES)
def test_estop_is_released_only_by_repeated_falses_in_quiet(messages: list[tuple[int, bool]]) -> None:
    monitor, now_ns, history, edges = EStopMonitor(), 0, [], []
    for step_ms, engaged in messages:
        now_ns += step_ms * MS
        history.append((now_ns, engaged))
        edges.append(monitor.update(engaged, now_ns))
        trues = [index for index, (_, value) in enumerate(history) if value]
        if not trues:
            assert not monitor.engaged
            continue
        falses = [time_ns for time_ns, _ in history[trues[-1] + 1 :]]
        evidence = [time_ns for time_ns in falses[RELEASE_COUNT - 1 :] if time_ns >= history[trues[-1]][0] + QUIET_S * 1e9]
        assert monitor.engaged == (not evidence)
    found = [edge for edge in edges if edge]
    assert all(a is not b for a, b in itertools.pairwise(found))
    assert not found or found[0] is EStopEdge.ENGAGED


@given(st.lists(st.sampled_from([1, 2, 3, 5]), min_size=1, max_size=100))
def test_falses_between_the_trues_of_the_bridge_release_nothing(forged: list[int]) -> None:
    monitor = EStopMonitor()
    for period, falses in enumerate(forged):
        monitor.update(True, period * 200 * MS)
        for number in range(falses):
            assert monitor.update(False, (period * 200 + 10 + number) * MS) is None
        assert monitor.engaged


@pytest.mark.parametrize("publishers", [0, 2, 3])
def test_estop_with_other_than_one_publisher_stays_engaged(publishers: int) -> None:
    count = [publishers]
    monitor = EStopMonitor(lambda: count[0])
    monitor.update(True, 0)
    for period in range(1, 50):
        assert monitor.update(False, period * 200 * MS) is None
    count[0] = 1
    assert monitor.update(False, 10_000 * MS) is EStopEdge.RELEASED


def test_clock_that_was_set_back_restarts_the_quiet_time() -> None:
    monitor = EStopMonitor()
    monitor.update(True, 100_000 * MS)
    released_ms = [at for at in range(5_000, 6_000, 100) if monitor.update(False, at * MS) is EStopEdge.RELEASED]
    assert released_ms == [5_500]
