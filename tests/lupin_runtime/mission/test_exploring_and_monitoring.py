"""Explorations and the monitoring rounds after them."""

from __future__ import annotations

import math

import pytest

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.inspecting import REVISIT_FAILED_S
from lupin_runtime.mission.missions import OK, UNREACHABLE
from lupin_runtime.mission.records import MapPose
from tests.support.mission_rig import Rig, known_map


def visits_of(rig: Rig) -> list[tuple[str, int]]:
    """Return tag and status of every visit of the monitoring rounds."""
    return [(record.tag_id, record.status) for record in rig.publisher.records if record.source == "MonitoringMission"]


def test_frontier_goal_faces_driving_direction(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.explore()
    (goal,) = rig.navigation.driving
    assert goal.pose.x > 1.5
    assert goal.pose.yaw == pytest.approx(math.atan2(goal.pose.y, goal.pose.x))
    assert rig.snapshot.mission_type == "ExplorationMission"


def test_reached_discovery_goal_starts_monitoring(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.explore(2)
    rig.discover("1")
    rig.step()
    assert rig.state == "EXPLORING"
    rig.discover("1", "2")
    assert rig.state == "MONITORING.NAVIGATING"
    assert rig.navigation.goals[0].cancel_requests
    assert (rig.snapshot.mission_type, rig.snapshot.targets_total) == ("ExplorationMission", 2)
    assert rig.snapshot.tags_discovered == 2


def test_monitoring_continues_forever_by_default(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.monitor("1", "2")
    for _ in range(20):
        rig.arrive()
    assert rig.state == "MONITORING.NAVIGATING"
    assert visits_of(rig) == [("1", OK), ("2", OK)] * 10


def test_tag_without_a_reading_is_revisited_after_a_pause(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_max_attempts=1)
    rig.monitor("1")
    for visits in range(1, 4):
        rig.end_drive(6)  # no path leads to the only tag, and navigation says so at once
        assert visits_of(rig) == [("1", UNREACHABLE)] * visits
        sent = len(rig.navigation.goals)
        rig.step(REVISIT_FAILED_S - 1.0)
        assert (rig.state, len(rig.navigation.goals)) == ("MONITORING.NAVIGATING", sent)
        rig.step(1.2)
        assert len(rig.navigation.goals) == sent + 1


def test_other_tags_are_visited_while_one_is_unreachable(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_max_attempts=1)
    rig.monitor("1", "2")
    rig.end_drive(6)
    assert rig.snapshot.current_target == "2"
    rig.arrive()
    assert visits_of(rig) == [("1", UNREACHABLE), ("2", OK)]


def test_monitoring_returns_after_its_rounds(make_rig: type[Rig]) -> None:
    rig = make_rig(monitoring_sweeps=2)
    rig.monitor("1", "2")
    for _ in range(4):
        assert rig.state == "MONITORING.NAVIGATING"
        rig.arrive()
    assert rig.state == "RETURNING"
    rig.arrive()
    assert rig.state == "DONE"
    assert rig.snapshot.mission_type == "ExplorationMission"


def test_monitoring_round_starts_at_nearest_tag(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.map_source.pose = Pose2(5.0, 1.0, 0.0)
    rig.explore(3)
    rig.discover("1", "2", "3")
    rig.step()
    assert rig.snapshot.current_target == "3"


def test_tag_discovered_while_monitoring_is_visited(make_rig: type[Rig]) -> None:
    rig = make_rig(monitoring_sweeps=1)
    rig.monitor("1")
    rig.discover("1", "9")
    rig.arrive()
    assert rig.snapshot.current_target == "9"
    rig.arrive()
    assert rig.state == "RETURNING"


@pytest.mark.parametrize(("found", "state"), [(["1"], "MONITORING"), ([], "RETURNING")])
def test_exploration_ends_at_its_timeout(make_rig: type[Rig], found: list[str], state: str) -> None:
    rig = make_rig(exploration_timeout_s=30.0, nav_timeout_s=100.0)
    rig.explore(5)
    rig.discover(*found)
    rig.step(29.0)
    assert rig.state == "EXPLORING"
    rig.step(2.0)
    assert rig.snapshot.lifecycle_state == state
    assert rig.snapshot.last_event == "exploration timed out"


def test_exploration_timeout_excludes_pauses(make_rig: type[Rig]) -> None:
    rig = make_rig(exploration_timeout_s=30.0, nav_timeout_s=1000.0)
    rig.explore(5)
    rig.step(20.0)
    rig.requests.pause()
    rig.step(60.0)
    rig.requests.resume()
    rig.step(9.0)
    assert rig.state == "EXPLORING"
    rig.step(2.0)
    assert rig.state == "RETURNING"


@pytest.mark.parametrize(("found", "state"), [(["1"], "MONITORING"), ([], "RETURNING")])
def test_exploration_ends_when_nothing_is_left(make_rig: type[Rig], found: list[str], state: str) -> None:
    rig = make_rig(exploration_exhausted_s=10.0)
    rig.show_map(known_map())
    rig.explore(65535)
    rig.discover(*found)
    rig.step(9.0)
    assert rig.state == "EXPLORING"
    rig.step(4.0)
    assert rig.snapshot.lifecycle_state == state
    assert rig.snapshot.last_error == ""


def test_goal_all_tags_is_never_reached_by_count(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.explore(65535)
    rig.discover(*map(str, range(40)))
    rig.step()
    assert rig.state == "EXPLORING"
    assert (rig.snapshot.discovery_goal, rig.snapshot.targets_total) == (65535, 40)


def test_missed_discovery_goal_is_reported(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.show_map(known_map())
    rig.explore(5)
    rig.step(15.0)
    assert rig.snapshot.last_error == "exploration_exhausted: 0 of 5 tags"


def test_exploration_waits_for_a_map(make_rig: type[Rig]) -> None:
    rig = make_rig(exploration_timeout_s=100.0)
    rig.show_map()
    rig.explore(5)
    rig.map_source.newest = None
    rig.step(50.0)
    assert rig.state == "EXPLORING"


def test_frontier_goal_is_replaced_after_timeout(make_rig: type[Rig]) -> None:
    rig = make_rig(nav_timeout_s=10.0)
    rig.explore()
    rig.step(10.5)
    assert rig.navigation.goals[0].cancel_requests
    rig.step(2.0)
    assert len(rig.navigation.goals) == 2


def test_rejected_frontiers_are_retried_slowly_then_given_up(make_rig: type[Rig]) -> None:
    rig = make_rig(exploration_timeout_s=1000.0)
    rig.navigation.answers_goals = False
    rig.explore()
    started = rig.clock.s
    while rig.state == "EXPLORING":
        for goal in rig.navigation.driving:
            rig.navigation.reject(goal)
        rig.step()
        assert len(rig.navigation.goals) <= rig.clock.s - started + 2
    assert rig.clock.s - started < 60.0
    assert rig.state == "RETURNING"


def test_explored_frontier_goal_is_cancelled(make_rig: type[Rig]) -> None:
    rig = make_rig(exploration_exhausted_s=5.0)
    rig.explore()
    rig.show_map(known_map())
    rig.step(1.5)
    assert rig.navigation.goals[0].cancel_requests
    assert not rig.navigation.driving


def test_discovered_tags_are_read_once_while_exploring(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.explore(5)
    rig.discover("1")
    rig.discover("1")
    rig.discover("1", "2")
    assert rig.climate_bridge.requested == ["1", "2"]
    assert [(r.tag_id, r.status, r.source, r.detail) for r in rig.publisher.records] == [
        ("1", OK, "ExplorationMission", ""),
        ("2", OK, "ExplorationMission", ""),
    ]
    assert rig.last.pose is not None and (rig.last.pose.x, rig.last.pose.y) == (3.0, 1.0)
    assert rig.state == "EXPLORING"


def test_first_readings_can_be_disabled_and_fail_silently(make_rig: type[Rig]) -> None:
    rig = make_rig(seed_climate_on_discovery=False)
    rig.explore(5)
    rig.discover("1")
    assert rig.climate_bridge.requested == []
    rig = make_rig()
    rig.climate_bridge.replies = False
    rig.climate_bridge.status = 1
    rig.explore(5)
    rig.discover("1")
    rig.step(30.0)
    rig.climate_bridge.reply()
    assert rig.publisher.records == []


def test_empty_list_of_restarted_perception_loses_no_tag(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.explore(5)
    rig.discover("1", "2")
    rig.discover()
    assert rig.snapshot.tags_discovered == 2


def test_tags_without_finite_pose_or_id_are_ignored(make_rig: type[Rig]) -> None:
    rig = make_rig()
    rig.explore(1)
    rig.orchestrator.on_tags({"1": MapPose(math.nan, 0.0), "": MapPose(1.0, 0.0)})
    rig.step()
    assert rig.state == "EXPLORING"
