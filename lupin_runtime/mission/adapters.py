"""The ports of the mission on the graph: navigation's action, the services, the transforms, the map."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal
from lupin_msgs.srv import ConfirmTag, GetTagReading, SetArmPreset
from nav2_msgs.action import NavigateToPose

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2, yaw_from_quaternion
from lupin_runtime.gridmap import GridMap
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.messages import goal_message, grid_map, reading
from lupin_runtime.mission.place import Place
from lupin_runtime.mission.ports import STATUS_UNKNOWN, Confirmation, Reading
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.node import interface

STALE_TRANSFORM_S = 2.0
# The clock is looked at ten times a second; a longer step is a stalled process or a clock that was set.
LONGEST_STEP_S = 2.0

# What an answer does on its way in: the node serialises it with everything else and publishes what has changed.
Guard = Callable[[Callable[[], None]], None]


class NodeClock:
    """Time of the node. A clock that is set while a mission runs neither expires its waits nor holds them up: what passes
    between two looks counts from nothing to LONGEST_STEP_S."""

    def __init__(self, node: LupinNode) -> None:
        self._node = node
        self._elapsed_ns = 0
        self._looked_ns: int | None = None

    def now_s(self) -> float:
        """Seconds for time-outs; never less than before."""
        now_ns = self._node.elapsed_clock_ns()
        if self._looked_ns is not None:
            self._elapsed_ns += min(max(now_ns - self._looked_ns, 0), int(LONGEST_STEP_S * 1e9))
        self._looked_ns = now_ns
        return self._elapsed_ns / 1e9

    def stamp_ns(self) -> int:
        """ROS time."""
        return self._node.now_ns()


def blind_codes() -> frozenset[int]:
    """The error codes by which navigation says that its senses failed: transforms that stop, a costmap that gets no scans.
    Releases of nav2_msgs before Jazzy have none."""
    names = {"FollowPath": ("TF_ERROR", "CONTROLLER_TIMED_OUT"), "ComputePathToPose": ("TF_ERROR",)}
    results = {action: interface(f"nav2_msgs/action/{action}").Result for action in names}
    found = (getattr(results[action], name, None) for action, constants in names.items() for name in constants)
    return frozenset(int(code) for code in found if code is not None)


class NavigationClient:
    """navigate_to_pose. `listener` has `goal_accepted`, `goal_feedback`, `goal_rejected` and `goal_finished`."""

    def __init__(self, node: LupinNode, config: MissionConfig, guard: Guard) -> None:
        self._node, self._config, self._guard = node, config, guard
        row = replace(graph.NAVIGATE_TO_POSE, name=config.nav_action_name)
        self._client = node.action_client(row)
        self._cancel_all = node.create_client(CancelGoal, f"{row.name}/_action/cancel_goal")
        self._handles: dict[int, Any] = {}
        self._blind_codes = blind_codes()
        self.listener: Any = None

    def is_ready(self) -> bool:
        """Whether the action server is there."""
        return bool(self._client.server_is_ready())

    def send(self, token: int, pose: Pose2) -> None:
        """Send a goal."""
        goal = NavigateToPose.Goal()
        goal.pose = goal_message(pose, self._node.now_ns(), self._config.frame_id)
        try:
            future = self._client.send_goal_async(goal, lambda _: self._guard(lambda: self.listener.goal_feedback(token)))
        except (RuntimeError, ValueError, TypeError) as error:  # rclpy: the context is going down, or a number is not finite
            self.listener.goal_rejected(token, f"send_goal_exception: {error}")
            return
        future.add_done_callback(lambda done: self._guard(lambda: self._answered(token, done)))

    def _answered(self, token: int, future: Any) -> None:
        error = future.exception()
        handle = None if error is not None else future.result()
        if handle is None or not handle.accepted:
            self.listener.goal_rejected(token, f"send_goal_exception: {error}" if error is not None else "nav_rejected")
            return
        self._handles[token] = handle
        result = handle.get_result_async()
        result.add_done_callback(lambda done: self._guard(lambda: self._finished(token, done)))
        self.listener.goal_accepted(token)

    def _finished(self, token: int, future: Any) -> None:
        self._handles.pop(token, None)
        known = future.exception() is None and future.result() is not None
        status = int(future.result().status) if known else STATUS_UNKNOWN
        code = int(getattr(future.result().result, "error_code", 0)) if known else 0
        self.listener.goal_finished(token, status, code in self._blind_codes)

    def cancel(self, token: int) -> None:
        """Ask for the end of a goal."""
        handle = self._handles.get(token)
        if handle is not None:
            handle.cancel_goal_async()

    def cancel_all(self) -> None:
        """Ask for the end of every goal: a zero id and a zero stamp mean all (action_msgs/CancelGoal)."""
        if self._cancel_all.service_is_ready():
            self._cancel_all.call_async(CancelGoal.Request(goal_info=GoalInfo()))


class _ServicePort:
    """A service that is asked without waiting. An answer that never comes is forgotten with the next question."""

    def __init__(self, node: LupinNode, row: graph.Service, guard: Guard) -> None:
        self._client = node.client(row)
        self._guard = guard
        self._asked: list[Any] = []

    def is_ready(self) -> bool:
        """Whether the service is there."""
        return bool(self._client.service_is_ready())

    def _ask(self, request: Any, answer: Callable[[Any], None]) -> None:
        self._asked = [future for future in self._asked if not future.done()]
        while len(self._asked) >= 32:
            self._client.remove_pending_request(self._asked.pop(0))
        future = self._client.call_async(request)
        self._asked.append(future)

        def answered(done: Any) -> None:
            if done.exception() is None and done.result() is not None:
                self._guard(lambda: answer(done.result()))

        future.add_done_callback(answered)


class GreenhouseClient(_ServicePort):
    """The climate bridge."""

    def read(self, tag_id: str, done: Callable[[Reading], None]) -> None:
        """Ask for a tag's readings."""
        self._ask(GetTagReading.Request(tag_id=tag_id), lambda response: done(reading(response)))


class GateClient(_ServicePort):
    """The visual gate."""

    def confirm(self, tag_id: str, done: Callable[[Confirmation], None]) -> None:
        """Ask for a tag."""
        self._ask(
            ConfirmTag.Request(expected_tag_id=tag_id),
            lambda response: done(Confirmation(bool(response.detected), response.error_message)),
        )


class ArmClient(_ServicePort):
    """The arm's presets."""

    def __init__(self, node: LupinNode, row: graph.Service, guard: Guard) -> None:
        super().__init__(node, row, guard)
        self._log = node.get_logger()

    def strike(self, preset: str) -> bool:
        """Send the arm to a preset."""
        if not self.is_ready():
            self._log.warning(f"no arm to strike {preset!r}", throttle_duration_sec=30.0)
            return False
        self._ask(SetArmPreset.Request(name=preset), lambda response: self._answered(preset, response))
        return True

    def _answered(self, preset: str, response: Any) -> None:
        if not response.success:
            self._log.warning(f"arm preset {preset!r}: {response.message}")


class RobotWorld:
    """Where the robot is, and the newest map. A map is only stored when it comes; it is read when somebody asks."""

    def __init__(self, node: LupinNode, config: MissionConfig) -> None:
        self._node, self._config = node, config
        self._place = Place(node, config.frame_id, config.base_frame)
        self._message: Any = None
        self._number = 0
        self._newest: tuple[int, GridMap] | None = None

    def robot_pose(self) -> Pose2 | None:
        """The robot in the map frame; None where the transforms do not tell, or have stopped coming."""
        found = self._place.look()
        if found is None or found[1] > STALE_TRANSFORM_S:
            return None
        x, y, _ = found[0].translation
        return Pose2(x, y, yaw_from_quaternion(*found[0].rotation))

    def heard_map(self, message: Any) -> None:
        """Keep a map."""
        self._message = message

    def map(self) -> tuple[int, GridMap] | None:
        """The newest map that can be read, and its number."""
        if self._message is not None:
            message, self._message = self._message, None
            grid = grid_map(message)
            if grid is None:
                self._node.get_logger().warning(
                    f"{self._config.map_topic}: {message.info.width} x {message.info.height} cells announced,"
                    f" {len(message.data)} found; this map is not used",
                    throttle_duration_sec=10.0,
                )
            else:
                self._number += 1
                self._newest = (self._number, grid)
        return self._newest
