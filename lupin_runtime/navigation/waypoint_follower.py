"""The node `waypoint_follower`: drives to poses one after the other and stops at each, as Nav2's node of that name."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from action_msgs.msg import GoalStatus
from nav2_msgs.action import FollowWaypoints, NavigateToPose
from nav2_msgs.msg import MissedWaypoint
from rclpy.action import ActionServer, CancelResponse
from rclpy.task import Future

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.sent_goal import SentGoal
from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED
from lupin_runtime.safety.estop_subscription import subscribe_estop

_NONE, _UNKNOWN = FollowWaypoints.Result.NONE, FollowWaypoints.Result.UNKNOWN
_PERIOD_S = 0.05
CANCEL_REPEAT_S = 1.0
CANCEL_TIMEOUT_S = 5.0


class _Drive:
    """A goal of navigate_to_pose. `result` is None until the goal is known to be accepted."""

    def __init__(self, sent: SentGoal) -> None:
        self._sent = sent
        self.result: Future | None = None
        sent.answer.add_done_callback(lambda _: self._request_result())  # navigate_to_pose accepts every goal

    @property
    def ended(self) -> bool:
        """Whether its result has arrived."""
        return self.result is not None and self.result.done()

    def cancel(self) -> None:
        """Request its cancellation; the answer shows that it was accepted, also if that answer was lost."""
        self._sent.handle.cancel_goal_async().add_done_callback(
            lambda done: self._request_result() if done.result().goals_canceling else None
        )

    def _request_result(self) -> None:
        if self.result is None:
            self.result = self._sent.handle.get_result_async()


@dataclass
class _Session:
    """A goal of follow_waypoints, with the drive that serves it now. `replaced` still drives, until the first one is sent."""

    handle: Any
    done: Future
    index: int
    loops_left: int
    replaced: _Drive | None = None
    drive: _Drive | None = None
    resume_ns: int = 0
    cancel_since_ns: int | None = None
    cancel_sent_ns: int = 0
    stopped: bool = False  # whether the e-stop was engaged since the goal was accepted
    missed: list[MissedWaypoint] = field(default_factory=list)


class WaypointFollower(LupinNode):
    """Sends the poses to navigate_to_pose, of which it is one client among others.

    A waypoint that is not reached ends the goal, also if another client's goal has replaced it: the next waypoint would take
    the robot from that client. This is Nav2's default, `stop_on_failure`. The e-stop ends the goal too, also between two
    waypoints, when navigate_to_pose has no goal to abort: a release must not send the next one.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("waypoint_follower", parameters)
        self._pause_ns = int(self.parameter("waypoint_pause_duration", 200)) * 1_000_000  # parameter in ms, as in Nav2
        self._session: _Session | None = None
        self._futures: dict[bytes, Future] = {}
        self._client = self.action_client(graph.NAVIGATE_TO_POSE)
        self._server = ActionServer(
            self,
            FollowWaypoints,
            graph.FOLLOW_WAYPOINTS.name,
            execute_callback=self._execute,
            handle_accepted_callback=self._accept,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        subscribe_estop(self, self._on_estop)
        self._timer = self.create_timer(_PERIOD_S, self._advance)
        self._timer.cancel()  # it runs only while a goal is active

    def _accept(self, handle: Any) -> None:
        done = self._futures[bytes(handle.goal_id.uuid)] = Future()
        handle.execute()
        goal = handle.request
        if goal.goal_index >= len(goal.poses):
            reason = f"goal_index is {goal.goal_index} of {len(goal.poses)} poses" if goal.poses else "the goal has no poses"
            self.get_logger().error(f"{graph.FOLLOW_WAYPOINTS.name} rejected: {reason}")
            handle.abort()
            done.set_result(FollowWaypoints.Result(error_code=_UNKNOWN, error_msg=reason))
            return
        # The first waypoint replaces the drive of the replaced session; until then a cancel must reach that drive.
        old = self._session
        self._abort("a newer goal has replaced this one")
        replaced = None if old is None else old.drive or old.replaced
        self._session = _Session(handle, done, goal.goal_index, goal.number_of_loops, replaced)
        self._timer.reset()

    def _on_estop(self, engaged: bool) -> None:
        if self._session is not None:
            self._session.stopped |= engaged

    def _advance(self) -> None:
        session = self._session
        if session is None:
            self._timer.cancel()
            return
        if session.handle.is_cancel_requested:
            self._cancel(session)
        elif session.drive is None and session.stopped:
            self._abort(ESTOP_ENGAGED)
        elif session.drive is None:
            self._send(session)
        elif session.drive.result is not None and session.drive.ended:
            self._take_answer(session, session.drive.result.result())

    def _send(self, session: _Session) -> None:
        if self.elapsed_clock_ns() < session.resume_ns or not self._client.server_is_ready():
            return
        goal = NavigateToPose.Goal(pose=session.handle.request.poses[session.index])
        session.drive, session.replaced = _Drive(SentGoal(self._client, NavigateToPose, goal)), None
        session.handle.publish_feedback(FollowWaypoints.Feedback(current_waypoint=session.index))

    def _take_answer(self, session: _Session, answer: Any) -> None:
        session.drive = None
        poses = session.handle.request.poses
        if answer.status != GoalStatus.STATUS_SUCCEEDED:
            code, reason = answer.result.error_code, answer.result.error_msg or "its goal was cancelled"
            session.missed.append(MissedWaypoint(index=session.index, goal=poses[session.index], error_code=code))
            self._abort(f"waypoint {session.index} was not reached: {reason}")
            return
        session.resume_ns = self.elapsed_clock_ns() + self._pause_ns
        session.index += 1
        if session.index < len(poses):
            return
        if session.loops_left == 0:
            self._session = None
            session.handle.succeed()
            session.done.set_result(FollowWaypoints.Result(error_code=_NONE))
            return
        session.loops_left -= 1
        session.index = 0

    def _cancel(self, session: _Session) -> None:
        """Cancel the goal of navigate_to_pose; this one ends when that one has ended."""
        drive, now_ns = session.drive or session.replaced, self.elapsed_clock_ns()
        if drive is not None and not drive.ended:
            if session.cancel_since_ns is None or now_ns - session.cancel_sent_ns >= CANCEL_REPEAT_S * 1e9:
                session.cancel_since_ns = now_ns if session.cancel_since_ns is None else session.cancel_since_ns
                session.cancel_sent_ns = now_ns
                drive.cancel()
            if now_ns - session.cancel_since_ns >= CANCEL_TIMEOUT_S * 1e9:
                self._abort(f"{graph.NAVIGATE_TO_POSE.name} did not end within {CANCEL_TIMEOUT_S:g} s of the cancellation")
            return
        self._session = None
        session.handle.canceled()
        session.done.set_result(FollowWaypoints.Result(error_code=_NONE, error_msg="cancelled"))

    def _abort(self, reason: str) -> None:
        session, self._session = self._session, None
        if session is None:
            return
        self.get_logger().error(f"{graph.FOLLOW_WAYPOINTS.name} aborted: {reason}")
        session.handle.abort()
        result = FollowWaypoints.Result(missed_waypoints=session.missed, error_code=_UNKNOWN, error_msg=reason)
        session.done.set_result(result)

    async def _execute(self, handle: Any) -> Any:
        key = bytes(handle.goal_id.uuid)
        result = await self._futures[key]
        del self._futures[key]
        return result

    def before_shutdown(self) -> None:
        """Give the client a result."""
        self._abort("navigation is shutting down")
