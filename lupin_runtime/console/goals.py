"""Goals that clients send to actions of the graph."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.validate_topic_name import validate_topic_name

from lupin_runtime.console.command_era import Refusal, always_valid
from lupin_runtime.console.providers import (
    STEADY,
    RequestFailed,
    Send,
    find_interface,
    request_errors,
    ros_clock,
    to_values,
)
from lupin_runtime.console.values import Now, by_name, fill
from lupin_runtime.ros.sent_goal import SentGoal

SERVER_TIMEOUT_S = 1.0
MAX_GOALS = 100  # of one client that have not ended yet
_POLL_S = 0.02
_WATCH_PERIOD_S = 0.5
CANCEL_REPEAT_S = 1.0
CANCEL_TIMEOUT_S = 30.0  # after it, the goal of a disconnected client is given up

_ENDED = (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED, GoalStatus.STATUS_ABORTED)
_NOT_CANCELED = (CancelGoal.Response.ERROR_NONE, CancelGoal.Response.ERROR_REJECTED)


class OrderedActionClient(ActionClient):
    """An action client that delivers all feedback on a goal before its result.

    rclpy takes only one feedback message in each turn; once it has taken the result, it drops the feedback still waiting.
    """

    def take_data(self) -> dict[str, Any]:
        """Take what has arrived; together with a result, all waiting feedback."""
        taken: dict[str, Any] = super().take_data()
        if "result" in taken:
            taken["earlier feedback"] = list(iter(self._take_feedback, None))
        return taken

    def _take_feedback(self) -> Any:
        return self._client_handle.take_feedback(self._action_type.Impl.FeedbackMessage)

    async def execute(self, taken_data: dict[str, Any]) -> None:
        """Handle the taken data: all feedback, then the result."""
        feedback, result = taken_data.pop("earlier feedback", []), taken_data.pop("result", None)
        await super().execute(taken_data)
        for message in feedback:
            await super().execute({"feedback": message})
        if result is not None:
            await super().execute({"result": result})


class ActionClientPool:
    """The action clients of a node: one per action and type, kept while a goal uses it."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._clients: dict[tuple[str, Any], tuple[OrderedActionClient, int]] = {}  # with the number of users

    def acquire(self, action: str, action_class: Any) -> OrderedActionClient:
        """Return the client of an action; call `release` once for each call. Raises ValueError for an invalid name."""
        client, users = self._clients.get((action, action_class), (None, 0))
        if client is None:
            client = OrderedActionClient(self._node, action_class, action, callback_group=ReentrantCallbackGroup())
        self._clients[action, action_class] = client, users + 1
        return client

    def release(self, action: str, action_class: Any) -> None:
        """End one use of a client; the last one destroys it."""
        client, users = self._clients[action, action_class]
        if users > 1:
            self._clients[action, action_class] = client, users - 1
        else:
            del self._clients[action, action_class]
            client.destroy()


@dataclass(frozen=True)
class _Request:
    """A client's goal; without an `identifier` the client cannot cancel it. `refusal` is asked until it is sent."""

    identifier: Any
    action: str
    action_class: Any
    goal: Any
    feedback: bool
    refusal: Refusal


class _Goal:
    """One goal, from the wait for its server to its result. `on_end` is called once, after the result was sent."""

    def __init__(
        self, node: Node, clients: ActionClientPool, send: Send, on_end: Callable[[_Goal], None], request: _Request
    ) -> None:
        self.request = request
        self._node = node
        self._clients = clients
        self._send = send
        self._on_end = on_end
        self._server_deadline_s = time.monotonic() + SERVER_TIMEOUT_S
        self._poll: Timer | None = None  # runs while no server is available
        self._watch: Timer | None = None  # runs once the goal has been sent
        self._sent: SentGoal | None = None
        self._accepted = False  # whether the server is known to have accepted it
        self._servers: set[bytes] = set()  # the servers that may have accepted the goal
        self._cancel_deadline_s: float | None = None  # until when the cancel request is repeated; None: it is not due
        self._cancel_sent_s = 0.0
        self._abandoned = False
        self._ended = False
        self._client = clients.acquire(request.action, request.action_class)

    def start(self) -> None:
        """Send the goal as soon as a server is available."""
        if not self._send_goal():
            group = ReentrantCallbackGroup()
            self._poll = self._node.create_timer(_POLL_S, self._look_for_server, callback_group=group, clock=STEADY)

    def cancel(self) -> None:
        """Cancel the goal. A goal that was not sent yet ends as canceled.

        The request is sent at once, on acceptance, and repeated until it is answered: both answers can be lost, and it may have
        overtaken the goal.
        """
        if self._sent is None:
            self._end_with_result(self.request.action_class.Result(), GoalStatus.STATUS_CANCELED)
            return
        self._cancel_deadline_s = time.monotonic() + CANCEL_TIMEOUT_S
        self._send_cancel(self._sent)

    def abandon(self) -> None:
        """Cancel the goal of a client that has disconnected."""
        self._abandoned = True
        self.cancel()

    # -- to the server ------------------------------------------------------------------------------------------------
    def _look_for_server(self) -> None:
        if self._send_goal():
            self._stop_poll()
        elif time.monotonic() >= self._server_deadline_s:
            self._fail("No action server available")

    def _send_goal(self) -> bool:
        if reason := self.request.refusal():
            self._fail(reason)
            return True
        if not self._client.server_is_ready():
            return False
        on_feedback = self._on_feedback if self.request.feedback else None
        self._servers = self._present_servers()
        self._sent = SentGoal(self._client, self.request.action_class, self.request.goal, on_feedback)
        self._sent.answer.add_done_callback(self._on_response)
        group = ReentrantCallbackGroup()
        self._watch = self._node.create_timer(_WATCH_PERIOD_S, self._on_watch, callback_group=group, clock=STEADY)
        return True

    def _on_watch(self) -> None:
        self._watch_server()
        if not self._ended:
            self._repeat_cancel()

    def _send_cancel(self, sent: SentGoal) -> None:
        self._cancel_sent_s = time.monotonic()
        sent.handle.cancel_goal_async().add_done_callback(self._on_cancel_response)

    def _repeat_cancel(self) -> None:
        now_s = time.monotonic()
        if self._cancel_deadline_s is None or self._sent is None or now_s - self._cancel_sent_s < CANCEL_REPEAT_S:
            return
        if now_s < self._cancel_deadline_s:
            self._send_cancel(self._sent)
            return
        self._cancel_deadline_s = None
        goal, action = self.request.identifier, self.request.action
        self._warn(f"{action} did not confirm within {CANCEL_TIMEOUT_S:g} s that goal {goal} is canceled")
        if self._abandoned:
            self._end()

    def _watch_server(self) -> None:
        """Fail the goal if its server is gone: a server that replaces it does not know the goal and would never answer."""
        present = self._present_servers()
        if not self._servers:
            self._servers = present
        elif not self._servers & present:
            self._fail("The action server has gone")

    def _present_servers(self) -> set[bytes]:
        publishers = self._node.get_publishers_info_by_topic(f"{self.request.action}/_action/status")
        return {bytes(publisher.endpoint_gid) for publisher in publishers}

    def _stop_poll(self) -> None:
        if self._poll is not None:
            self._node.destroy_timer(self._poll)
            self._poll = None

    # -- from the server ----------------------------------------------------------------------------------------------
    def _on_response(self, future: Future) -> None:
        handle = future.result()
        if not handle.accepted:
            self._fail("Action goal was rejected")
            return
        self._request_result(handle)
        if self._cancel_deadline_s is not None and self._sent is not None:
            self._send_cancel(self._sent)

    def _request_result(self, handle: ClientGoalHandle) -> None:
        if not self._accepted:
            self._accepted = True
            handle.get_result_async().add_done_callback(self._on_result)

    def _on_feedback(self, message: Any) -> None:
        if not self._ended:
            self._reply("action_feedback", values=to_values(message.feedback))

    def _on_result(self, future: Future) -> None:
        response = future.result()
        if response.status in _ENDED:
            self._end_with_result(response.result, response.status)
        else:
            self._fail("The action server does not know the goal any more")

    def _on_cancel_response(self, future: Future) -> None:
        response = future.result()
        if response.return_code == CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID:
            return  # the request has overtaken the goal, and is repeated
        self._cancel_deadline_s = None
        if not response.goals_canceling and response.return_code in _NOT_CANCELED:
            self._warn(f"{self.request.action} refused to cancel goal {self.request.identifier}, which continues")
        if self._abandoned:
            self._end()
        elif response.goals_canceling and self._sent is not None:
            self._request_result(self._sent.handle)  # the goal is accepted, also if that answer was lost

    # -- to the client ------------------------------------------------------------------------------------------------
    def _fail(self, reason: str) -> None:
        self._warn(f"send_action_goal to '{self.request.action}' failed: {reason}")
        self._end(values=reason, status=GoalStatus.STATUS_UNKNOWN, result=False)

    def _end_with_result(self, result: Any, status: int) -> None:
        self._end(values=to_values(result), status=status, result=True)

    def _end(self, **outcome: Any) -> None:
        if self._ended:
            return
        self._ended = True
        self._stop_poll()
        if self._watch is not None:
            self._node.destroy_timer(self._watch)
        self._reply("action_result", **outcome)
        self._clients.release(self.request.action, self.request.action_class)
        self._on_end(self)

    def _reply(self, operation: str, **fields: Any) -> None:
        if not self._abandoned:
            self._send(_message(self.request.identifier, self.request.action, operation, **fields))

    def _warn(self, text: str) -> None:
        self._node.get_logger().warning(text)


class GoalSender:
    """The goals that one client sends. All methods are called on the executor's thread.

    The client gets exactly one `action_result` per goal, after the goal's feedback. `now` returns the time for stamps and for
    times whose value is "now" [the node's clock]. `clients` may be shared by all senders of a node.
    """

    def __init__(self, node: Node, send: Send, now: Now | None = None, clients: ActionClientPool | None = None) -> None:
        self._node = node
        self._send = send
        self._now = now or ros_clock(node)
        self._clients = clients or ActionClientPool(node)
        self._goals: list[_Goal] = []
        self._closed = False

    def send_goal(
        self,
        identifier: Any,
        action: str,
        action_type: str,
        args: Any,
        feedback: bool,
        refusal: Refusal = always_valid,
    ) -> None:
        """Send a goal; `args` is a dict, or a list in the order of the goal's fields. A reason of `refusal` is its result.

        Raises RequestFailed for an invalid action, type or argument, after sending the reason to the client as the result.
        """
        if self._closed:
            raise RequestFailed("the client has disconnected")
        try:
            if len(self._goals) >= MAX_GOALS:
                raise RequestFailed(f"a client may have {MAX_GOALS} goals; wait for the end of others, or cancel them")
            with request_errors():
                action_class = find_interface(action_type, "action", "Result", "Feedback")
                validate_topic_name(action)
                message = fill(action_class.Goal, by_name(action_class.Goal, args), self._now)
                request = _Request(identifier, action, action_class, message, feedback, refusal)
                goal = _Goal(self._node, self._clients, self._send, self._goals.remove, request)
        except RequestFailed as error:
            outcome = {"values": str(error), "status": GoalStatus.STATUS_UNKNOWN, "result": False}
            self._send(_message(identifier, action, "action_result", **outcome))
            raise
        self._goals.append(goal)
        goal.start()

    def cancel(self, identifier: Any) -> None:
        """Cancel a goal by its id; its result follows. Unknown ids are ignored; goals without an id cannot be canceled."""
        for goal in list(self._goals):
            if identifier is not None and goal.request.identifier == identifier:
                goal.cancel()

    def close(self) -> None:
        """Cancel all goals, because the client has disconnected: the robot must not keep driving for it."""
        self._closed = True
        for goal in list(self._goals):
            goal.abandon()


def _message(identifier: Any, action: str, operation: str, **fields: Any) -> dict[str, Any]:
    """Build a message to the client about a goal; it contains the id only if the client gave one."""
    message = {"op": operation, "action": action, **fields}
    return message if identifier is None else {**message, "id": identifier}
