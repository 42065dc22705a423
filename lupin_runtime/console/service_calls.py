"""Calls of the graph's services for clients."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.task import Future

from lupin_runtime.console import interfaces, values
from lupin_runtime.console.cdr import Format, decoder

READY_S = 1.0  # how long a service that the graph does not list yet is waited for
TIMEOUT_S = 5.0
_POLL_S = 0.02

Done = Callable[[bool, Any], None]  # whether it succeeded, and the response's values or the reason as text


class ServiceCalls:
    """All methods are called on the thread of the node's executor. One ROS client per service serves all clients."""

    def __init__(self, node: Node, now: values.Now) -> None:
        self._node = node
        self._now = now
        self._group = ReentrantCallbackGroup()
        self._clients: dict[tuple[str, str], Client] = {}
        self._last: dict[str, Client] = {}  # by the service's name
        self._waiting: dict[int, tuple[float, Callable[[], bool], Callable[[], None]]] = {}
        self._number = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # a stopped /clock must not stop a timeout
        self._poll = node.create_timer(_POLL_S, self._check_waiting, callback_group=self._group, clock=steady)
        self._poll.cancel()

    def call(self, service: str, arguments: Any, timeout_s: float, done: Done) -> None:
        """Call a service; `done` is called once, on the executor's thread, at the latest after READY_S and `timeout_s`.

        `arguments` is a dict, or a list in the order of the request's fields. A timeout of 0 or less means none.
        """
        name = service if service.startswith("/") else f"/{service}"

        def start() -> bool:
            client = self._client(name)
            if client is None:
                return False
            self._send(client, arguments, timeout_s, done)
            return True

        if not start():
            self._wait(time.monotonic() + READY_S, start, lambda: done(False, f"Service {name} does not exist"))

    def _client(self, name: str) -> Client | None:
        """The client of a service whose server is there, or None."""
        last = self._last.get(name)
        if last is not None and last.service_is_ready():
            return last  # listing all services of a large graph takes longer than the call
        kinds = dict(self._node.get_service_names_and_types()).get(name)
        if not kinds:
            return None
        key = (name, kinds[0])
        client = self._clients.get(key)
        if client is None:
            try:
                service_class = interfaces.find(kinds[0], "srv")
            except interfaces.UnknownType:
                return None
            client = self._clients[key] = self._node.create_client(service_class, name, callback_group=self._group)
        self._last[name] = client
        return client if client.service_is_ready() else None

    def _send(self, client: Client, arguments: Any, timeout_s: float, done: Done) -> None:
        request_class = client.srv_type.Request
        try:
            request = values.fill(request_class, values.by_name(request_class, arguments), self._now)
        except values.ValueMismatch as error:
            done(False, str(error))
            return
        decode = decoder(client.srv_type.Response, Format.JSON)
        future = client.call_async(request)
        number = self._number = self._number + 1

        def finish(answered: Future) -> None:
            self._waiting.pop(number, None)
            if answered.cancelled():
                done(False, "Timeout exceeded while waiting for service response")
            elif answered.exception() is not None:
                done(False, f"Service call exception: {answered.exception()}")
            else:
                response = answered.result()
                done(True, decode(serialize_message(response)))

        def give_up() -> None:
            client.remove_pending_request(future)
            future.cancel()

        future.add_done_callback(finish)
        if timeout_s > 0:
            self._wait(time.monotonic() + timeout_s, future.done, give_up, number)

    def _wait(
        self, deadline_s: float, over: Callable[[], bool], give_up: Callable[[], None], number: int | None = None
    ) -> None:
        if number is None:
            number = self._number = self._number + 1
        if not self._waiting:
            self._poll.reset()
        self._waiting[number] = (deadline_s, over, give_up)

    def _check_waiting(self) -> None:
        now_s = time.monotonic()
        for number, (deadline_s, over, give_up) in list(self._waiting.items()):
            if over():
                self._waiting.pop(number, None)
            elif now_s >= deadline_s:
                self._waiting.pop(number, None)
                give_up()
        if not self._waiting:
            self._poll.cancel()
