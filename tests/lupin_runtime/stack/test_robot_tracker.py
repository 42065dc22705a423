"""What the tracker tells of a robot on a real graph, and that what nobody renews is not shown."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2
from lupin_runtime.transforms import Transform

pytestmark = pytest.mark.graph


class Robot:
    """A node that publishes what a robot and its stack do, and a tracker on another node."""

    def __init__(self, host: Any) -> None:
        from lupin_runtime.ros import LupinNode, TransformBroadcaster
        from lupin_runtime.stack.robot_tracker import RobotTracker

        self.host = host
        self.node = host.add(LupinNode("robot"))
        self.broadcaster = TransformBroadcaster(self.node)
        self.tracker = RobotTracker(host.add(LupinNode("tracker")))
        self.publishers: dict[str, Any] = {}
        host.until(lambda: self.node.count_subscribers(graph.TF.name), what="the subscription")

    def stand_at(self, x: float, y: float, yaw: float = 0.0) -> None:
        from lupin_runtime.ros.tf import to_message

        turn = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        now_ns = self.node.now_ns()
        self.broadcaster.send(to_message("map", "odom", now_ns, Transform()))
        self.broadcaster.send(to_message("odom", "base_link", now_ns, Transform((x, y, 0.0), turn)))

    def publish(self, topic: graph.Topic, message: Any) -> None:
        publisher = self.publishers.setdefault(topic.name, self.node.publisher(topic))
        self.host.until(lambda: self.node.count_subscribers(topic.name), what=f"the subscription to {topic.name}")
        publisher.publish(message)

    def until(self, holds: Callable[[dict[str, Any]], object], what: str) -> dict[str, Any]:
        def look() -> dict[str, Any] | None:
            facts = self.tracker.look()
            return facts if holds(facts) else None

        facts: dict[str, Any] = self.host.until(look, what=what)
        return facts


@pytest.fixture
def robot(graph_host: Any) -> Iterator[Robot]:
    with graph_host.clock.real():
        yield Robot(graph_host)


def test_way_and_speed_follow_the_pose_until_it_falls_silent(robot: Robot) -> None:
    assert robot.tracker.look()["pose"] is None
    for x in (0.0, 0.4, 0.8, 9.0):  # the last step is a correction of the pose, not a way

        def stands(x: float = x) -> bool:
            robot.stand_at(x, 1.0, 0.5)
            return bool(robot.tracker.look()["pose"]) and robot.tracker.look()["pose"][0] == x

        robot.host.until(stands, what="the pose")
    facts = robot.tracker.look()
    assert facts["pose"] == [9.0, 1.0, 0.5]
    assert facts["distance_m"] == pytest.approx(0.8)
    assert facts["trail"] == [[0.0, 1.0], [0.4, 1.0], [0.8, 1.0], [9.0, 1.0]]
    facts = robot.until(lambda look: look["pose"] is None, "a pose that is too old")
    assert facts["speed_m_s"] is None and facts["distance_m"] == pytest.approx(0.8)


def test_map_plan_tags_and_battery_are_known_late(robot: Robot) -> None:
    from geometry_msgs.msg import Pose
    from lupin_msgs.msg import DiscoveredTag, DiscoveredTags, SensorReading, TwinState, TwinTagState
    from nav_msgs.msg import Path
    from sensor_msgs.msg import BatteryState

    from lupin_runtime.ros.plane_messages import grid_message, plane_pose_message

    cells = np.full((4, 4), -1, np.int8)
    cells[1:3, 1:3] = 0
    robot.publish(graph.MAP, grid_message(cells, 0.5, (0.0, 0.0), "map", 0))
    place = Pose()
    place.position.x, place.position.y = 1.25, math.nan
    robot.publish(graph.DISCOVERED_TAGS, DiscoveredTags(tags=[DiscoveredTag(tag_id="8", pose_in_map=place)]))
    place.position.y = 2.0
    robot.publish(graph.DISCOVERED_TAGS, DiscoveredTags(tags=[DiscoveredTag(tag_id="7", pose_in_map=place)]))
    robot.publish(graph.TWIN_STATE, TwinState(tags=[TwinTagState(tag_id="7", readings=[SensorReading(name="co2")])]))
    robot.publish(graph.BATTERY, BatteryState(percentage=0.25))
    path = Path(poses=[plane_pose_message(Pose2(x / 100, 0.0), 0, "map") for x in range(1000)])
    robot.publish(graph.PLAN, path)
    facts = robot.until(lambda look: look["plan"] and look["tags"] and "map" in look and "battery" in look, "all of it")
    assert facts["map"]["rows"] == ["..", ".."] and facts["battery"] == 0.25
    assert len(facts["plan"]) <= 60 and facts["plan"][-1] == [9.99, 0.0]
    assert {"id": "7", "x": 1.25, "y": 2.0, "read": True} in facts["tags"]
    facts = robot.until(lambda look: not look["plan"], "a plan that is too old")
    assert facts["map"]["rows"] == ["..", ".."]


def test_real_time_factor_is_measured_from_the_clock(robot: Robot) -> None:
    from rosgraph_msgs.msg import Clock

    from lupin_runtime.ros import stamp_from_ns

    first_ns = robot.node.elapsed_clock_ns()

    def measured() -> dict[str, Any] | None:
        passed_ns = robot.node.elapsed_clock_ns() - first_ns
        robot.publish(graph.CLOCK, Clock(clock=stamp_from_ns(5_000_000_000 + passed_ns // 2)))
        facts = robot.tracker.look()
        return facts if 0.3 < (facts.get("real_time_factor") or 0.0) < 0.7 else None

    robot.host.until(measured, what="half of real time")
