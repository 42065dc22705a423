"""The orchestrator's node on a ROS graph, with fake servers whose answers come late or never."""

from __future__ import annotations

import math
import time
from array import array
from pathlib import Path
from typing import Any

import pytest

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, quaternion_from_yaw
from lupin_runtime.transforms import Transform
from tests.support.lost_answers import lose_goal_answers

pytestmark = pytest.mark.graph


class FakeGraph:
    """Everything around the mission: navigation that jumps to its goal, the bridge, transforms, the map."""

    def __init__(self, host: Any, **parameters: Any) -> None:
        from std_msgs.msg import Bool

        from lupin_runtime.mission.node import MissionOrchestrator
        from lupin_runtime.mission.pose_seed import PoseSeed
        from lupin_runtime.ros import LupinNode, TransformBroadcaster

        self.host = host
        self.pose = Pose2()
        self.drive_s = 0.05
        self.accept_delay_s = 0.0
        self.cancel_delay_s = 0.0
        self.hold = False
        self.abort_reason = ""
        self.results: list[str] = []
        self.goals: list[Pose2] = []
        self.active = 0
        self.max_active = 0
        self.presets: list[str] = []
        self.states: list[Any] = []
        self.observations: list[Any] = []
        node = self.node = LupinNode("greenhouse")
        node.service(graph.GET_TAG_READING, self._read)
        node.service(graph.ARM_PRESET, self._preset)
        self.broadcaster = TransformBroadcaster(node)
        self.transforms = True
        self.maps = node.publisher(graph.MAP)
        self.tags = node.publisher(graph.DISCOVERED_TAGS)
        self.estop_topic = node.publisher(graph.ESTOP_STATE)
        self.battery_topic = node.publisher(graph.BATTERY)
        self.estop = False
        node.subscription(graph.MISSION_STATE, self.states.append)
        node.subscription(graph.OBSERVATIONS, self.observations.append)
        self.clients = {row.name: node.client(row) for row in graph.services() if row.name.startswith("/mission/")}
        node.create_timer(0.02, self._beat)
        node.create_timer(0.1, lambda: self.estop_topic.publish(Bool(data=self.estop)))
        host.add(node)
        self.start_navigation()
        host.add(PoseSeed({"rate_hz": 20.0}))
        self.orchestrator = host.add(MissionOrchestrator({"nav_timeout_s": 10.0, "dock_pose": [0, 0, 0], **parameters}))
        self.until(lambda s: s.lifecycle_state == "READY", "READY")
        for publisher in (self.maps, self.tags, self.estop_topic, self.battery_topic):
            host.until(lambda p=publisher: p.get_subscription_count(), what="the mission's subscriptions")

    # -- navigation

    def start_navigation(self) -> None:
        from rclpy.action import ActionServer, CancelResponse

        from lupin_runtime.ros import LupinNode
        from lupin_runtime.ros.interfaces import interface

        self.navigation = LupinNode("navigation")
        self.server = ActionServer(
            self.navigation,
            interface(graph.NAVIGATE_TO_POSE.type),
            graph.NAVIGATE_TO_POSE.name,
            execute_callback=self._execute,
            goal_callback=self._on_goal,
            cancel_callback=lambda _handle: CancelResponse.ACCEPT,
        )
        self.host.add(self.navigation)

    def hang_navigation(self) -> None:
        """Stop answering but stay discovered, as a killed process does for the 20 s of its DDS lease."""
        self.host.suspend(self.navigation)
        self.active = 0

    def _on_goal(self, _goal: Any) -> Any:
        from rclpy.action import GoalResponse

        time.sleep(self.accept_delay_s)
        return GoalResponse.ACCEPT

    async def _execute(self, handle: Any) -> Any:
        from rclpy.task import Future

        from lupin_runtime.ros.interfaces import interface

        target = handle.request.pose.pose
        pose = Pose2(target.position.x, target.position.y, 2.0 * math.atan2(target.orientation.z, target.orientation.w))
        self.goals.append(pose)
        self.active += 1
        self.max_active = max(self.max_active, self.active)
        end = Future()
        started = cancelled = None

        def poll() -> None:
            nonlocal started, cancelled
            now = time.monotonic()
            started = started or now
            handle.publish_feedback(interface(graph.NAVIGATE_TO_POSE.type).Feedback())
            if handle.is_cancel_requested:
                cancelled = cancelled or now
                if now - cancelled >= self.cancel_delay_s:
                    end.set_result("canceled")
            elif self.abort_reason:
                end.set_result("aborted")
            elif not self.hold and now - started >= self.drive_s:
                end.set_result("succeeded")

        timer = self.navigation.create_timer(0.01, lambda: None if end.done() else poll())
        result = await end
        self.navigation.destroy_timer(timer)
        self.active -= 1
        self.results.append(result)
        answer = interface(graph.NAVIGATE_TO_POSE.type).Result()
        if result == "canceled":
            handle.canceled()
        elif result == "aborted":
            answer.error_msg = self.abort_reason
            handle.abort()
        else:
            self.pose = pose
            handle.succeed()
        return answer

    # -- the bridge, transforms and topics

    def _read(self, request: Any, response: Any) -> Any:
        from lupin_msgs.msg import SensorReading

        response.reading.tag_id = request.tag_id
        response.reading.sim_time_of_day_seconds = 43200.0
        response.reading.readings = [SensorReading(name="co2", value=400.0 + int(request.tag_id))]
        return response

    def _preset(self, request: Any, response: Any) -> Any:
        self.presets.append(request.name)
        response.success = True
        return response

    def _beat(self) -> None:
        from lupin_runtime.ros.tf import to_message

        if self.transforms:
            t = Transform((self.pose.x, self.pose.y, 0.0), quaternion_from_yaw(self.pose.yaw))
            self.broadcaster.send(to_message("map", "base_link", self.node.now_ns(), t))

    def show_map(self, known_to_x: float) -> None:
        from nav_msgs.msg import OccupancyGrid

        message = OccupancyGrid()
        message.header.frame_id = "map"
        message.info.resolution = 0.05
        message.info.width = message.info.height = 160
        message.info.origin.position.x = message.info.origin.position.y = -4.0
        known = round((known_to_x + 4.0) / 0.05)
        message.data = array("b", ([0] * known + [-1] * (160 - known)) * 160)
        self.maps.publish(message)

    def show_tags(self, *tags: str) -> None:
        from lupin_msgs.msg import DiscoveredTag, DiscoveredTags

        message = DiscoveredTags()
        message.header.frame_id = "map"
        for tag in tags:
            item = DiscoveredTag(tag_id=tag, sightings=3)
            item.pose_in_map.position.x, item.pose_in_map.position.y = 1.0 * int(tag), 1.0
            # +Z along -y: a quarter turn about x
            item.pose_in_map.orientation.x = item.pose_in_map.orientation.w = math.sqrt(0.5)
            message.tags.append(item)
        self.tags.publish(message)

    def call(self, row: graph.Service, request: Any = None) -> Any:
        from lupin_runtime.ros.interfaces import interface

        client = self.clients[row.name]
        self.host.until(client.service_is_ready, what=row.name)
        future = client.call_async(request or interface(row.type).Request())
        self.host.until(future.done, what=f"an answer of {row.name}")
        return future.result()

    def start(self, kind: str, tags: tuple[str, ...] = (), goal: int = 0) -> Any:
        from lupin_msgs.srv import StartMission

        return self.call(
            graph.MISSION_START,
            StartMission.Request(mission_type=kind, tag_sequence=list(tags), discovery_goal=goal),
        )

    def until(self, condition: Any, what: str, timeout_s: float = 60.0) -> Any:
        """Wait for a state that is published after this call."""
        seen = len(self.states)

        def find() -> Any:
            return next((s for s in self.states[max(0, seen - 1) :] if condition(s)), None)

        return self.host.until(find, timeout_s, what)


def test_exploration_runs_from_start_to_done(graph_host: Any) -> None:
    fake = FakeGraph(graph_host, monitoring_sweeps=1, arm_patrol_enabled=True, arm_travel_settle_s=0.1, flower_scan_dwell_s=0.2)
    fake.show_map(2.0)
    reply = fake.start("ExplorationMission", goal=2)
    assert reply.accepted and reply.mission_id.startswith("lupin-")
    fake.host.until(lambda: fake.goals, what="a frontier goal")
    assert fake.goals[0].x > 1.5
    fake.show_tags("1")
    fake.host.until(lambda: len(fake.observations) == 1, what="the first climate of a tag")
    fake.show_tags("1", "2")
    fake.until(lambda s: s.lifecycle_state == "MONITORING", "MONITORING")
    done = fake.until(lambda s: s.lifecycle_state == "DONE", "DONE")
    assert (done.targets_completed, done.targets_total, done.tags_discovered) == (2, 2, 2)
    assert not done.paused and done.mission_id == reply.mission_id
    fake.host.until(lambda: len(fake.observations) == 4, what="all observations")
    by_source = [(o.source, o.tag_reading.tag_id, o.status) for o in fake.observations]
    assert sorted(by_source[:2]) == [("ExplorationMission", "1", 0), ("ExplorationMission", "2", 0)]
    assert sorted(by_source[2:]) == [("MonitoringMission", "1", 0), ("MonitoringMission", "2", 0)]
    for observation in fake.observations:
        assert observation.header.frame_id == "map"
        assert observation.tag_pose_in_map.orientation.w != 0.0
        assert observation.tag_pose_in_map.position.x == float(observation.tag_reading.tag_id)
        assert observation.tag_reading.readings[0].value == 400.0 + int(observation.tag_reading.tag_id)
    assert (fake.goals[-1].x, fake.goals[-1].y) == (0.0, 0.0)
    assert fake.max_active == 1
    assert fake.presets[0] == "home" and fake.presets.count("inspect") == 2
    phases = {(s.lifecycle_state, s.mission_phase) for s in fake.states}
    assert ("MONITORING", "NAVIGATING") in phases and ("MONITORING", "SCANNING") in phases


def test_state_is_published_periodically(graph_host: Any) -> None:
    fake = FakeGraph(graph_host)
    seen = len(fake.states)
    fake.host.until(lambda: len(fake.states) >= seen + 5, what="five repeats while nothing happens")
    assert {s.lifecycle_state for s in fake.states[seen:]} == {"READY"}
    assert fake.states[-1].started_at.sec == 0 and fake.states[-1].battery_percentage == 1.0


def test_e_stop_cancels_goal_until_resume(graph_host: Any) -> None:
    fake = FakeGraph(graph_host)
    fake.hold = True
    fake.show_tags("1")
    fake.host.until(lambda: fake.start("InspectionMission", ("1",)).accepted, what="a start with a known tag")
    fake.host.until(lambda: fake.active, what="a goal")
    fake.estop = True
    fake.until(lambda s: s.estop_engaged and s.paused, "the e-stop")
    fake.host.until(lambda: fake.results == ["canceled"], what="the goal's end")
    fake.estop = False
    fake.until(lambda s: not s.estop_engaged, "the release")
    fake.host.until(lambda: len(fake.states) and fake.states[-1].paused, what="the mission to be paused")
    sent = len(fake.goals)
    seen = len(fake.states)
    fake.host.until(lambda: len(fake.states) > seen + 4, what="four more states")
    assert len(fake.goals) == sent
    fake.hold = False
    assert fake.call(graph.MISSION_RESUME).success
    done = fake.until(lambda s: s.lifecycle_state == "DONE", "DONE")
    assert done.targets_completed == 1


def test_goal_aborted_by_the_estop_pauses_until_resume(graph_host: Any) -> None:
    fake = FakeGraph(graph_host, nav_max_attempts=1)
    fake.abort_reason = "e-stop engaged; send a new goal after its release"
    fake.show_tags("1")
    fake.host.until(lambda: fake.start("InspectionMission", ("1",)).accepted, what="a start with a known tag")
    fake.until(lambda s: s.paused and s.last_event == "e-stop engaged", "the pause")
    seen = len(fake.states)
    fake.host.until(lambda: len(fake.states) > seen + 4, what="four more states")
    assert len(fake.goals) == 1
    fake.abort_reason = ""
    assert fake.call(graph.MISSION_RESUME).success
    done = fake.until(lambda s: s.lifecycle_state == "DONE", "DONE")
    assert done.targets_completed == 1


def test_slow_cancel_never_runs_two_goals(graph_host: Any) -> None:
    fake = FakeGraph(graph_host)
    fake.hold, fake.cancel_delay_s = True, 0.8
    fake.show_tags("1")
    fake.host.until(lambda: fake.start("InspectionMission", ("1",)).accepted, what="a start with a known tag")
    fake.host.until(lambda: fake.active, what="a goal")
    assert fake.call(graph.MISSION_PAUSE).success
    assert fake.call(graph.MISSION_RESUME).success
    fake.hold = False
    done = fake.until(lambda s: s.lifecycle_state == "DONE", "DONE")
    assert fake.results[0] == "canceled"
    assert fake.max_active == 1
    assert done.targets_completed == 1 and done.targets_unreachable == 0


def test_late_accepted_goal_is_cancelled(graph_host: Any) -> None:
    fake = FakeGraph(graph_host, nav_timeout_s=0.4, nav_max_attempts=1, dock_timeout_s=0.2)
    fake.accept_delay_s, fake.hold = 1.5, True
    fake.show_tags("1")
    fake.host.until(lambda: fake.start("InspectionMission", ("1",)).accepted, what="a start with a known tag")
    returning = fake.until(lambda s: s.lifecycle_state in ("RETURNING", "DONE"), "the timeout")
    assert returning.targets_unreachable == 1
    fake.host.until(lambda: fake.results and fake.results[0] == "canceled", what="the cancel on acceptance")
    fake.host.until(lambda: fake.observations, what="the observation")
    assert fake.observations[0].status_detail == "nav_timeout"
    assert fake.observations[0].tag_pose_in_map.orientation.w == 0.0
    assert fake.observations[0].tag_reading.tag_id == "1"
    fake.host.until(lambda: not fake.active, what="no goal left")


def test_pause_stops_a_drive_whose_acceptance_was_lost(graph_host: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    fake = FakeGraph(graph_host)
    fake.hold = True
    fake.show_tags("1")
    lose_goal_answers(monkeypatch, fake.orchestrator._navigation._client)
    fake.host.until(lambda: fake.start("InspectionMission", ("1",)).accepted, what="a start with a known tag")
    fake.host.until(lambda: fake.active, what="a goal")
    assert fake.call(graph.MISSION_PAUSE).success
    fake.host.until(lambda: fake.results == ["canceled"], what="the goal's end")


def test_cancel_of_all_goals_is_answered(graph_host: Any) -> None:
    fake = FakeGraph(graph_host)
    fake.hold = True
    fake.show_tags("1")
    fake.host.until(lambda: fake.start("InspectionMission", ("1",)).accepted, what="a start with a known tag")
    fake.host.until(lambda: fake.active, what="a goal")
    answers: list[bool] = []
    navigation = fake.orchestrator._navigation
    assert fake.host.within(fake.orchestrator, lambda: navigation.cancel_all(lambda: answers.append(True)))
    fake.host.until(lambda: answers == [True], what="the answer")
    fake.host.until(lambda: fake.results[:1] == ["canceled"], what="the goal's end")


def test_killed_navigation_gets_goal_again_after_restart(graph_host: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from lupin_runtime.mission import goal_runner

    monkeypatch.setattr(goal_runner, "FEEDBACK_SILENCE_S", 1.0)
    fake = FakeGraph(graph_host)
    fake.hold = True
    fake.show_tags("1")
    fake.host.until(lambda: fake.start("InspectionMission", ("1",)).accepted, what="a start with a known tag")
    fake.host.until(lambda: fake.active, what="a goal")
    fake.host.until(lambda: fake.orchestrator.orchestrator.mission_runner.goal_runner._goal.feedback_s, what="feedback")
    fake.hang_navigation()
    fake.hold = False
    fake.start_navigation()
    with graph_host.clock.real():
        done = fake.until(lambda s: s.lifecycle_state == "DONE", "DONE")
    assert done.targets_completed == 1
    assert len(fake.goals) == 3


def test_shutdown_cancels_active_goal(graph_host: Any) -> None:
    fake = FakeGraph(graph_host)
    fake.hold = True
    fake.show_tags("1")
    fake.host.until(lambda: fake.start("InspectionMission", ("1",)).accepted, what="a start with a known tag")
    fake.host.until(lambda: fake.active, what="a goal")
    fake.orchestrator.before_shutdown()
    fake.host.until(lambda: fake.results == ["canceled"], what="the goal's end")


def test_low_battery_is_published_and_requests_refused(graph_host: Any) -> None:
    from sensor_msgs.msg import BatteryState

    fake = FakeGraph(graph_host)
    fake.battery_topic.publish(BatteryState(percentage=12.0))
    low = fake.until(lambda s: s.battery_low, "the low battery")
    assert low.battery_percentage == pytest.approx(0.12)
    assert (low.last_event, low.last_event_severity) == ("battery low", 1)
    assert "battery" in fake.start("ExplorationMission").error_message
    assert not fake.call(graph.MISSION_SKIP).success


def test_invalid_files_are_ignored_with_an_error(graph_host: Any, tmp_path: Path) -> None:
    from lupin_runtime.mission.node import MissionOrchestrator

    overrides, layout = tmp_path / "overrides.yaml", tmp_path / "layout.json"
    overrides.write_text("overrides: [1]\n")
    layout.write_text("{")
    node = graph_host.add(MissionOrchestrator({"approach_overrides_file": str(overrides), "tag_locations_file": str(layout)}))
    assert node.orchestrator.hsm.state == "BOOT"


def test_parameters_accept_integers_and_reject_nonsense(graph_host: Any) -> None:
    from lupin_runtime.mission.config import BadParameter
    from lupin_runtime.mission.node import MissionOrchestrator

    node = graph_host.add(MissionOrchestrator({"nav_timeout_s": 90, "tag_sequence": ["3", "4"]}))
    assert node._config.nav_timeout_s == 90.0
    assert node._config.tag_sequence == ("3", "4")
    for wrong, named in (
        ({"nav_timeout_s": -1.0}, "nav_timeout_s is -1"),
        ({"nav_timout_s": 90.0}, "did you mean nav_timeout_s"),
        ({"dock_pose": [1.0]}, "dock_pose"),
        ({"nav_max_attempts": 0}, "nav_max_attempts"),
        ({"approach_yaw": math.nan}, "approach_yaw"),
    ):
        with pytest.raises(BadParameter, match=named):
            MissionOrchestrator(wrong)


def test_pose_seed_variance_grows_without_transforms(graph_host: Any) -> None:
    from lupin_runtime.mission.pose_seed import PoseSeed
    from lupin_runtime.ros import LupinNode, TransformBroadcaster
    from lupin_runtime.ros.tf import to_message

    node = LupinNode("slam")
    broadcaster = TransformBroadcaster(node)
    poses: list[Any] = []
    coming = True

    def beat() -> None:
        if coming:
            broadcaster.send(to_message("map", "base_link", node.now_ns(), Transform((1.0, 2.0, 0.0))))

    node.create_timer(0.02, beat)
    node.subscription(graph.AMCL_POSE, poses.append)
    graph_host.add(node)
    graph_host.add(PoseSeed({"rate_hz": 20.0, "stale_after_s": 0.5}))
    graph_host.until(lambda: len(poses) > 3, what="poses")
    assert (poses[-1].pose.pose.position.x, poses[-1].pose.pose.position.y) == (1.0, 2.0)
    assert poses[-1].pose.covariance[0] == poses[-1].pose.covariance[35] == 0.01
    coming = False
    graph_host.until(lambda: poses[-1].pose.covariance[0] > 0.25, what="a variance that no mission accepts")
    coming = True
    graph_host.until(lambda: poses[-1].pose.covariance[0] == 0.01, what="the pose to be trusted again")
