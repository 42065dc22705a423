"""The action servers of navigation and planning on one single-threaded executor.

rclpy runs an execute callback to its end on the executor's thread. Here it is a coroutine that awaits a future, so that goals,
cancellations and timers are served while a goal is active; the control loop sets the future.

Every goal is accepted, as by Nav2: a goal that cannot be used is aborted at once, since only a result has room for the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse
from rclpy.task import Future

from lupin_runtime import graph
from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.decision import Failure, Progress
from lupin_runtime.navigation.messages import duration_message, path_message
from lupin_runtime.navigation.plan_worker import PlanRequest
from lupin_runtime.navigation.planning import NoPath
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.plane_messages import plane_pose_message

# Converts a pose of any known frame to the map frame; raises UnusableGoal if it cannot.
Locate = Callable[[PoseStamped], Pose2]


class UnusableGoal(ValueError):
    """A goal that is rejected: a pose that cannot be brought to the map frame, or none. `failure` is its result's error."""

    def __init__(self, failure: Failure, reason: str) -> None:
        super().__init__(reason)
        self.failure = failure


def error_number(failure: Failure) -> int:
    """Return the number of a failure in the installed nav2_msgs."""
    action, constant = failure.value.split(".")
    return int(getattr(interface(f"nav2_msgs/action/{action}").Result, constant))


def result_message(action: graph.Action, failure: Failure | None, reason: str) -> Any:
    """Build an action's result; releases before Jazzy have no error code, and most releases no message."""
    result = interface(action.type).Result()
    if failure is not None and hasattr(result, "error_code"):
        result.error_code = error_number(failure)
    if hasattr(result, "error_msg"):
        result.error_msg = reason
    return result


@dataclass
class _Session:
    action: graph.Action
    handle: Any
    done: Future


class NavigationServer:
    """The servers of both navigation actions, with one active goal at a time.

    A new goal of either action ends the active one as ABORTED, as Nav2's action server does on preemption.
    """

    def __init__(
        self,
        node: LupinNode,
        locate: Locate,
        start: Callable[[Sequence[Pose2]], None],
        stop: Callable[[], None],
    ) -> None:
        self._node = node
        self._locate = locate
        self._start = start
        self._stop = stop
        self._session: _Session | None = None
        self._futures: dict[bytes, Future] = {}
        self._servers = [self._serve(action) for action in (graph.NAVIGATE_TO_POSE, graph.NAVIGATE_THROUGH_POSES)]

    @property
    def active(self) -> bool:
        """Whether a goal is active."""
        return self._session is not None

    @property
    def cancel_requested(self) -> bool:
        """Whether the client has asked to cancel the active goal."""
        return self._session is not None and bool(self._session.handle.is_cancel_requested)

    def finish(self, failure: Failure | None, reason: str = "") -> None:
        """End the active goal: CANCELED if that was requested, else SUCCEEDED or ABORTED."""
        session, self._session = self._session, None
        if session is not None:
            self._conclude(session, failure, reason)

    @staticmethod
    def _conclude(session: _Session, failure: Failure | None, reason: str) -> None:
        if session.handle.is_cancel_requested:
            session.handle.canceled()
        elif failure is None and not reason:
            session.handle.succeed()
        else:
            session.handle.abort()
        session.done.set_result(result_message(session.action, failure, reason))

    def feedback(self, pose: Pose2, progress: Progress) -> None:
        """Publish the progress to the client."""
        session = self._session
        if session is None or not session.handle.is_active:
            return
        message = interface(session.action.type).Feedback()
        message.current_pose = plane_pose_message(pose, self._node.now_ns(), graph.MAP_FRAME)
        message.navigation_time = duration_message(progress.navigation_time_s)
        message.estimated_time_remaining = duration_message(progress.estimated_time_remaining_s)
        message.number_of_recoveries = progress.recoveries
        # Unknown before the first plan; Nav2 publishes 0 then.
        finite = progress.distance_remaining_m < 1e6
        message.distance_remaining = progress.distance_remaining_m if finite else 0.0
        if hasattr(message, "number_of_poses_remaining"):
            message.number_of_poses_remaining = progress.poses_remaining
        session.handle.publish_feedback(message)

    def close(self) -> None:
        """Abort the active goal."""
        self.finish(None, "navigation is shutting down")

    def _serve(self, action: graph.Action) -> ActionServer:
        return ActionServer(
            self._node,
            interface(action.type),
            action.name,
            execute_callback=self._execute,
            handle_accepted_callback=lambda handle: self._accept(action, handle),
            cancel_callback=self._cancel,
        )

    def _poses(self, action: graph.Action, goal: Any) -> list[Pose2]:
        messages = [goal.pose] if action is graph.NAVIGATE_TO_POSE else list(goal.poses)
        if not messages:
            raise UnusableGoal(Failure.NO_POSES, "the goal has no poses")
        return [self._locate(message) for message in messages]

    def _accept(self, action: graph.Action, handle: Any) -> None:
        session = _Session(action, handle, Future())
        self._futures[bytes(handle.goal_id.uuid)] = session.done
        handle.execute()
        try:
            poses = self._poses(action, handle.request)
        except UnusableGoal as error:  # the active goal goes on
            self._node.get_logger().error(f"{action.name} rejected, {error.failure.name}: {error}")
            self._conclude(session, error.failure, str(error))
            return
        if handle.request.behavior_tree:
            self._node.get_logger().warning(f"behavior tree {handle.request.behavior_tree!r} ignored: the built-in one is used")
        self.finish(None, "a newer goal has replaced this one")
        self._session = session
        self._start(poses)

    def _cancel(self, handle: Any) -> CancelResponse:
        if self._session is not None and handle is self._session.handle:
            self._stop()
        return CancelResponse.ACCEPT

    async def _execute(self, handle: Any) -> Any:
        key = bytes(handle.goal_id.uuid)
        result = await self._futures[key]
        del self._futures[key]
        return result


@dataclass
class _PathGoal:
    handle: Any
    request: PlanRequest
    done: Future
    yaw: float
    since_s: float


class PathServer:
    """The server of compute_path_to_pose: plans a path without driving it."""

    def __init__(
        self,
        node: LupinNode,
        locate: Locate,
        robot_pose: Callable[[], Pose2 | None],
        submit: Callable[[Pose2, Sequence[Pose2], Pose2 | None], PlanRequest],
        now_s: Callable[[], float],
        timeout_s: float = 5.0,
    ) -> None:
        self._node = node
        self._locate = locate
        self._robot_pose = robot_pose
        self._submit = submit
        self._now_s = now_s
        self._timeout_s = timeout_s
        self._goals: list[_PathGoal] = []
        self._futures: dict[bytes, Future] = {}
        self._server = ActionServer(
            node,
            interface(graph.COMPUTE_PATH_TO_POSE.type),
            graph.COMPUTE_PATH_TO_POSE.name,
            execute_callback=self._execute,
            handle_accepted_callback=self._accept,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def poll(self) -> None:
        """Pass the planner's answers to the clients; call it every control cycle."""
        now_s = self._now_s()
        for goal in list(self._goals):
            answer = goal.request.answer
            late = now_s - goal.since_s > self._timeout_s
            if goal.handle.is_cancel_requested:
                goal.request.abandoned = True
                self._end(goal, goal.handle.canceled, None, "cancelled")
            elif isinstance(answer, NoPath):
                self._end(goal, goal.handle.abort, Failure[answer.failure.name], str(answer))
            elif answer is not None:
                result = result_message(graph.COMPUTE_PATH_TO_POSE, None, "")
                result.path = path_message(answer.points, goal.yaw, self._node.now_ns())
                result.planning_time = duration_message(goal.request.planning_time_s)
                self._goals.remove(goal)
                goal.handle.succeed()
                goal.done.set_result(result)
            elif late:
                goal.request.abandoned = True
                reason = f"no plan within {self._timeout_s:.0f} s; is there a map on {graph.MAP.name}?"
                self._end(goal, goal.handle.abort, Failure.PLANNING_TIMED_OUT, reason)

    def close(self) -> None:
        """Abort the waiting goals."""
        for goal in list(self._goals):
            self._end(goal, goal.handle.abort, None, "navigation is shutting down")

    def _end(self, goal: _PathGoal, transition: Callable[[], None], failure: Failure | None, reason: str) -> None:
        self._goals.remove(goal)
        transition()
        goal.done.set_result(result_message(graph.COMPUTE_PATH_TO_POSE, failure, reason))

    def _ends(self, request: Any) -> tuple[Pose2, Pose2]:
        """Return the start and the goal of a request, in the map frame."""
        goal = self._locate(request.goal)
        start = self._locate(request.start) if request.use_start else self._robot_pose()
        if start is None:
            raise UnusableGoal(Failure.NO_POSE, f"no transform {graph.MAP_FRAME} -> {graph.BASE_FRAME}")
        return start, goal

    def _accept(self, handle: Any) -> None:
        done = self._futures[bytes(handle.goal_id.uuid)] = Future()
        handle.execute()
        try:
            start, goal = self._ends(handle.request)
        except UnusableGoal as error:
            self._node.get_logger().error(f"{graph.COMPUTE_PATH_TO_POSE.name} rejected, {error.failure.name}: {error}")
            handle.abort()
            done.set_result(result_message(graph.COMPUTE_PATH_TO_POSE, error.failure, str(error)))
            return
        request = self._submit(start, (goal,), self._robot_pose())
        self._goals.append(_PathGoal(handle, request, done, goal.yaw, self._now_s()))

    async def _execute(self, handle: Any) -> Any:
        key = bytes(handle.goal_id.uuid)
        result = await self._futures[key]
        del self._futures[key]
        return result
