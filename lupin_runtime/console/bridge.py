"""What all clients share: topics, services, actions, the lease and the stop, between the event loop and the graph.

Methods are called on the event loop. What touches the graph is handed to the executor's thread, in the order of the calls, and
reports its failures to the client as `status`.
"""

from __future__ import annotations

import json
import math
import os
import socket
import time
import traceback
from collections.abc import Callable, Hashable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, Protocol

from geometry_msgs.msg import Twist
from rclpy.clock import Clock, ClockType
from std_msgs.msg import String

from lupin_runtime import graph
from lupin_runtime.console import values
from lupin_runtime.console.authority import Authority, Refused, Session
from lupin_runtime.console.goals import ActionClientPool, GoalSender
from lupin_runtime.console.providers import ActionProvider, ServiceProvider
from lupin_runtime.console.publisher_pool import PublisherPool
from lupin_runtime.console.rosapi import RosApi
from lupin_runtime.console.service_calls import TIMEOUT_S, ServiceCalls
from lupin_runtime.console.stop_registry import StopRegistry
from lupin_runtime.console.subscription import Request
from lupin_runtime.console.topic_hub import Receiver, TopicHub
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.ros_thread import RosThread

STOP_PERIOD_S = 0.5
_UPKEEP_S = 0.5
# Requests of one client that wait for the executor; the server reads no more from a client that has more.
MAX_WAITING = 200

Done = Callable[[bool, Any], None]


class Client(Receiver, Hashable, Protocol):
    """A client, as the bridge sees it. Its methods may be called on any thread."""

    session: Session

    def answer(self, message: dict[str, Any]) -> None:
        """Queue a message of the protocol."""

    def status(self, level: str, text: str, identifier: Any = None) -> None:
        """Report what has no answer."""


@dataclass
class _OnGraph:
    """What a client has on the graph. Its requests are counted on the event loop, and as handled on the executor's thread."""

    services: ServiceProvider
    actions: ActionProvider
    goals: GoalSender
    requested: int = 0
    handled: int = 0


class ServiceFailed(RuntimeError):
    """A service that did not answer, with the reason as text."""


class Bridge:
    """Shared by all clients. Its node must be spun by a single-threaded executor."""

    def __init__(
        self,
        node: LupinNode,
        authority: Authority,
        distribution: str,
        unregister_after_s: float,
        record: Callable[..., None],
    ) -> None:
        """`record` is CommandJournal.record, or does as it does."""
        self.authority = authority
        self.record = record
        authority.on_change(self._end_driving)
        self._node = node
        self._ros = RosThread(node)
        self._clients: dict[Client, _OnGraph] = {}
        self._stops = StopRegistry()
        self._server = f"{socket.gethostname()} {os.getpid()} {time.time_ns()}"
        self._releases = 0
        now = node.get_clock().now
        self._now: values.Now = lambda: now().to_msg()
        self._topics = TopicHub(node)
        self._publishers = PublisherPool(node, unregister_after_s)
        self._services = ServiceCalls(node, self._now)
        self._action_clients = ActionClientPool(node)
        self._rosapi = RosApi(node, distribution)
        self._stop_output = node.publisher(graph.CONSOLE_STOP)
        self._manual_output = node.publisher(graph.CMD_VEL_MANUAL)
        # Steady time: a stopped /clock must not keep subscriptions from following their publishers.
        node.create_timer(_UPKEEP_S, self._keep_up, clock=Clock(clock_type=ClockType.STEADY_TIME))

    # -- clients ------------------------------------------------------------------------------------------------------
    def join(self, client: Client) -> None:
        """Add a client."""
        self._clients[client] = _OnGraph(
            ServiceProvider(self._node, client.answer, self._now),
            ActionProvider(self._node, client.answer, self._now),
            GoalSender(self._node, client.answer, self._now, self._action_clients),
        )
        self._stops.join(client, client.session.name)

    def leave(self, client: Client) -> None:
        """Remove a client and all that it has on the graph. The wheels stop if it was driving."""
        own = self._clients.pop(client, None)
        if own is None:
            return
        now_ns = time.monotonic_ns()
        in_control = self.authority.holds(client.session, now_ns)
        driving = self._stops.leave(client, now_ns, in_control)
        if driving:
            self._send_zero()
            self.record(client.session.name, "lost while driving")
        self.state_combined_stop()
        if not any(each.session is client.session for each in self._clients):
            self.authority.give_up(client.session, now_ns)

        def clean_up() -> None:
            # Goals first: they move the robot.
            own.goals.close()
            own.services.close()
            own.actions.close()
            self._topics.leave(client)
            self._publishers.leave(client)

        self._ros.run(clean_up).add_done_callback(self._log_failure)

    def overloaded(self, client: Client) -> bool:
        """Whether so many of a client's requests wait that no more should be read from it."""
        own = self._clients.get(client)
        return own is not None and own.requested - own.handled >= MAX_WAITING

    def log_request(self, session: Session, level: str, text: str) -> None:
        """Log what the protocol does not answer."""
        if level == "error":
            self._node.get_logger().warning(f"{session.name}: {text[:500]}", throttle_duration_sec=1.0)

    def _run(self, client: Client, operation: str, function: Callable[[], Any], identifier: Hashable | None = None) -> None:
        own = self._clients[client]
        own.requested += 1

        def finished(future: Future[Any]) -> None:
            own.handled += 1
            error = future.exception()
            if isinstance(error, ValueError):
                client.status("error", f"{operation}: {error}", identifier)
            else:
                self._log_failure(future)

        self._ros.run(function).add_done_callback(finished)

    def _log_failure(self, future: Future[Any]) -> None:
        """Log a defect of the server: what a client can cause is a ValueError."""
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
        """End a client's subscription of that id, or all of its own to the topic."""
        self._run(client, "unsubscribe", lambda: self._topics.unsubscribe(client, topic, identifier))

    def advertise(self, client: Client, topic: str, type_name: str, identifier: Hashable, latch: bool, queue_size: int) -> None:
        """Announce that a client publishes on a topic."""

        def advertise() -> None:
            self._publishers.advertise(client, topic, type_name, identifier, latch, queue_size)

        self._run(client, "advertise", advertise, identifier)

    def unadvertise(self, client: Client, topic: str, identifier: Hashable | None) -> None:
        """End an advertisement."""
        self._run(client, "unadvertise", lambda: self._publishers.unadvertise(client, topic, identifier))

    def publish(
        self,
        client: Client,
        topic: str,
        type_name: str | None,
        identifier: Hashable,
        contents: Any,
        latch: bool,
        queue_size: int,
    ) -> None:
        """Publish a message of a client; a topic that it has not advertised is advertised first."""

        def publish() -> None:
            message_class, publisher = self._publishers.advertise(client, topic, type_name, identifier, latch, queue_size)
            publisher.publish(values.fill(message_class, contents, self._now))

        self._run(client, "publish", publish, identifier)

    # -- services and actions -----------------------------------------------------------------------------------------
    def call_service(self, client: Client, service: str, arguments: Any, timeout_s: float | None, done: Done) -> None:
        """Call a service for a client; `done` is called once, on any thread."""
        if service.lstrip("/").startswith("rosapi/"):
            self._call_rosapi(client, "/" + service.lstrip("/"), arguments, done)
            return
        limit_s = TIMEOUT_S if timeout_s is None or not math.isfinite(timeout_s) else float(timeout_s)
        self._run(client, "call_service", lambda: self._services.call(service, arguments, limit_s, done))

    def request_service(self, session: Session, service: str, arguments: dict[str, Any]) -> Future[Any]:
        """Call a service for a request of the API. Raises Refused; the future gets the response or a ServiceFailed."""
        self.authority.call(session, service, time.monotonic_ns())
        answered: Future[Any] = Future()

        def done(succeeded: bool, response: Any) -> None:
            if succeeded:
                answered.set_result(response)
            else:
                answered.set_exception(ServiceFailed(str(response)))

        self._ros.run(lambda: self._services.call(service, arguments, TIMEOUT_S, done)).add_done_callback(self._log_failure)
        return answered

    def _call_rosapi(self, client: Client, service: str, arguments: Any, done: Done) -> None:
        def call() -> None:
            try:
                self._rosapi.call(service, arguments, lambda response: done(True, response))
            except ValueError as error:
                done(False, str(error))

        self._run(client, "call_service", call)

    def services_of(self, client: Client, function: Callable[[ServiceProvider], None]) -> None:
        """Run a function with the services that a client provides."""
        own = self._clients[client]
        self._run(client, "service", lambda: function(own.services))

    def actions_of(self, client: Client, function: Callable[[ActionProvider], None]) -> None:
        """Run a function with the actions that a client provides."""
        own = self._clients[client]
        self._run(client, "action", lambda: function(own.actions))

    def goals_of(self, client: Client, function: Callable[[GoalSender], None]) -> None:
        """Run a function with the goals that a client has sent."""
        own = self._clients[client]
        self._run(client, "goal", lambda: function(own.goals))

    # -- driving and stopping -----------------------------------------------------------------------------------------
    def note_velocity(self, client: Client, moving: bool) -> None:
        """Note that a client commands a velocity."""
        if self._stops.velocity(client, moving, time.monotonic_ns()):
            self.record(client.session.name, "drive")
            self.state_combined_stop()

    def state_stop(self, client: Client, engaged: bool) -> None:
        """A client's own stop. Raises Refused for a release without control; the stop then stays, though the client let go."""
        now_ns = time.monotonic_ns()
        changes = engaged != self._stops.holds(client)
        if changes:
            self.record(client.session.name, "stop" if engaged else "release")
        if changes and not engaged:
            try:
                self.authority.take(client.session, now_ns)
            except Refused:
                self._stops.withdraw(client, now_ns)
                raise
            self._release()
        self._stops.state(client, engaged, now_ns)
        self.authority.seen(client.session, now_ns)
        if changes:
            self.state_combined_stop()

    def stop_for(self, session: Session) -> None:
        """Stop for a session that states no stop of its own over a connection; the client in control releases it."""
        self.record(session.name, "stop")
        self._stops.hold_for(session.name)
        self.state_combined_stop()

    def release_for(self, session: Session) -> list[str]:
        """Release what no client holds any more; returns who still holds the stop. Raises Refused without control."""
        self.authority.take(session, time.monotonic_ns())
        self.record(session.name, "release")
        self._release()
        self.state_combined_stop()
        return self.stop_reasons()

    def stop_reasons(self) -> list[str]:
        """Why the consoles engage the stop; empty where they do not."""
        return self._stops.reasons()

    def _release(self) -> None:
        """End what no client holds any more, here and where another server of the console has gone."""
        self._releases += 1
        self._stops.release_lost()

    def _end_driving(self) -> None:
        """Who drove with control that another session has now is at rest before that one begins."""
        if self._stops.end_driving(time.monotonic_ns()):
            self._send_zero()

    def _send_zero(self) -> None:
        self._ros.run(lambda: self._manual_output.publish(Twist())).add_done_callback(self._log_failure)

    def state_combined_stop(self) -> None:
        """Publish the stop of all clients together. To be called every STOP_PERIOD_S."""
        now_ns = time.monotonic_ns()
        self._stops.tick(now_ns, self.authority.lease(now_ns).holder)
        statement = {
            "server": self._server,
            "engaged": bool(self._stops.reasons()),
            "driving": self._stops.is_driving(now_ns),
            "releases": self._releases,
        }
        text = json.dumps(statement)
        self._ros.run(lambda: self._stop_output.publish(String(data=text))).add_done_callback(self._log_failure)

    def _keep_up(self) -> None:
        self._topics.follow_publishers()
        self._publishers.close_unused()
