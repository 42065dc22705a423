"""Connects the clients to the graph: topics, services, actions, and by way of `ManualControl` velocities and the stop.

Methods are called on the event loop. Work on the graph is passed to the executor's thread, in the order of the calls; its
errors are reported to the client as `status`.
"""

from __future__ import annotations

import math
import traceback
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from rclpy.clock import Clock, ClockType

from lupin_runtime import graph
from lupin_runtime.console import values
from lupin_runtime.console.authority import Authority, Session
from lupin_runtime.console.command_era import CommandEra, Refusal, always_valid
from lupin_runtime.console.estop_reasons import EstopReasons
from lupin_runtime.console.goals import ActionClientPool, GoalSender
from lupin_runtime.console.manual_control import ManualControl
from lupin_runtime.console.motion_watch import MotionWatch
from lupin_runtime.console.providers import ActionProvider, ServiceProvider
from lupin_runtime.console.publisher_pool import PublisherPool
from lupin_runtime.console.rosapi import RosApi
from lupin_runtime.console.run_history import RunHistory
from lupin_runtime.console.service_calls import TIMEOUT_S, ServiceCalls
from lupin_runtime.console.subscription import Request
from lupin_runtime.console.topic_hub import Receiver, TopicHub
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.ros_thread import RosThread
from lupin_runtime.ros.type_names import absolute

_UPKEEP_S = 0.5
# How many requests of one client may wait for the executor; beyond that the server reads nothing more from the client.
MAX_WAITING = 200

Done = Callable[[bool, Any], None]
_Result = TypeVar("_Result")


class Client(Receiver, Hashable, Protocol):
    """A client of the bridge. Its methods may be called on any thread."""

    session: Session

    def answer(self, message: dict[str, Any]) -> None:
        """Queue a message of the protocol."""

    def status(self, level: str, text: str, identifier: Any = None) -> None:
        """Report an error of a request to which the protocol has no answer."""


@dataclass
class _GraphResources:
    """What a client has on the graph. `requested` is counted on the event loop, `handled` on the executor's thread."""

    services: ServiceProvider
    actions: ActionProvider
    goals: GoalSender
    requested: int = 0
    handled: int = 0


class ServiceFailed(RuntimeError):
    """A service call that failed; the text is the reason."""


class Bridge:
    """The one bridge of all clients. Its node must be spun by a single-threaded executor."""

    def __init__(
        self,
        node: LupinNode,
        authority: Authority,
        distribution: str,
        unregister_after_s: float,
        record: Callable[..., None],
        history: RunHistory,
    ) -> None:
        """`record` has the signature of CommandJournal.record. `history` gets every change of a stop, once it was published."""
        self.authority = authority
        self.record = record
        self.history = history
        self._node = node
        self._ros = RosThread(node)
        self._clients: dict[Client, _GraphResources] = {}
        self._estop = EstopReasons(node)
        self._motion = MotionWatch(node)
        self._era = CommandEra(lambda: self._estop.changes)
        now = node.get_clock().now
        self._now: values.Now = lambda: now().to_msg()
        self.manual = ManualControl(node, authority, self._estop, self._era, record, history, self._now)
        self._topics = TopicHub(node)
        self._publishers = PublisherPool(node, unregister_after_s)
        self._services = ServiceCalls(node, self._now)
        self._action_clients = ActionClientPool(node)
        self._rosapi = RosApi(node, distribution)
        # Steady time: a stopped /clock must not keep subscriptions from following their publishers.
        node.create_timer(_UPKEEP_S, self._maintain, clock=Clock(clock_type=ClockType.STEADY_TIME))

    # -- clients ------------------------------------------------------------------------------------------------------
    def join(self, client: Client) -> None:
        """Add a client."""
        self._clients[client] = _GraphResources(
            ServiceProvider(self._node, client.answer, self._now),
            ActionProvider(self._node, client.answer, self._now),
            GoalSender(self._node, client.answer, self._now, self._action_clients),
        )
        self.manual.join(client)

    def leave(self, client: Client) -> None:
        """Remove a client and everything that it has on the graph. If it was driving, zero velocity is sent."""
        resources = self._clients.pop(client, None)
        if resources is None:
            return
        self.manual.leave(client)

        def clean_up() -> None:
            with ExitStack() as steps:  # every step is carried out, whatever another one raises; the last one first
                steps.callback(self._publishers.leave, client)
                steps.callback(self._topics.leave, client)
                steps.callback(resources.actions.close)
                steps.callback(resources.services.close)
                steps.callback(resources.goals.close)  # they move the robot

        self._ros.run(clean_up).add_done_callback(self._log_failure)
        if not any(each.session is client.session for each in self._clients):
            self.authority.give_up(client.session, self._node.monotonic_ns(), left=True)

    def is_overloaded(self, client: Client) -> bool:
        """Return whether so many of a client's requests are waiting that nothing more should be read from it."""
        resources = self._clients.get(client)
        return resources is not None and resources.requested - resources.handled >= MAX_WAITING

    def log_request(self, session: Session, level: str, text: str) -> None:
        """Log an error of a client's request; other levels are not logged."""
        if level == "error":
            self._node.get_logger().warning(f"{session.name}: {text[:500]}", throttle_duration_sec=1.0)

    def _run(self, client: Client, operation: str, function: Callable[[], Any], identifier: Hashable | None = None) -> None:
        resources = self._clients[client]
        resources.requested += 1

        def finished(future: Future[Any]) -> None:
            resources.handled += 1
            error = future.exception()
            if isinstance(error, ValueError):
                client.status("error", f"{operation}: {error}", identifier)
            else:
                self._log_failure(future)

        self._ros.run(function).add_done_callback(finished)

    def _refusal(self, name: str) -> Refusal:
        """Return when a command that is sent now, by the name of its topic, service or action, must not be carried out."""
        # A pause stops something, so it is carried out however old it is.
        is_command = self.authority.needs_control(name) and absolute(name) != graph.MISSION_PAUSE.name
        return self._era.refusal() if is_command else always_valid

    def command_refusal(self) -> Refusal:
        """Return what a command that is given now must ask before it is carried out."""
        return self._era.refusal()

    def run_with_node(self, function: Callable[[LupinNode], _Result]) -> Future[_Result]:
        """Call a function on the executor's thread with the node, to add to it or to read what it has received."""
        return self._ros.run(lambda: function(self._node))

    def _log_failure(self, future: Future[Any]) -> None:
        """Log a defect of the server; errors that a client can cause are ValueErrors and handled elsewhere."""
        error = future.exception()
        if error is not None:
            self._node.get_logger().error("".join(traceback.format_exception(error)))

    # -- topics -------------------------------------------------------------------------------------------------------
    def subscribe(self, client: Client, topic: str, type_name: str | None, identifier: Hashable, request: Request) -> None:
        """Subscribe a client to a topic."""

        def subscribe() -> None:
            self._topics.subscribe(client, topic, type_name, identifier, request)

        self._run(client, "subscribe", subscribe, identifier)

    def unsubscribe(self, client: Client, topic: str, identifier: Hashable | None) -> None:
        """End a client's subscription with this id, or all of its subscriptions to the topic if the id is None."""
        self._run(client, "unsubscribe", lambda: self._topics.unsubscribe(client, topic, identifier))

    def advertise(self, client: Client, topic: str, type_name: str, identifier: Hashable, latch: bool, queue_size: int) -> None:
        """Announce that a client publishes on a topic."""

        def advertise() -> None:
            self._publishers.advertise(client, topic, type_name, identifier, latch, queue_size)

        self._run(client, "advertise", advertise, identifier)

    def unadvertise(self, client: Client, topic: str, identifier: Hashable | None) -> None:
        """End a client's advertisement with this id, or all of its advertisements of the topic if the id is None."""
        self._run(client, "unadvertise", lambda: self._publishers.unadvertise(client, topic, identifier))

    def publish(
        self,
        client: Client,
        topic: str,
        type_name: str | None,
        identifier: Hashable | None,
        contents: Any,
        latch: bool,
        queue_size: int,
    ) -> None:
        """Publish a client's message, after advertising the topic if the client has not."""
        refusal = self._refusal(topic)

        def publish() -> None:
            if reason := refusal():
                raise ValueError(reason)
            message_class, publisher = self._publishers.to_publish(client, topic, type_name, latch, queue_size)
            publisher.publish(values.fill(message_class, contents, self._now))

        self._run(client, "publish", publish, identifier)

    # -- services and actions -----------------------------------------------------------------------------------------
    def call_service(self, client: Client, service: str, arguments: Any, timeout_s: float | None, done: Done) -> None:
        """Call a service for a client; `done` is called once, on any thread."""
        if service.lstrip("/").startswith("rosapi/"):
            self._call_rosapi(client, "/" + service.lstrip("/"), arguments, done)
            return
        limit_s = TIMEOUT_S if timeout_s is None or not math.isfinite(timeout_s) else float(timeout_s)
        refusal = self._refusal(service)
        self._run(client, "call_service", lambda: self._services.call(service, arguments, limit_s, done, refusal))

    def request_service(self, session: Session, service: str, arguments: dict[str, Any]) -> Future[Any]:
        """Call a service for a request to the API. Raises Refused; the future gets the response or a ServiceFailed."""
        self.authority.check_call(session, service, self._node.monotonic_ns())
        return self.request_own_service(service, arguments)

    def request_own_service(self, service: str, arguments: dict[str, Any]) -> Future[Any]:
        """Call a service that clients may not call themselves. The future gets the response or a ServiceFailed."""
        answered: Future[Any] = Future()

        def done(succeeded: bool, response: Any) -> None:
            if succeeded:
                answered.set_result(response)
            else:
                answered.set_exception(ServiceFailed(str(response)))

        refusal = self._refusal(service)
        called = self._ros.run(lambda: self._services.call(service, arguments, TIMEOUT_S, done, refusal))
        called.add_done_callback(self._log_failure)
        return answered

    def map_refusal(self) -> str:
        """Return why the map must not be replaced now; empty if it may be."""
        return self._motion.refusal()

    def _call_rosapi(self, client: Client, service: str, arguments: Any, done: Done) -> None:
        def call() -> None:
            try:
                self._rosapi.call(service, arguments, lambda response: done(True, response))
            except ValueError as error:
                done(False, str(error))

        self._run(client, "call_service", call)

    def run_with_services(self, client: Client, function: Callable[[ServiceProvider], None]) -> None:
        """Call a function on the executor's thread with the services that a client provides."""
        resources = self._clients[client]
        self._run(client, "service", lambda: function(resources.services))

    def run_with_actions(self, client: Client, function: Callable[[ActionProvider], None]) -> None:
        """Call a function on the executor's thread with the actions that a client provides."""
        resources = self._clients[client]
        self._run(client, "action", lambda: function(resources.actions))

    def send_goal(self, client: Client, identifier: Any, action: str, action_type: str, arguments: Any, feedback: bool) -> None:
        """Send a client's goal."""
        goals, refusal = self._clients[client].goals, self._refusal(action)
        self._run(client, "goal", lambda: goals.send_goal(identifier, action, action_type, arguments, feedback, refusal))

    def cancel_goal(self, client: Client, identifier: Any) -> None:
        """Cancel a client's goal by its id."""
        goals = self._clients[client].goals
        self._run(client, "goal", lambda: goals.cancel(identifier))

    def _maintain(self) -> None:
        self._estop.update()
        self._motion.update()
        self._topics.follow_publishers()
        self._publishers.close_unused()
