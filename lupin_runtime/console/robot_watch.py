"""What voice sessions read of the robot: its pose on the map and by odometry, its battery, and what its light strip shows.

Nothing waits for these topics: the middleware keeps their newest messages, which are taken twice a second.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.subscription import Subscription

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, yaw_from_quaternion
from lupin_runtime.localization import planar_variances, says_lost
from lupin_runtime.mission.robot_pose import PolledTransform
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.node import qos_profile
from lupin_runtime.ros.polled_subscription import PolledGroup, take_newest

LOOK_PERIOD_S = 0.5
STALE_S = 5.0  # what nobody renews for this long is not known any more


class RobotWatch:
    """Subscribes for as long as it is open. All methods are called on the executor's thread.

    `names` are the page's settings of topics and frames.
    """

    def __init__(self, node: LupinNode, names: Mapping[str, str]) -> None:
        self._node = node
        self._group = PolledGroup()
        self._robot = PolledTransform(node, names["mapFrame"], names["baseFrame"])
        self._subscriptions = {
            key: self._poll(row, name)
            for key, row, name in (
                ("odometry", graph.ODOM, names["odomTopic"]),
                ("battery", graph.BATTERY, names["batteryTopic"]),
                ("localization", graph.AMCL_POSE, graph.AMCL_POSE.name),
                ("lights", graph.LEDS_STATUS, graph.LEDS_STATUS.name),
            )
        }
        self._last: dict[str, tuple[int, Any]] = {}  # by key: when it was taken, and the message
        # Steady time: a stopped /clock must not make an old pose look new.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(LOOK_PERIOD_S, self._look, clock=steady)

    def close(self) -> None:
        """End all subscriptions."""
        self._node.destroy_timer(self._timer)
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._robot.close()

    def map_pose(self) -> Pose2 | None:
        """Return where the robot is on the map; None if that is not known, or the robot is lost."""
        self._look()
        localization = self._last.get("localization")
        if localization is not None and says_lost(planar_variances(localization[1])):
            return None
        found = self._robot.lookup()
        return None if found is None or found[1] > STALE_S else found[0].to_pose2()

    def odometry(self) -> Pose2 | None:
        """Return the robot's pose by odometry; None if that is not known."""
        message = self._fresh("odometry")
        if message is None:
            return None
        pose = message.pose.pose
        turn = pose.orientation
        found = Pose2(pose.position.x, pose.position.y, yaw_from_quaternion(turn.x, turn.y, turn.z, turn.w))
        return found if all(map(math.isfinite, (found.x, found.y, found.yaw))) else None

    def battery(self) -> tuple[float, float] | None:
        """Return the battery's voltage and charge (0..1); None if they are not known."""
        message = self._fresh("battery")
        return None if message is None else (float(message.voltage), float(message.percentage))

    def light_rule(self) -> str:
        """Return the rule by which the light strip shows its light; empty if none was received. It is sent when it changes."""
        self._look()
        return str(self._last["lights"][1].data) if "lights" in self._last else ""

    def _fresh(self, key: str) -> Any:
        self._look()
        taken_ns, message = self._last.get(key, (0, None))
        return message if self._node.monotonic_ns() - taken_ns <= STALE_S * 1e9 else None

    def _look(self) -> None:
        self._robot.lookup()  # notes when the transforms last changed
        for key, subscription in self._subscriptions.items():
            if (message := take_newest(subscription)) is not None:
                self._last[key] = self._node.monotonic_ns(), message

    def _poll(self, row: graph.Topic, name: str) -> Subscription:
        return self._node.create_subscription(
            interface(row.type), name, lambda _: None, qos_profile(row.qos), callback_group=self._group
        )
