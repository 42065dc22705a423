"""Calls services on the graph for clients."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.task import Future

from lupin_runtime.console import values
from lupin_runtime.console.cdr import Format, UnsupportedType, decoder
from lupin_runtime.console.command_era import Refusal, always_valid
from lupin_runtime.ros import type_names

DISCOVERY_TIMEOUT_S = 1.0  # for the wait until the graph lists a service
TIMEOUT_S = 5.0
MAX_CLIENTS = 100  # ROS clients; beyond that the least recently used one is destroyed
_POLL_S = 0.02

Done = Callable[[bool, Any], None]  # called with success and either the response's values or the reason as text


class ServiceCalls:
    """All methods are called on the executor's thread. All clients share one ROS client per service."""

    def __init__(self, node: Node, now: values.Now) -> None:
        self._node = node
        self._now = now
        self._group = ReentrantCallbackGroup()
        self._clients: dict[tuple[str, str], Client] = {}  # by name and type, the most recently used last
        self._last: dict[str, tuple[str, str]] = {}  # by name: the key of the client that was last used for it
        self._open: Counter[tuple[str, str]] = Counter()  # by key: requests without a response yet
        self._waiting: dict[int, tuple[float, Callable[[], bool], Callable[[], None]]] = {}
        self._number = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # a stopped /clock must not stop a timeout
        self._poll = node.create_timer(_POLL_S, self._check_waiting, callback_group=self._group, clock=steady)
        self._poll.cancel()

    def call(self, service: str, arguments: Any, timeout_s: float, done: Done, refusal: Refusal = always_valid) -> None:
        """Call a service; `done` is called once, on the executor's thread, within DISCOVERY_TIMEOUT_S + `timeout_s`.

        `arguments` is a dict, or a list in the order of the request's fields. With a timeout of 0 or less, it waits forever.
        A reason of `refusal`, which is asked until the request is sent, is the answer instead.
        """
        name = service if service.startswith("/") else f"/{service}"

        def start() -> bool:
            if reason := refusal():
                done(False, reason)
                return True
            key = self._ready(name)
            if key is None:
                return False
            self._send(key, arguments, timeout_s, done)
            return True

        def give_up() -> None:
            self._forget([key for key in self._clients if key[0] == name])
            done(False, f"Service {name} does not exist")

        if not start():
            self._wait(time.monotonic() + DISCOVERY_TIMEOUT_S, start, give_up)

    def _ready(self, name: str) -> tuple[str, str] | None:
        """Return the key of a client whose service is available; None if there is none."""
        last = self._last.get(name)
        if last is not None and self._clients[last].service_is_ready():
            self._clients[last] = self._clients.pop(last)
            return last  # without listing all services, which in a large graph takes longer than the call
        # The graph lists the types that clients use, too, including this node's own: only a client shows which one is served.
        for kind in dict(self._node.get_service_names_and_types()).get(name, ()):
            key = (name, kind)
            if self._get_or_create(key) and self._clients[key].service_is_ready():
                self._last[name] = key
                return key
        return None

    def _get_or_create(self, key: tuple[str, str]) -> bool:
        if key in self._clients:
            return True
        try:
            service_class = type_names.find(key[1], "srv")
        except type_names.UnknownType:
            return False
        if len(self._clients) >= MAX_CLIENTS:
            self._forget(list(self._clients)[: len(self._clients) - MAX_CLIENTS + 1])
        self._clients[key] = self._node.create_client(service_class, key[0], callback_group=self._group)
        return True

    def _forget(self, keys: Iterable[tuple[str, str]]) -> None:
        """Destroy those of the clients that have no open request."""
        for key in keys:
            if not self._open[key]:
                self._node.destroy_client(self._clients.pop(key))
                if self._last.get(key[0]) == key:
                    del self._last[key[0]]

    def _send(self, key: tuple[str, str], arguments: Any, timeout_s: float, done: Done) -> None:
        client = self._clients[key]
        request_class = client.srv_type.Request
        try:
            request = values.fill(request_class, values.by_name(request_class, arguments), self._now)
            decode = decoder(client.srv_type.Response, Format.JSON)
        except (values.ValueMismatch, UnsupportedType) as error:
            done(False, str(error))
            return
        future = client.call_async(request)
        self._open[key] += 1
        number = self._number = self._number + 1

        def finish(finished: Future) -> None:
            self._waiting.pop(number, None)
            self._open -= Counter([key])
            if finished.cancelled():
                done(False, "Timeout exceeded while waiting for service response")
            elif finished.exception() is not None:
                done(False, f"Service call exception: {finished.exception()}")
            else:
                response = finished.result()
                done(True, decode(serialize_message(response)))

        def give_up() -> None:
            client.remove_pending_request(future)
            future.cancel()

        future.add_done_callback(finish)
        if timeout_s > 0:
            self._wait(time.monotonic() + timeout_s, future.done, give_up, number)

    def _wait(
        self, deadline_s: float, is_done: Callable[[], bool], give_up: Callable[[], None], number: int | None = None
    ) -> None:
        if number is None:
            number = self._number = self._number + 1
        if not self._waiting:
            self._poll.reset()
        self._waiting[number] = (deadline_s, is_done, give_up)

    def _check_waiting(self) -> None:
        now_s = time.monotonic()
        for number, (deadline_s, is_done, give_up) in list(self._waiting.items()):
            if is_done():
                self._waiting.pop(number, None)
            elif now_s >= deadline_s:
                self._waiting.pop(number, None)
                give_up()
        if not self._waiting:
            self._poll.cancel()
