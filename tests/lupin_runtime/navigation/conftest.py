"""A kinematic robot in the test's process, and a client that sends goals to the navigation node."""

from __future__ import annotations

import math
import threading
from array import array
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2
from tests.support.kinematic_base import Arena, Base

if TYPE_CHECKING:
    from geometry_msgs.msg import TransformStamped, Twist
    from nav2_msgs.action import (
        ComputePathToPose_GetResult_Response,
        ComputePathToPose_Goal,
        FollowWaypoints_GetResult_Response,
        FollowWaypoints_Goal,
        NavigateThroughPoses_GetResult_Response,
        NavigateThroughPoses_Goal,
        NavigateToPose_GetResult_Response,
        NavigateToPose_Goal,
    )

    from lupin_runtime.navigation.node import Navigator
    from lupin_runtime.ros.node import LupinNode
    from lupin_runtime.transforms import TransformTree
    from tests.conftest import GraphHost

STEP_S, SPEED = 0.04, 3.0
MAX_STEPS_AHEAD = 4  # of the transforms that navigation has handled


def _robot_class() -> type[Any]:
    from nav_msgs.msg import OccupancyGrid, Odometry
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import LaserScan

    from lupin_runtime.ros import LupinNode, TransformBroadcaster, stamp_from_ns, stamp_ns
    from lupin_runtime.ros.tf import to_message
    from lupin_runtime.transforms import Transform, TransformUnavailable

    def transform(pose: Pose2) -> Transform:
        return Transform((pose.x, pose.y, 0.0), (0.0, 0.0, math.sin(pose.yaw / 2), math.cos(pose.yaw / 2)))

    class TinyRobot(LupinNode):
        """A kinematic base with odometry, a lidar and perfect localization.

        It publishes the clock, SPEED times as fast as the wall clock, in steps, and waits for its navigation: a slow machine
        only makes the test slower.
        """

        def __init__(self, arena: Arena, start: Pose2) -> None:
            super().__init__("tiny_robot")
            self.time_ns = 10**9
            self.step_s = STEP_S
            self.steps = 0
            self._clock_out = self.publisher(graph.CLOCK)
            self.arena = arena
            self.base = Base(start)
            self.command = (0.0, 0.0, 0.0)
            self.commands: list[tuple[float, float, float]] = []
            self.scan_mode = "good"
            self.collisions = 0
            self.lock = threading.Lock()
            self._frozen: np.ndarray | None = None
            self._random = np.random.default_rng(5)
            self._odometry = self.publisher(graph.ODOM)
            self._scan = self.publisher(graph.SCAN)
            self._map = self.publisher(graph.MAP)
            self._tf = TransformBroadcaster(self)
            self.followed_by: TransformTree | None = None
            self.late_steps = 0  # by which transforms come later than the scans
            self._sent_ns: deque[int] = deque(maxlen=250)
            self._transforms: deque[list[TransformStamped]] = deque()
            self.subscription(graph.CMD_VEL_NAV, self._on_command)
            self.mount_lidar(0.0)
            self.create_timer(STEP_S / SPEED, self._step)

        def mount_lidar(self, roll: float) -> None:
            """Mount the lidar. It faces left, so that code which ignores its mount drives into walls."""
            self.roll = roll
            rolled = Transform(rotation=(math.sin(roll / 2), 0.0, 0.0, math.cos(roll / 2)))
            mount = transform(Pose2(0.0, 0.0, math.pi / 2)) @ rolled
            self._tf.send_static(to_message(graph.BASE_FRAME, f"/{graph.LASER_FRAME}", 0, mount))

        def _on_command(self, message: Twist) -> None:
            self.command = (message.linear.x, message.linear.y, message.angular.z)
            self.commands.append(self.command)

        def publish_map(self) -> None:
            grid = self.arena.grid()
            message = OccupancyGrid()
            message.header.frame_id = graph.MAP_FRAME
            message.info.resolution = grid.resolution_m
            message.info.height, message.info.width = grid.cells.shape
            message.info.origin.position.x, message.info.origin.position.y = grid.origin_x, grid.origin_y
            message.info.origin.orientation.w = 1.0
            message.data = array("b", grid.cells.tobytes())
            self._map.publish(message)

        def _is_ahead(self) -> bool:
            if self.followed_by is None:
                return False
            with suppress(TransformUnavailable):
                newest = self.followed_by.newest_ns(graph.ODOM_FRAME, graph.BASE_FRAME)
                return newest in self._sent_ns and newest not in list(self._sent_ns)[-MAX_STEPS_AHEAD:]
            return False

        def _step(self) -> None:
            if self._is_ahead():
                self._tf.send(*self._transforms[0])  # they may have been lost
                return
            self.time_ns += int(STEP_S * 1e9)
            self.steps += 1
            self._clock_out.publish(Clock(clock=stamp_from_ns(self.time_ns)))
            self._move()
            if self.steps % 3 == 0:
                self._publish_scan()

        def _move(self) -> None:
            for _ in range(4):
                self.base.drive(self.command, STEP_S / 4)
            self.collisions += self.arena.touches(self.base.truth)
            now = self.time_ns
            odometry = self.base.odometry
            correction = self.base.truth @ odometry.inverse()
            self._send_transforms(
                to_message(graph.ODOM_FRAME, graph.BASE_FRAME, now, transform(odometry)),
                to_message(graph.MAP_FRAME, graph.ODOM_FRAME, now, transform(correction)),
            )
            message = Odometry()
            twist = message.twist.twist
            twist.linear.x, twist.linear.y, twist.angular.z = self.base.velocity
            self._odometry.publish(message)

        def _send_transforms(self, *transforms: TransformStamped) -> None:
            self._transforms.append(list(transforms))
            while len(self._transforms) > 1 + self.late_steps:
                self._transforms.popleft()
            sent_ns = stamp_ns(self._transforms[0][0].header.stamp)
            if self._sent_ns and self._sent_ns[-1] > sent_ns:
                self._sent_ns.clear()  # the clock was set back
            self._sent_ns.append(sent_ns)
            self._tf.send(*self._transforms[0])

        def _publish_scan(self) -> None:
            if self.scan_mode == "silent":
                return
            ranges = self.arena.ranges(self.base.truth @ Pose2(0.0, 0.0, math.pi / 2), self._random)
            if self.roll == math.pi:
                ranges = np.roll(ranges[::-1], 1)
            if self.scan_mode == "frozen":
                self._frozen = ranges = ranges if self._frozen is None else self._frozen
            elif self.scan_mode == "nan":
                ranges = np.full_like(ranges, np.nan)
            elif self.scan_mode == "zero":
                ranges = np.zeros_like(ranges)
            message = LaserScan(
                angle_min=0.0, angle_increment=2 * math.pi / len(ranges), range_min=0.03, range_max=12.0, scan_time=0.1
            )
            message.header.stamp = stamp_from_ns(self.time_ns)
            message.header.frame_id = graph.LASER_FRAME
            data = array("f")
            data.frombytes(ranges.astype(np.float32).tobytes())
            message.ranges = data
            self._scan.publish(message)

    return TinyRobot


class Pilot:
    """Sends goals and keeps feedback and results."""

    def __init__(self, host: GraphHost, robot: Any, navigator: Navigator, client_node: LupinNode) -> None:
        self.host, self.robot, self.navigator, self.node = host, robot, navigator, client_node
        self.client = client_node.action_client(graph.NAVIGATE_TO_POSE)
        self.feedback: list[Any] = []

    def goal(self, x: float, y: float, yaw: float = 0.0, frame: str = "map") -> NavigateToPose_Goal:
        from nav2_msgs.action import NavigateToPose

        from lupin_runtime.ros.plane_messages import plane_pose_message

        return NavigateToPose.Goal(pose=plane_pose_message(Pose2(x, y, yaw), 0, frame))

    def send(
        self,
        goal: ComputePathToPose_Goal | FollowWaypoints_Goal | NavigateThroughPoses_Goal | NavigateToPose_Goal,
        client: Any = None,
    ) -> Any:
        client = client or self.client
        self.host.until(client.server_is_ready, what="the action server")
        future = self.host.within(
            self.node, lambda: client.send_goal_async(goal, feedback_callback=lambda m: self.feedback.append(m.feedback))
        )
        return self.host.until(lambda: future.done() and future.result(), what="the goal's answer")

    def result(
        self, handle: Any
    ) -> (
        ComputePathToPose_GetResult_Response
        | FollowWaypoints_GetResult_Response
        | NavigateThroughPoses_GetResult_Response
        | NavigateToPose_GetResult_Response
    ):
        future = self.host.within(self.node, handle.get_result_async)
        return self.host.until(lambda: future.done() and future.result(), what="the goal's end")

    def driving(self) -> bool:
        return math.hypot(*self.robot.base.velocity[:2]) > 0.2

    def at_rest(self) -> bool:
        result: bool = max(map(abs, self.robot.base.velocity)) < 0.02
        return result

    def ends_with_zero(self) -> bool:
        return bool(self.robot.commands) and self.robot.commands[-1] == (0.0, 0.0, 0.0)


@pytest.fixture
def pilot(graph_host: GraphHost, request: pytest.FixtureRequest) -> Iterator[Any]:
    from lupin_runtime.navigation.node import Navigator
    from lupin_runtime.ros import LupinNode

    arena = Arena(4.0, 3.0, [(1.6, 0.9, 2.4, 3.0)])
    robot = graph_host.add(_robot_class()(arena, Pose2(0.6, 0.6, 0.0)))
    robot.publish_map()
    navigator = graph_host.add(Navigator({"use_sim_time": True, "goal_checker.settle_s": 0.5, **getattr(request, "param", {})}))
    robot.followed_by = navigator._robot_state.tree
    pilot = Pilot(graph_host, robot, navigator, graph_host.add(LupinNode("pilot")))
    # The servers may be discovered before the transforms arrive; what needs the robot's pose is refused until then.
    graph_host.until(lambda: navigator._robot_state.map_from_base() is not None, what="the robot's pose")
    yield pilot
    assert robot.collisions == 0
    navigator.before_shutdown()
