"""Progress of the three missions, and labels of events."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.mission.events import ERROR, INFO, WARN, label_event
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
    nearest_neighbor_order,
    tag_order,
)


@given(st.lists(st.sampled_from([OK, UNREACHABLE, SCAN_FAILED, SKIPPED]), max_size=12), st.integers(1, 8))
def test_inspection_visits_list_once_and_counters_add_up(statuses: list[int], length: int) -> None:
    mission = InspectionMission([str(i) for i in range(length)])
    for index, status in enumerate(statuses):
        assert mission.current == (str(index) if index < length else None)
        mission.record(status)
    done = mission.counters
    assert mission.is_complete == (len(statuses) >= length)
    assert done.total == length
    assert done.completed + done.failed + done.unreachable + done.skipped == min(length, len(statuses))


def test_record_remaining_returns_remaining_tags() -> None:
    mission = InspectionMission(["1", "2", "3"])
    mission.record(OK)
    assert mission.record_remaining(SKIPPED) == ["2", "3"]
    assert mission.is_complete
    assert mission.counters == Counters(3, 1, 0, 0, 2)
    assert mission.record_remaining(SKIPPED) == []


def test_exploration_goal_is_at_least_one_tag() -> None:
    mission = ExplorationMission(0)
    assert mission.goal == 1
    assert not mission.is_complete
    mission.discovered = 1
    assert mission.is_complete
    assert mission.counters == Counters(total=1, completed=1)


def test_goal_all_tags_is_never_complete() -> None:
    mission = ExplorationMission(ALL_TAGS)
    mission.discovered = 500
    assert mission.seeks_all_tags
    assert not mission.is_complete


def test_tag_ids_sort_numerically_then_alphabetically() -> None:
    assert sorted(["b", "10", "9", "a", "²"], key=tag_order) == ["9", "10", "a", "b", "²"]


def test_nearest_neighbor_breaks_ties_by_id() -> None:
    positions = {"10": (1.0, 0.0), "9": (-1.0, 0.0), "2": (5.0, 0.0)}
    assert nearest_neighbor_order(positions, positions, (0.0, 0.0)) == ["9", "10", "2"]


def test_order_without_start_or_positions_is_by_id() -> None:
    positions = {"10": (1.0, 0.0), "9": (9.0, 0.0)}
    assert nearest_neighbor_order(positions, positions, None) == ["9", "10"]
    assert nearest_neighbor_order(["3", "1"], {}, (0.0, 0.0)) == ["1", "3"]


@given(st.dictionaries(st.integers(0, 40).map(str), st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=1, max_size=12))
def test_each_step_goes_to_nearest_remaining_tag(positions: dict[str, tuple[float, float]]) -> None:
    order = nearest_neighbor_order(positions, positions, (0.0, 0.0))
    assert sorted(order) == sorted(positions)
    current = (0.0, 0.0)
    for index, tag in enumerate(order):
        square = [(positions[t][0] - current[0]) ** 2 + (positions[t][1] - current[1]) ** 2 for t in order[index:]]
        assert square[0] == min(square)
        current = positions[tag]


def test_monitoring_completes_only_with_a_number_of_rounds() -> None:
    endless = MonitoringMission({"1": (0.0, 0.0)}, None)
    for _ in range(1000):
        endless.record(OK)
    assert not endless.is_complete
    assert endless.completed_rounds == 1000
    bounded = MonitoringMission({"1": (0.0, 0.0), "2": (1.0, 0.0)}, None, rounds=2)
    for _ in range(4):
        assert not bounded.is_complete
        bounded.record(OK)
    assert bounded.is_complete


def test_monitoring_counts_over_all_rounds() -> None:
    mission = MonitoringMission({"1": (0.0, 0.0), "2": (1.0, 0.0)}, (0.0, 0.0))
    for status in (OK, UNREACHABLE, SCAN_FAILED, OK):
        mission.record(status)
    assert mission.counters == Counters(2, 2, 1, 1, 0)


def test_tag_added_during_round_is_visited() -> None:
    mission = MonitoringMission({"1": (0.0, 0.0)}, (0.0, 0.0), rounds=1)
    mission.add("7")
    mission.add("7")
    mission.record(OK)
    assert mission.current == "7"
    assert not mission.is_complete
    mission.record(OK)
    assert mission.is_complete


def test_monitoring_without_tags_is_complete() -> None:
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
def test_events_are_labeled_by_prefix(code: str, severity: int, label: str) -> None:
    event = label_event(code)
    assert (event.code, event.severity, event.label) == (code or "", severity, label)
