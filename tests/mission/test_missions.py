"""Bookkeeping of the three missions, and what events mean."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.mission.events import ERROR, INFO, WARN, classify
from lupin_runtime.mission.missions import (
    ALL_TAGS,
    OK,
    SCAN_FAILED,
    SKIPPED,
    UNREACHABLE,
    Counters,
    ExplorationMission,
    InspectionMission,
    MonitoringMission,
    nearest_neighbour_order,
    tag_order,
)


@given(st.lists(st.sampled_from([OK, UNREACHABLE, SCAN_FAILED, SKIPPED]), max_size=12), st.integers(1, 8))
def test_an_inspection_walks_its_list_once_and_its_counters_add_up(statuses, length):
    mission = InspectionMission([str(i) for i in range(length)])
    for index, status in enumerate(statuses):
        assert mission.current == (str(index) if index < length else None)
        mission.close(status)
    done = mission.counters
    assert mission.is_complete == (len(statuses) >= length)
    assert done.total == length
    assert done.completed + done.failed + done.unreachable + done.skipped == min(length, len(statuses))


def test_closing_the_rest_of_an_inspection_names_the_tags_that_were_left():
    mission = InspectionMission(["1", "2", "3"])
    mission.close(OK)
    assert mission.close_remaining(SKIPPED) == ["2", "3"]
    assert mission.is_complete
    assert mission.counters == Counters(3, 1, 0, 0, 2)
    assert mission.close_remaining(SKIPPED) == []


def test_an_exploration_s_goal_is_at_least_one_tag():
    mission = ExplorationMission(0)
    assert mission.goal == 1
    assert not mission.is_complete
    mission.discovered = 1
    assert mission.is_complete
    assert mission.counters == Counters(total=1, completed=1)


def test_no_count_completes_the_goal_all():
    mission = ExplorationMission(ALL_TAGS)
    mission.discovered = 500
    assert mission.wants_all
    assert not mission.is_complete


def test_ids_sort_numerically_then_alphabetically():
    assert sorted(["b", "10", "9", "a", "²"], key=tag_order) == ["9", "10", "a", "b", "²"]


def test_nearest_neighbour_breaks_ties_by_numeric_id():
    positions = {"10": (1.0, 0.0), "9": (-1.0, 0.0), "2": (5.0, 0.0)}
    assert nearest_neighbour_order(positions, positions, (0.0, 0.0)) == ["9", "10", "2"]


def test_without_a_start_or_positions_the_order_is_that_of_the_ids():
    positions = {"10": (1.0, 0.0), "9": (9.0, 0.0)}
    assert nearest_neighbour_order(positions, positions, None) == ["9", "10"]
    assert nearest_neighbour_order(["3", "1"], {}, (0.0, 0.0)) == ["1", "3"]


@given(st.dictionaries(st.integers(0, 40).map(str), st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=12))
def test_each_step_of_a_sweep_goes_to_the_nearest_tag_left(positions):
    order = nearest_neighbour_order(positions, positions, (0.0, 0.0))
    assert sorted(order) == sorted(positions)
    here = (0.0, 0.0)
    for index, tag in enumerate(order):
        square = [(positions[t][0] - here[0]) ** 2 + (positions[t][1] - here[1]) ** 2 for t in order[index:]]
        assert square[0] == min(square)
        here = positions[tag]


def test_monitoring_never_completes_unless_told_a_number_of_sweeps():
    endless = MonitoringMission({"1": (0.0, 0.0)}, None)
    for _ in range(1000):
        endless.close(OK)
    assert not endless.is_complete
    assert endless.cycles == 1000
    told = MonitoringMission({"1": (0.0, 0.0), "2": (1.0, 0.0)}, None, sweeps=2)
    for _ in range(4):
        assert not told.is_complete
        told.close(OK)
    assert told.is_complete


def test_monitoring_keeps_tallies_over_its_sweeps_and_skips_nothing():
    mission = MonitoringMission({"1": (0.0, 0.0), "2": (1.0, 0.0)}, (0.0, 0.0))
    for status in (OK, UNREACHABLE, SCAN_FAILED, OK):
        mission.close(status)
    assert mission.counters == Counters(2, 2, 1, 1, 0)


def test_a_tag_found_during_a_sweep_joins_it():
    mission = MonitoringMission({"1": (0.0, 0.0)}, (0.0, 0.0), sweeps=1)
    mission.add("7")
    mission.add("7")
    mission.close(OK)
    assert mission.current == "7"
    assert not mission.is_complete
    mission.close(OK)
    assert mission.is_complete


def test_monitoring_nothing_is_complete():
    assert MonitoringMission({}, None).is_complete


@pytest.mark.parametrize(
    ("code", "severity", "label"),
    [
        ("", INFO, ""),
        (None, INFO, ""),
        ("battery_low", WARN, "battery low"),
        ("dock_unreachable", WARN, "dock unreachable — paused"),
        ("exploration_timeout", WARN, "exploration timed out"),
        ("estop_engaged", WARN, "e-stop engaged"),
        ("aborted_in_prepare", WARN, "aborted during prepare"),
        ("scan_failed: bridge_status_1", WARN, "scan failed"),
        ("scan_failed timeout", WARN, "scan failed"),
        ("nav_status_6", WARN, "navigation retry"),
        ("localization_failed", ERROR, "localization failed"),
        ("dependency_timeout", ERROR, "dependencies not ready"),
        ("something else", WARN, "something else"),
    ],
)
def test_events_are_classified_by_their_prefix(code, severity, label):
    event = classify(code)
    assert (event.code, event.severity, event.label) == (code or "", severity, label)
