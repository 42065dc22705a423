"""The ROS implementations of the protocols in ports.py: navigation's action, services, transforms, map."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal
from lupin_msgs.srv import ConfirmTag, GetTagReading, SetArmPreset
from nav2_msgs.action import NavigateToPose

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.messages import climate_reading, grid_map
from lupin_runtime.mission.orchestrator import Orchestrator
from lupin_runtime.mission.ports import STATUS_UNKNOWN
from lupin_runtime.mission.records import ClimateReading, Confirmation
from lupin_runtime.mission.robot_pose import PolledTransform
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.plane_messages import plane_pose_message
from lupin_runtime.ros.sent_goal import SentGoal
from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED

STALE_TRANSFORM_S = 2.0
_MAX_PENDING = 32  # unanswered requests of a service
# Longest step of the clock that counts. The clock is read ten times a second, so a longer one means that the process stalled or
# that the clock was set.
MAX_STEP_S = 2.0

# Runs a callback under the node's lock, and publishes the state if the callback changed it.
RunLocked = Callable[[Callable[[], None]], None]


class NodeClock:
    """The node's time. A clock that is set during a mission neither triggers nor delays timeouts: the time between
    two readings counts as at least 0 and at most MAX_STEP_S."""

    def __init__(self, node: LupinNode) -> None:
        self._node = node
        self._elapsed_ns = 0
        self._last_read_ns: int | None = None

    def now_s(self) -> float:
        """Return seconds for timeouts; never decreases."""
        now_ns = self._node.elapsed_clock_ns()
        if self._last_read_ns is not None:
            self._elapsed_ns += min(max(now_ns - self._last_read_ns, 0), int(MAX_STEP_S * 1e9))
        self._last_read_ns = now_ns
        return self._elapsed_ns / 1e9

    @staticmethod
    def monotonic_s() -> float:
        """Return seconds of the computer's monotonic clock, independent of simulated time."""
        return time.monotonic()

    def stamp_ns(self) -> int:
        """Return ROS time in nanoseconds."""
        return self._node.now_ns()


def sensor_failure_codes() -> frozenset[int]:
    """Return the error codes by which navigation reports failed sensors: missing transforms, a costmap without scans.

    Empty with nav2_msgs older than Jazzy, which has no such codes."""
    names = {"FollowPath": ("TF_ERROR", "CONTROLLER_TIMED_OUT"), "ComputePathToPose": ("TF_ERROR",)}
    results = {action: interface(f"nav2_msgs/action/{action}").Result for action in names}
    found = (getattr(results[action], name, None) for action, constants in names.items() for name in constants)
    return frozenset(int(code) for code in found if code is not None)


class NavigationClient:
    """Client of the action navigate_to_pose. Results go to `listener`, which must be set before the first goal."""

    def __init__(self, node: LupinNode, config: MissionConfig, run_locked: RunLocked) -> None:
        self._node, self._config, self._run_locked = node, config, run_locked
        action = replace(graph.NAVIGATE_TO_POSE, name=config.nav_action_name)
        self._client = node.action_client(action)
        self._cancel_client = node.create_client(CancelGoal, f"{action.name}/_action/cancel_goal")
        self._goals: dict[int, SentGoal] = {}  # until their results arrive
        self._sensor_failure_codes = sensor_failure_codes()
        self.listener: Orchestrator

    def is_ready(self) -> bool:
        """Return whether the action server is available."""
        return bool(self._client.server_is_ready())

    def send(self, token: int, pose: Pose2) -> None:
        """Send a goal; `token` identifies it in the calls of the listener."""
        goal = NavigateToPose.Goal()
        goal.pose = plane_pose_message(pose, self._node.now_ns(), self._config.frame_id)
        try:
            sent = SentGoal(
                self._client, NavigateToPose, goal, lambda _: self._run_locked(lambda: self.listener.goal_feedback(token))
            )
        except (RuntimeError, ValueError, TypeError) as error:  # rclpy: shutdown, or a number that is not finite
            self.listener.goal_rejected(token, f"send_goal_exception: {error}")
            return
        self._goals[token] = sent
        sent.answer.add_done_callback(lambda done: self._run_locked(lambda: self._on_goal_response(token, done)))

    def _on_goal_response(self, token: int, future: Any) -> None:
        error = future.exception()
        handle = None if error is not None else future.result()
        if handle is None or not handle.accepted:
            self._goals.pop(token, None)
            self.listener.goal_rejected(token, f"send_goal_exception: {error}" if error is not None else "nav_rejected")
            return
        result = handle.get_result_async()
        result.add_done_callback(lambda done: self._run_locked(lambda: self._on_result(token, done)))
        self.listener.goal_accepted(token)

    def _on_result(self, token: int, future: Any) -> None:
        self._goals.pop(token, None)
        known = future.exception() is None and future.result() is not None
        status = int(future.result().status) if known else STATUS_UNKNOWN
        result = future.result().result if known else None
        code = int(getattr(result, "error_code", 0))
        estop = str(getattr(result, "error_msg", "")).startswith(ESTOP_ENGAGED)
        self.listener.goal_finished(token, status, code in self._sensor_failure_codes, estop)

    def cancel(self, token: int) -> None:
        """Request cancellation of a goal, whether or not its acceptance has arrived."""
        goal = self._goals.get(token)
        if goal is not None:
            goal.handle.cancel_goal_async()

    def cancel_all(self, on_answer: Callable[[], None]) -> bool:
        """Request cancellation of every goal: a zero id with a zero stamp means all (action_msgs/CancelGoal)."""
        if not self._cancel_client.service_is_ready():
            return False
        answer = self._cancel_client.call_async(CancelGoal.Request(goal_info=GoalInfo()))
        answer.add_done_callback(lambda _done: self._run_locked(on_answer))
        return True


class _ServiceClient:
    """A service client that never waits. It forgets the oldest request when _MAX_PENDING are unanswered."""

    def __init__(self, node: LupinNode, service: graph.Service, run_locked: RunLocked) -> None:
        self._client = node.client(service)
        self._run_locked = run_locked
        self._pending: list[Any] = []

    def is_ready(self) -> bool:
        """Return whether the service is available."""
        return bool(self._client.service_is_ready())

    def _call(self, request: Any, on_answer: Callable[[Any], None]) -> None:
        self._pending = [future for future in self._pending if not future.done()]
        while len(self._pending) >= _MAX_PENDING:
            self._client.remove_pending_request(self._pending.pop(0))
        future = self._client.call_async(request)
        self._pending.append(future)

        def on_done(done: Any) -> None:
            if done.exception() is None and done.result() is not None:
                self._run_locked(lambda: on_answer(done.result()))

        future.add_done_callback(on_done)


class ClimateBridgeClient(_ServiceClient):
    """Client of the climate bridge."""

    def read(self, tag_id: str, on_reading: Callable[[ClimateReading], None]) -> None:
        """Request the climate at a tag."""
        self._call(GetTagReading.Request(tag_id=tag_id), lambda response: on_reading(climate_reading(response)))


class ConfirmTagClient(_ServiceClient):
    """Client of the service that confirms tags visually."""

    def confirm(self, tag_id: str, on_confirmation: Callable[[Confirmation], None]) -> None:
        """Request confirmation of a tag."""
        self._call(
            ConfirmTag.Request(expected_tag_id=tag_id),
            lambda response: on_confirmation(Confirmation(bool(response.detected), response.error_message)),
        )


class ArmClient(_ServiceClient):
    """Client of the arm's presets."""

    def __init__(self, node: LupinNode, service: graph.Service, run_locked: RunLocked) -> None:
        super().__init__(node, service, run_locked)
        self._log = node.get_logger()

    def move_to_preset(self, preset: str) -> bool:
        """Send the arm to a preset."""
        if not self.is_ready():
            self._log.warning(
                f"the arm service is not available; the arm stays where it is, preset {preset!r} was not sent",
                throttle_duration_sec=30.0,
            )
            return False
        self._call(SetArmPreset.Request(name=preset), lambda response: self._on_answer(preset, response))
        return True

    def _on_answer(self, preset: str, response: Any) -> None:
        if not response.success:
            self._log.warning(f"arm preset {preset!r}: {response.message}")


class MapSource:
    """The robot's pose and the newest map. A map is stored when it is received, and converted when it is used."""

    def __init__(self, node: LupinNode, config: MissionConfig) -> None:
        self._node, self._config = node, config
        self._robot = PolledTransform(node, config.frame_id, config.base_frame)
        self._message: Any = None
        self._number = 0
        self._newest: tuple[int, GridMap] | None = None

    def robot_pose(self) -> Pose2 | None:
        """Return the robot's pose in the map frame; None if a transform is missing or older than STALE_TRANSFORM_S."""
        found = self._robot.lookup()
        if found is None or found[1] > STALE_TRANSFORM_S:
            return None
        return found[0].to_pose2()

    def on_map(self, message: Any) -> None:
        """Keep the newest map message; `map` converts it."""
        self._message = message

    def map(self) -> tuple[int, GridMap] | None:
        """Return the number of valid maps received and the newest one; None before the first."""
        if self._message is not None:
            message, self._message = self._message, None
            grid = grid_map(message)
            if grid is None:
                self._node.get_logger().warning(
                    f"{self._config.map_topic}: {message.info.width} x {message.info.height} cells announced,"
                    f" {len(message.data)} found; this map is ignored",
                    throttle_duration_sec=10.0,
                )
            else:
                self._number += 1
                self._newest = (self._number, grid)
        return self._newest
