from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.safety import BatteryEdge, BatteryMonitor, EStopEdge, EStopMonitor, normalise


@given(st.one_of(st.floats(), st.integers(-10, 200)))
def test_a_normalised_battery_is_a_fraction_or_nothing(value):
    out = normalise(value)
    if not math.isfinite(value) or value < 0:
        assert out is None
    else:
        assert out is not None and 0.0 <= out <= 1.0


@given(st.floats(2, 100))
def test_percent_and_fraction_mean_the_same(percent):
    assert normalise(percent) == pytest.approx(normalise(percent / 100.0))


@pytest.mark.parametrize("junk", [None, "80", True, math.nan, math.inf, -math.inf, -1, -0.01, [0.5]])
def test_what_is_no_percentage_is_ignored_and_the_last_one_kept(junk):
    monitor = BatteryMonitor()
    monitor.update(0.5)
    assert monitor.update(junk) is None
    assert (monitor.percentage, monitor.low) == (0.5, False)


@given(st.lists(st.one_of(st.floats(0, 1), st.floats(2, 150), st.just(math.nan)), max_size=40))
def test_battery_edges_alternate_and_agree_with_the_state(values):
    monitor, edges = BatteryMonitor(), []
    for value in values:
        edge = monitor.update(value)
        if edge:
            edges.append(edge)
            assert (edge is BatteryEdge.LOW) == monitor.low == (monitor.percentage < 0.20)
    assert all(a is not b for a, b in itertools.pairwise(edges))
    assert not edges or edges[0] is BatteryEdge.LOW


def test_the_threshold_itself_is_not_low():
    monitor = BatteryMonitor()
    assert monitor.update(0.20) is None
    assert monitor.update(0.19999) is BatteryEdge.LOW
    assert monitor.update(20.0) is BatteryEdge.RECOVERED


def test_a_threshold_in_percent_is_refused():
    with pytest.raises(ValueError, match="fraction"):
        BatteryMonitor(20.0)


@given(st.lists(st.booleans(), max_size=40))
def test_the_stop_monitor_reports_each_edge_once(values):
    monitor = EStopMonitor()
    edges = [edge for edge in map(monitor.update, values) if edge]
    changes = sum(a != b for a, b in zip([False, *values], values))
    assert len(edges) == changes
    assert all(e is (EStopEdge.RELEASED if i % 2 else EStopEdge.ENGAGED) for i, e in enumerate(edges))
    assert monitor.engaged == ([False, *values][-1])
