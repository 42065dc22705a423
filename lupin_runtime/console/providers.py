"""Services and actions that clients advertise: requests and goals of the graph go to the client, its answers to the graph.

A client may answer late, in any order, wrongly or never. Every request gets a response and every goal a result all the same,
since a callback that raises would end the executor.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.task import Future
from rclpy.timer import Timer
from rclpy.validate_topic_name import validate_topic_name

from lupin_runtime.console.cdr import Format, decoder
from lupin_runtime.console.values import Now, fill
from lupin_runtime.ros import type_names

ANSWER_TIMEOUT_S = 60.0  # a service request that the client has not answered after this time gets an empty response
MAX_ADVERTISED = 100  # services, and as many actions, that one client may offer
DESTROY_DELAY_S = 1.0  # an action server is kept this long after its last goal, so that callers can fetch the result

Send = Callable[[dict[str, Any]], None]  # queues a message for the client; thread-safe, never raises

# Clients are not part of the simulation, so they are waited for in real time.
STEADY = Clock(clock_type=ClockType.STEADY_TIME)


class RequestFailed(ValueError):
    """A client's request that cannot be carried out. The text is the protocol's if it defines one."""


@contextmanager
def request_errors() -> Iterator[None]:
    """Turn the errors of an invalid type, name or value that a client has sent into RequestFailed."""
    try:
        yield
    except NameValidationException as error:
        raise RequestFailed(" ".join(str(error).split("\n")[:2])) from error  # without the line that marks the character
    except (type_names.UnknownType, ValueError) as error:
        raise RequestFailed(str(error)) from error


def find_interface(type_name: str, kind: str, *parts: str) -> Any:
    """Return the class of a client's type. Raises UnknownType, or UnsupportedType if clients cannot be sent one of `parts`."""
    found: Any = type_names.find(type_name, kind)
    for part in parts:
        decoder(getattr(found, part), Format.JSON)
    return found


def to_values(message: Any) -> dict[str, Any]:
    """Convert a message to values for JSON."""
    message_class: Any = type(message)
    return decoder(message_class, Format.JSON)(serialize_message(message))


def ros_clock(node: Node) -> Now:
    """Return a function that returns the current ROS time as a message."""
    clock = node.get_clock()
    return lambda: clock.now().to_msg()


def call_later(node: Node, delay_s: float, callback: Callable[[], None]) -> Timer:
    """Call a function once, after `delay_s` of real time; pass the timer to `node.destroy_timer` to cancel it."""

    def fire() -> None:
        node.destroy_timer(timer)
        callback()

    # The timer needs its own group: the node's default group is busy while one of its callbacks awaits something.
    timer = node.create_timer(delay_s, fire, callback_group=ReentrantCallbackGroup(), clock=STEADY)
    return timer


class _AdvertisedService:
    """The ROS server of one advertised service, with its running requests."""

    def __init__(self, node: Node, send: Send, now: Now, name: str, service_class: Any) -> None:
        self._node = node
        self._send = send
        self._now = now
        self._name = name
        self._class = service_class
        self._answers: dict[str, Future] = {}  # by request id
        self._requests = 0
        self._running = 0
        self._closed = False
        group = ReentrantCallbackGroup()  # several requests may run at once
        self._server = node.create_service(service_class, name, self._handle, callback_group=group)

    async def _handle(self, request: Any, empty: Any) -> Any:
        if self._closed:
            return empty
        self._requests += 1
        identifier = f"service_request:{self._name}:{self._requests}"
        answer = self._answers[identifier] = Future()
        timeout = call_later(self._node, ANSWER_TIMEOUT_S, lambda: self._expire(identifier))
        self._running += 1
        self._send({"op": "call_service", "id": identifier, "service": self._name, "args": to_values(request)})
        response = await answer
        self._running -= 1
        self._node.destroy_timer(timeout)
        if self._closed and not self._running:
            # Not at once: rclpy sends the response after this callback and needs the server for it.
            self._node.executor.create_task(self._node.destroy_service, self._server)
        return empty if response is None else response

    def respond(self, identifier: str, values: Any, result: bool) -> None:
        """Finish a request with the client's answer.

        Raises RequestFailed for an unknown id, and for values that do not fit, after sending the caller an empty response.
        """
        answer = self._answers.pop(identifier, None)
        if answer is None:
            raise RequestFailed(f"Received service response for unrecognized id: {identifier}")
        response = None
        try:
            if result:
                with request_errors():
                    response = fill(self._class.Response, values, self._now)
            else:
                reason = f": {values[:200]}" if isinstance(values, str) else ""
                self._warn(f"{identifier} failed at the client{reason}; its caller gets an empty response")
        finally:
            answer.set_result(response)

    def close(self) -> None:
        """Finish all requests with an empty response, and destroy the server."""
        self._closed = True
        if self._answers:
            self._warn(f"{self._name} was unadvertised; callers get an empty response to {', '.join(self._answers)}")
        for answer in self._answers.values():
            answer.set_result(None)
        self._answers.clear()
        if not self._running:
            self._node.destroy_service(self._server)

    def _expire(self, identifier: str) -> None:
        answer = self._answers.pop(identifier, None)
        if answer is not None:
            self._warn(f"no answer to {identifier} within {ANSWER_TIMEOUT_S:g} s; its caller gets an empty response")
            answer.set_result(None)

    def _warn(self, text: str) -> None:
        self._node.get_logger().warning(text)


class ServiceProvider:
    """The services that one client advertises. All methods are called on the executor's thread and may raise RequestFailed.

    `now` returns the time for stamps and for times whose value is "now" [the node's clock].
    """

    def __init__(self, node: Node, send: Send, now: Now | None = None) -> None:
        self._node = node
        self._send = send
        self._now = now or ros_clock(node)
        self._services: dict[str, _AdvertisedService] = {}
        self._closed = False

    def advertise(self, service: str, type_name: str) -> None:
        """Offer a service on the graph, replacing an earlier one of the client with this name."""
        _check_not_closed(self._closed)
        _check_count(service, self._services)
        with request_errors():
            service_class = find_interface(type_name, "srv", "Request")
            validate_topic_name(service, is_service=True)
            if service in self._services:
                self._services.pop(service).close()
            self._services[service] = _AdvertisedService(self._node, self._send, self._now, service, service_class)

    def respond(self, service: str, identifier: str, values: Any, result: bool) -> None:
        """Answer a request. Its caller gets an empty response if `result` is false or the values do not fit."""
        if service not in self._services:
            raise RequestFailed(f"Service {service} has not been advertised via rosbridge.")
        self._services[service].respond(identifier, values, result)

    def unadvertise(self, service: str) -> None:
        """Withdraw a service; running requests get an empty response."""
        if service not in self._services:
            raise RequestFailed(f"Service {service} has not been advertised via rosbridge, can't unadvertise.")
        self._services.pop(service).close()

    def close(self) -> None:
        """Withdraw all services, because the client has disconnected."""
        self._closed = True
        while self._services:
            self._services.popitem()[1].close()


class _AdvertisedAction:
    """The ROS server of one advertised action, with its running goals."""

    def __init__(self, node: Node, send: Send, now: Now, name: str, type_name: str, action_class: Any) -> None:
        self._node = node
        self._send = send
        self._now = now
        self._name = name
        self._type_name = type_name
        self._class = action_class
        self._goals: dict[str, Any] = {}  # the handles of running goals, by the client's id for them
        self._results: dict[bytes, Future] = {}  # by the goal's UUID
        self._accepted_count = 0
        self._last_end_s: float | None = None  # when the last goal ended
        self._closed = False
        self._server = ActionServer(
            node,
            action_class,
            name,
            execute_callback=self._execute,
            callback_group=ReentrantCallbackGroup(),
            goal_callback=self._judge,
            handle_accepted_callback=self._accept,
            cancel_callback=self._cancel,
        )

    # -- called by the graph ------------------------------------------------------------------------------------------
    def _judge(self, _goal: Any) -> GoalResponse:
        return GoalResponse.REJECT if self._closed else GoalResponse.ACCEPT

    def _accept(self, handle: Any) -> None:
        self._accepted_count += 1
        identifier = f"action_goal:{self._name}:{self._accepted_count}"
        self._goals[identifier] = handle
        self._results[bytes(handle.goal_id.uuid)] = Future()
        handle.execute()
        self._send(
            {
                "op": "send_action_goal",
                "id": identifier,
                "action": self._name,
                "action_type": self._type_name,
                "args": to_values(handle.request),
                "feedback": True,
            }
        )

    async def _execute(self, handle: Any) -> Any:
        uuid = bytes(handle.goal_id.uuid)
        result = await self._results[uuid]
        del self._results[uuid]
        return result

    def _cancel(self, handle: Any) -> CancelResponse:
        for identifier, running in self._goals.items():
            if running is handle:
                self._send({"op": "cancel_action_goal", "id": identifier, "action": self._name})
        return CancelResponse.ACCEPT

    # -- called for the client ----------------------------------------------------------------------------------------
    def feedback(self, identifier: str, values: Any) -> None:
        """Publish a client's feedback on a goal."""
        handle = self._goals.get(identifier)
        if handle is None:
            raise RequestFailed(f"Received action feedback for unrecognized id: {identifier}")
        with request_errors():
            handle.publish_feedback(fill(self._class.Feedback, values, self._now))

    def result(self, identifier: str, values: Any, status: int, result: bool) -> None:
        """Finish a goal with the client's result.

        Raises RequestFailed for an unknown id, and for a result that does not fit, after aborting the goal.
        """
        handle = self._goals.get(identifier)
        if handle is None:
            kind = "result" if result else "abort request"
            raise RequestFailed(f"Received action {kind} for unrecognized id: {identifier}")
        transition, outcome = handle.abort, None
        try:
            if result:
                with request_errors():
                    outcome = fill(self._class.Result, values, self._now)
                if status == GoalStatus.STATUS_SUCCEEDED:
                    transition = handle.succeed
                elif status == GoalStatus.STATUS_CANCELED:
                    if not handle.is_cancel_requested:
                        raise RequestFailed(f"{identifier} was aborted: it cannot end as canceled, because nobody canceled it")
                    transition = handle.canceled
        finally:
            self._end(identifier, transition, outcome)

    def close(self) -> None:
        """Abort all goals, reject new ones, and destroy the server once callers have had time to fetch the results."""
        self._closed = True
        if self._goals:
            self._node.get_logger().warning(f"{self._name} was unadvertised; aborted: {', '.join(self._goals)}")
        for identifier, handle in list(self._goals.items()):
            self._end(identifier, handle.abort, None)
        if self._last_end_s is None or time.monotonic() - self._last_end_s >= DESTROY_DELAY_S:
            self._server.destroy()
        else:
            call_later(self._node, DESTROY_DELAY_S, self._server.destroy)

    def _end(self, identifier: str, transition: Callable[[], None], outcome: Any) -> None:
        handle = self._goals.pop(identifier)
        transition()
        self._last_end_s = time.monotonic()
        self._results[bytes(handle.goal_id.uuid)].set_result(self._class.Result() if outcome is None else outcome)


class ActionProvider:
    """The actions that one client advertises. All methods are called on the executor's thread and may raise RequestFailed.

    `now` returns the time for stamps and for times whose value is "now" [the node's clock].
    """

    def __init__(self, node: Node, send: Send, now: Now | None = None) -> None:
        self._node = node
        self._send = send
        self._now = now or ros_clock(node)
        self._actions: dict[str, _AdvertisedAction] = {}
        self._closed = False

    def advertise(self, action: str, type_name: str) -> None:
        """Offer an action on the graph, replacing an earlier one of the client with this name."""
        _check_not_closed(self._closed)
        _check_count(action, self._actions)
        with request_errors():
            action_class = find_interface(type_name, "action", "Goal")
            validate_topic_name(action)
            if action in self._actions:
                self._actions.pop(action).close()
            self._actions[action] = _AdvertisedAction(self._node, self._send, self._now, action, type_name, action_class)

    def feedback(self, action: str, identifier: str, values: Any) -> None:
        """Publish feedback on a goal."""
        self._advertised(action).feedback(identifier, values)

    def result(self, action: str, identifier: str, values: Any, status: int | None, result: bool) -> None:
        """Finish a goal: succeeded for status 4 or None, canceled for 5, otherwise aborted.

        If `result` is false or the values do not fit, the goal is aborted with an empty result.
        """
        self._advertised(action).result(identifier, values, GoalStatus.STATUS_SUCCEEDED if status is None else status, result)

    def unadvertise(self, action: str) -> None:
        """Withdraw an action; running goals are aborted."""
        if action not in self._actions:
            raise RequestFailed(f"Action {action} has not been advertised via rosbridge, can't unadvertise.")
        self._actions.pop(action).close()

    def close(self) -> None:
        """Withdraw all actions, because the client has disconnected."""
        self._closed = True
        while self._actions:
            self._actions.popitem()[1].close()

    def _advertised(self, action: str) -> _AdvertisedAction:
        if action not in self._actions:
            raise RequestFailed(f"Action {action} has not been advertised via rosbridge.")
        return self._actions[action]


def _check_count(name: str, advertised: Collection[str]) -> None:
    if name not in advertised and len(advertised) >= MAX_ADVERTISED:
        raise RequestFailed(f"{name}: a client may advertise {MAX_ADVERTISED} of these; unadvertise others first")


def _check_not_closed(closed: bool) -> None:
    if closed:
        raise RequestFailed("the client has disconnected")
