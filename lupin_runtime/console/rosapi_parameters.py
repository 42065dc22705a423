"""Answers rosapi's parameter services by calling the parameter services of other nodes."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_parameters
from rclpy.task import Future

from lupin_runtime.console import values
from lupin_runtime.console.parameter_values import normalize_json, plain_value, typed_value

TIMEOUT_S = 5.0  # for one call of a node's service, including its discovery
MAX_CALLS = 200  # calls that may wait at the same time: a client must not pile them up on a node that hangs
_POLL_S = 0.02
_STEADY = Clock(clock_type=ClockType.STEADY_TIME)

Done = Callable[[dict[str, Any]], None]  # called with the fields of the response
OnFailure = Callable[[str], None]  # called with the reason


@dataclass(eq=False)
class _Call:
    """A call of a node's service; `future` is None until the request has been sent."""

    service: str
    request: Any
    deadline_s: float
    on_answer: Callable[[Any], None]
    on_failure: OnFailure
    future: Future | None = None


def served_services(node: Node) -> list[tuple[str, list[str]]]:
    """Return names and types of the services that have a server: the graph also lists those that only have clients."""
    return [(name, kinds) for name, kinds in node.get_service_names_and_types() if node.count_services(name)]


class RosApiParameters:
    """All methods are called on the executor's thread, and so is `done`, once per call.

    A parameter's name is `/node:parameter`. The ROS client of a node's service exists only while a call uses it.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._now: values.Now = lambda: node.get_clock().now().to_msg()
        self._group = ReentrantCallbackGroup()
        self._clients: dict[str, Client] = {}
        self._calls: list[_Call] = []
        self._poll = node.create_timer(_POLL_S, self._check_calls, callback_group=self._group, clock=_STEADY)
        self._poll.cancel()

    # -- rosapi's services --------------------------------------------------------------------------------------------
    def get_param(self, name: str, default: str, done: Done) -> None:
        """Read a parameter as JSON text; if that fails, the value is the default, which is JSON text too."""

        def on_failure(reason: str) -> None:
            done({"value": normalize_json(default), "successful": False, "reason": reason})

        def on_value(value: ParameterValue | None) -> None:
            if value is None:
                on_failure(f"Parameter {name.partition(':')[2]} not found")
            else:
                done({"value": json.dumps(plain_value(value)), "successful": True, "reason": ""})

        self._get(name, on_value, on_failure)

    def has_param(self, name: str, done: Done) -> None:
        """Find out whether a parameter is set."""
        self._get(name, lambda value: done({"exists": value is not None}), lambda _: done({"exists": False}))

    def set_param(self, name: str, text: str, done: Done) -> None:
        """Set a parameter to a value given as JSON text."""
        try:
            value = typed_value(text)
        except ValueError as error:
            done({"successful": False, "reason": f'a parameter\'s value must be JSON text, such as 0.5 or "fast": {error}'})
        else:
            self._set(name, value, done)

    def delete_param(self, name: str, done: Done) -> None:
        """Unset a parameter; succeeds if it is not set."""

        def on_value(value: ParameterValue | None) -> None:
            if value is None:
                done({"successful": True, "reason": ""})
            else:
                self._set(name, {"type": ParameterType.PARAMETER_NOT_SET}, done)

        self._get(name, on_value, lambda reason: done({"successful": False, "reason": reason}))

    def get_param_names(self, nodes: Sequence[str], done: Done) -> None:
        """List the parameters of those nodes that have parameter services and answer."""
        available = self._available_services()
        asked = [node for node in nodes if f"{node}/list_parameters" in available]
        found: dict[str, list[str]] = {}

        def add(node: str, names: list[str]) -> None:
            found[node] = names
            if len(found) == len(asked):
                done({"names": [f"{each}:{name}" for each in asked for name in found[each]]})

        def ask(node: str) -> None:
            self._send(
                ListParameters,
                f"{node}/list_parameters",
                ListParameters.Request(),
                lambda response: add(node, list(response.result.names)),
                lambda _: add(node, []),
            )

        if not asked:
            done({"names": []})
        for node in asked:
            ask(node)

    # -- services of other nodes --------------------------------------------------------------------------------------
    def _get(self, name: str, on_value: Callable[[ParameterValue | None], None], on_failure: OnFailure) -> None:
        """Read a parameter; the value is None if it is not set."""

        def on_answer(response: Any) -> None:
            value = response.values[0] if response.values else None
            known = value is not None and ParameterType.PARAMETER_NOT_SET < value.type <= ParameterType.PARAMETER_STRING_ARRAY
            on_value(value if known else None)

        self._call(name, GetParameters, "get_parameters", lambda parameter: {"names": [parameter]}, on_answer, on_failure)

    def _set(self, name: str, value: dict[str, Any], done: Done) -> None:
        def on_failure(reason: str) -> None:
            done({"successful": False, "reason": reason})

        def on_answer(response: Any) -> None:
            if response.results:
                done({"successful": response.results[0].successful, "reason": response.results[0].reason})
            else:
                on_failure("the node answered without a result")

        def make_request(parameter: str) -> dict[str, Any]:
            return {"parameters": [{"name": parameter, "value": value}]}

        self._call(name, SetParameters, "set_parameters", make_request, on_answer, on_failure)

    def _call(
        self,
        name: str,
        service_class: Any,
        operation: str,
        make_request: Callable[[str], dict[str, Any]],
        on_answer: Callable[[Any], None],
        on_failure: OnFailure,
    ) -> None:
        """Call a parameter service of a parameter's node; `make_request` builds the request from the parameter's name in it."""
        node, _, parameter = name.partition(":")
        if not node.strip("/") or not parameter or ":" in parameter:
            on_failure(f"a parameter's name must be /node:parameter, not {name!r:.200}")
            return
        service = f"{node if node.startswith('/') else '/' + node}/{operation}"
        if service not in self._available_services():
            on_failure(f"Service {service} is not available")
            return
        try:
            message = values.fill(service_class.Request, make_request(parameter), self._now)
        except values.ValueMismatch as error:
            on_failure(str(error))
        else:
            self._send(service_class, service, message, on_answer, on_failure)

    def _available_services(self) -> set[str]:
        return {name for name, _ in served_services(self._node)}

    def _send(
        self, service_class: Any, service: str, request: Any, on_answer: Callable[[Any], None], on_failure: OnFailure
    ) -> None:
        """Call a service; either `on_answer` or `on_failure` is called once, within TIMEOUT_S."""
        if len(self._calls) >= MAX_CALLS:
            on_failure(f"{len(self._calls)} parameter calls are waiting for their nodes; call {service} again later")
            return
        if service not in self._clients:
            self._clients[service] = self._node.create_client(
                service_class, service, qos_profile=qos_profile_parameters, callback_group=self._group
            )
        if not self._calls:
            self._poll.reset()
        call = _Call(service, request, time.monotonic() + TIMEOUT_S, on_answer, on_failure)
        self._calls.append(call)
        self._send_when_ready(call)

    def _send_when_ready(self, call: _Call) -> None:
        """Send the request if the service is ready: a new client needs a moment to discover it."""
        client = self._clients[call.service]
        if call.future is None and client.service_is_ready():
            call.future = client.call_async(call.request)
            call.future.add_done_callback(lambda future: self._receive(call, future))

    def _receive(self, call: _Call, future: Future) -> None:
        if call in self._calls:  # else it has timed out in the same turn of the executor
            self._end(call)
            call.on_answer(future.result())

    def _check_calls(self) -> None:
        now_s = time.monotonic()
        for call in list(self._calls):
            self._send_when_ready(call)
            if now_s >= call.deadline_s:
                self._end(call)
                call.on_failure("Timeout occurred" if call.future else f"Service {call.service} is not available")
        if not self._calls:
            self._poll.cancel()

    def _end(self, call: _Call) -> None:
        self._calls.remove(call)
        client = self._clients[call.service]
        if call.future is not None:
            client.remove_pending_request(call.future)
        if not any(other.service == call.service for other in self._calls):
            self._node.destroy_client(self._clients.pop(call.service))
