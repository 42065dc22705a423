"""The operations of the rosbridge protocol, version 2, for one client.

A failed request gets the protocol's answer if it defines one. Otherwise a `status` message is sent, but only to clients that
asked for those with `set_level`: clients of ROS 2's rosbridge expect no other messages.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from typing import Any

import orjson

from lupin_runtime import graph
from lupin_runtime.console.authority import READ_ONLY_PREFIX, Refused, Session
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.encoding import COMPRESSIONS, fragments, json_frame, to_json
from lupin_runtime.console.fragments import BadFragment, Defragmenter
from lupin_runtime.console.map_names import BadMapName, with_map_path
from lupin_runtime.console.outbox import Frame
from lupin_runtime.console.short_text import short_repr
from lupin_runtime.console.stop_registry import press_name
from lupin_runtime.console.subscription import Request
from lupin_runtime.console.topic_hub import type_conflict
from lupin_runtime.ros.type_names import absolute, full_name

MAX_QUEUE = 1000
LEVELS = ("none", "error", "warning", "info")
# Without substitutions (`~`, `{node}`): they would resolve to names of the console's own node and bypass the allow-list.
_NAME = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_MAX_NAME = 200
_MISSING = "Expected a {} field but none was found."
_LINEAR_MPS, _ANGULAR_RPS = 0.6, 1.9  # the drive bus has the same limits, but the console does not rely on it


class InvalidRequest(ValueError):
    """A message that violates the protocol; the text says why."""


class RosbridgeClient:
    """One client of the protocol. Its methods are called on the event loop; `deliver` may be called on any thread.

    It calls `send`, which queues a frame for the client, on any thread.
    """

    def __init__(self, session: Session, bridge: Bridge, send: Callable[[Frame], None]) -> None:
        self.session = session
        self._bridge = bridge
        self._send = send
        self._level = "none"
        self._fragment_size: int | None = None
        self._defragmenter = Defragmenter()
        self._defragmenting = False  # whether the message that is being handled came in fragments
        self._operations: dict[str, Callable[[dict[str, Any]], None]] = {
            "advertise": self._advertise,
            "unadvertise": self._unadvertise,
            "publish": self._publish,
            "subscribe": self._subscribe,
            "unsubscribe": self._unsubscribe,
            "call_service": self._call_service,
            "advertise_service": self._advertise_service,
            "unadvertise_service": self._unadvertise_service,
            "service_response": self._service_response,
            "send_action_goal": self._send_action_goal,
            "cancel_action_goal": self._cancel_action_goal,
            "advertise_action": self._advertise_action,
            "unadvertise_action": self._unadvertise_action,
            "action_feedback": self._action_feedback,
            "action_result": self._action_result,
            "set_level": self._set_level,
            "fragment": self._fragment,
        }
        bridge.join(self)

    # -- frames -------------------------------------------------------------------------------------------------------
    def deliver(self, frame: Frame) -> None:
        """Queue a frame of a topic."""
        if self._fragment_size is not None and not frame.binary and len(frame.data) > self._fragment_size:
            for part in fragments(frame.data, self._fragment_size, "0"):
                self._send(Frame(part))
        else:
            self._send(frame)

    def answer(self, message: dict[str, Any]) -> None:
        """Queue a message of the protocol."""
        try:
            data = to_json(message)
        except TypeError as error:  # called on the executor's thread, which an exception would end
            self._bridge.log_request(self.session, "error", f"an answer was not sent: {error}")
            return
        if self._fragment_size is not None and len(data) > self._fragment_size:
            for part in fragments(data, self._fragment_size, str(message.get("id", "0"))):
                self._send(Frame(part))
        else:
            self._send(json_frame(data))

    def handle(self, text: str | bytes) -> None:
        """Handle a message from the client. Never raises, whatever the message contains."""
        try:
            message = orjson.loads(text)
        except orjson.JSONDecodeError as error:
            self.status("error", f"not JSON: {error}")
            return
        if not isinstance(message, dict):
            self.status("error", f"a message must be a JSON object, not {type(message).__name__}")
            return
        identifier = message.get("id")
        if identifier is not None and not isinstance(identifier, (str, int, float)):
            # An id comes back in the answer, and a deeply nested value cannot be encoded.
            self.status("error", f"id must be text, a number, true or false, not {short_repr(identifier)}")
            return
        operation = message.get("op")
        handler = self._operations.get(operation) if isinstance(operation, str) else None
        if handler is None:
            allowed = ", ".join(self._operations)
            self.status("error", f"Unknown operation: {_shown(operation)}.  Allowed operations: {allowed}", identifier)
            return
        try:
            self._note_fragment_size(message)
            handler(message)
        except Refused as error:
            self._refuse(str(operation), message, error)
            self.status("error", f"{operation}: {error}", identifier)
        except (InvalidRequest, BadFragment) as error:
            self.status("error", f"{operation}: {error}", identifier)

    def status(self, level: str, text: str, identifier: Any = None) -> None:
        """Report to a client that asked for messages of this level."""
        self._bridge.log_request(self.session, level, text)
        if LEVELS.index(level) > LEVELS.index(self._level):
            return
        message = {"op": "status", "level": level, "msg": text}
        self.answer({**message, "id": identifier} if identifier is not None else message)

    def _refuse(self, operation: str, message: dict[str, Any], error: Refused) -> None:
        name = message.get("topic") or message.get("service") or message.get("action") or ""
        self._bridge.record(self.session.name, f"{operation} {_shown(name)}", refused=str(error))

    def close(self) -> None:
        """Remove everything that the client has set up, and stop the robot if the client was driving it."""
        self._bridge.leave(self)

    def _note_fragment_size(self, message: dict[str, Any]) -> None:
        size = message.get("fragment_size")
        if size is not None:
            if not isinstance(size, int) or isinstance(size, bool) or size < 100:
                raise InvalidRequest(f"fragment_size must be an integer of at least 100, not {short_repr(size)}")
            self._fragment_size = size

    # -- topics -------------------------------------------------------------------------------------------------------
    def _advertise(self, message: dict[str, Any]) -> None:
        topic = _name(message, "topic")
        self._bridge.authority.check_advertise(topic)
        queue_size = _number(message, "queue_size", 100, 1, MAX_QUEUE)
        self._bridge.advertise(self, topic, _text(message, "type"), message.get("id"), bool(message.get("latch")), queue_size)

    def _unadvertise(self, message: dict[str, Any]) -> None:
        self._bridge.unadvertise(self, _name(message, "topic"), message.get("id"))

    def _publish(self, message: dict[str, Any]) -> None:
        topic = _name(message, "topic")
        contents = message.get("msg", {})
        if absolute(topic) == graph.HMI_ESTOP.name:
            self._set_stop(contents, message.get("id"))
            return
        if absolute(topic) == graph.CMD_VEL_MANUAL.name:
            self._drive(topic, _optional_text(message, "type"), contents)
            return
        self._bridge.authority.check_publish(self.session, absolute(topic), time.monotonic_ns())
        self._bridge.record(self.session.name, f"publish {absolute(topic)}", contents)
        latch = bool(message.get("latch"))
        queue_size = _number(message, "queue_size", 100, 1, MAX_QUEUE)
        self._bridge.publish(self, topic, _optional_text(message, "type"), message.get("id"), contents, latch, queue_size)

    def _drive(self, topic: str, type_name: str | None, contents: Any) -> None:
        kind = graph.CMD_VEL_MANUAL.type
        if type_name is not None and full_name(type_name, "msg") != kind:
            raise InvalidRequest(type_conflict(topic, full_name(type_name, "msg"), kind))
        twist = _limited(contents)
        authority, now_ns = self._bridge.authority, time.monotonic_ns()
        if any(value for axes in twist.values() for value in axes.values()):
            authority.check_publish(self.session, graph.CMD_VEL_MANUAL.name, now_ns)
        else:
            authority.check_take(self.session, now_ns)  # a stick at rest asks for nothing, so it takes no control
        self._bridge.manual.drive(self, twist)

    def _set_stop(self, contents: Any, identifier: Any) -> None:
        """Engage the client's own stop, or let go of it, which everybody may. The `id` of a page's message names the press."""
        engaged = contents.get("data") if isinstance(contents, dict) else None
        if not isinstance(engaged, bool):
            raise InvalidRequest("std_msgs/Bool message requires a bool for field data")
        press = press_name(identifier)
        released_by = self._bridge.manual.set_stop(self, engaged, press)
        if released_by:
            self.status("warning", released_by, press)

    def _subscribe(self, message: dict[str, Any]) -> None:
        compression = _optional_text(message, "compression") or "none"
        request = Request(
            throttle_ms=_number(message, "throttle_rate", 0, 0, 3_600_000),
            queue_length=_number(message, "queue_length", 0, 0, MAX_QUEUE),
            compression=compression if compression in COMPRESSIONS else "none",
        )
        self._bridge.subscribe(self, _name(message, "topic"), _optional_text(message, "type"), message.get("id"), request)

    def _unsubscribe(self, message: dict[str, Any]) -> None:
        self._bridge.unsubscribe(self, _name(message, "topic"), message.get("id"))

    # -- services -----------------------------------------------------------------------------------------------------
    def _call_service(self, message: dict[str, Any]) -> None:
        requested = _text(message, "service")
        service, _, suffix = requested.partition("#")
        identifier = message.get("id", suffix or None)

        def done(succeeded: bool, response: Any) -> None:
            answer = {"op": "service_response", "service": requested, "values": response, "result": succeeded}
            self.answer(answer if identifier is None else {**answer, "id": identifier})

        try:
            service = _name({"service": service}, "service")
            timeout_s = message.get("timeout")
            if timeout_s is not None and (isinstance(timeout_s, bool) or not isinstance(timeout_s, (int, float))):
                raise InvalidRequest(f"timeout must be a number of seconds, not {short_repr(timeout_s)}")
            self._bridge.authority.check_call(self.session, absolute(service), time.monotonic_ns())
            if not absolute(service).startswith(READ_ONLY_PREFIX):
                self._bridge.record(self.session.name, f"call {absolute(service)}", message.get("args"))
            arguments = with_map_path(absolute(service), message.get("args"))
            self._bridge.call_service(self, service, arguments, timeout_s, done)
        except (InvalidRequest, Refused, BadMapName, OSError) as error:
            if isinstance(error, Refused):
                self._refuse("call_service", message, error)
            self._bridge.log_request(self.session, "error", f"call_service: {error}")
            done(False, str(error))

    def _advertise_service(self, message: dict[str, Any]) -> None:
        service, kind = _name(message, "service"), _text(message, "type")
        self._bridge.authority.check_provide(service)
        self._bridge.run_with_services(self, lambda provider: provider.advertise(service, kind))

    def _unadvertise_service(self, message: dict[str, Any]) -> None:
        service = _name(message, "service")
        self._bridge.run_with_services(self, lambda provider: provider.unadvertise(service))

    def _service_response(self, message: dict[str, Any]) -> None:
        service, identifier, result = _name(message, "service"), _text(message, "id"), _flag(message, "result")
        response = message.get("values")
        self._bridge.run_with_services(self, lambda provider: provider.respond(service, identifier, response, result))

    # -- actions ------------------------------------------------------------------------------------------------------
    def _send_action_goal(self, message: dict[str, Any]) -> None:
        action, identifier = _name(message, "action"), message.get("id")
        kind, feedback = _text(message, "action_type"), bool(message.get("feedback"))
        try:
            self._bridge.authority.check_send_goal(self.session, action, time.monotonic_ns())
        except Refused as error:
            self._refuse("send_action_goal", message, error)
            answer = {"op": "action_result", "action": action, "values": str(error), "status": 0, "result": False}
            self.answer(answer if identifier is None else {**answer, "id": identifier})
            return
        arguments = message.get("args")
        self._bridge.record(self.session.name, f"goal {absolute(action)}", arguments)
        self._bridge.send_goal(self, identifier, action, kind, arguments, feedback)

    def _cancel_action_goal(self, message: dict[str, Any]) -> None:
        identifier = message.get("id")
        self._bridge.record(self.session.name, "cancel goal", identifier)
        self._bridge.cancel_goal(self, identifier)

    def _advertise_action(self, message: dict[str, Any]) -> None:
        action, kind = _name(message, "action"), _text(message, "type")
        self._bridge.authority.check_provide(action)
        self._bridge.run_with_actions(self, lambda provider: provider.advertise(action, kind))

    def _unadvertise_action(self, message: dict[str, Any]) -> None:
        action = _name(message, "action")
        self._bridge.run_with_actions(self, lambda provider: provider.unadvertise(action))

    def _action_feedback(self, message: dict[str, Any]) -> None:
        action, identifier, feedback = _name(message, "action"), _text(message, "id"), message.get("values")
        self._bridge.run_with_actions(self, lambda provider: provider.feedback(action, identifier, feedback))

    def _action_result(self, message: dict[str, Any]) -> None:
        action, identifier, result = _name(message, "action"), _text(message, "id"), _flag(message, "result")
        status = _number(message, "status", 4, 0, 6)
        outcome = message.get("values")
        self._bridge.run_with_actions(self, lambda provider: provider.result(action, identifier, outcome, status, result))

    # -- the connection -----------------------------------------------------------------------------------------------
    def _set_level(self, message: dict[str, Any]) -> None:
        level = _text(message, "level")
        if level not in LEVELS:
            raise InvalidRequest(f"level must be one of {', '.join(LEVELS)}, not {level[:100]}")
        self._level = level

    def _fragment(self, message: dict[str, Any]) -> None:
        if self._defragmenting:
            # Fragments within fragments, hundreds of levels deep, would exceed the interpreter's recursion limit.
            raise InvalidRequest("a message that comes in fragments must not be a fragment itself")
        text = self._defragmenter.add(message, time.monotonic())
        if text is not None:
            self._defragmenting = True
            try:
                self.handle(text)
            finally:
                self._defragmenting = False


_AXES = tuple((part, axis) for part in ("linear", "angular") for axis in ("x", "y", "z"))


def _limited(contents: Any) -> dict[str, dict[str, float]]:
    """Return a Twist limited to the speeds of manual driving in the same direction.

    Raises InvalidRequest if it is malformed or not finite.
    """
    twist = {"linear": {"x": 0.0, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}
    if not isinstance(contents, dict) or not all(isinstance(contents.get(part, {}), dict) for part in twist):
        raise InvalidRequest("a Twist must be an object with linear and angular")
    for part, axis in _AXES:
        value = contents.get(part, {}).get(axis, 0.0)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise InvalidRequest(f"{part}.{axis} of a Twist must be a finite number, not {short_repr(value)}")
        twist[part][axis] = float(value)
    speed_mps = math.hypot(twist["linear"]["x"], twist["linear"]["y"])
    if speed_mps > _LINEAR_MPS:
        twist["linear"] = {axis: value * _LINEAR_MPS / speed_mps for axis, value in twist["linear"].items()}
    twist["angular"]["z"] = max(-_ANGULAR_RPS, min(_ANGULAR_RPS, twist["angular"]["z"]))
    return twist


def _shown(value: Any) -> str:
    return value[:_MAX_NAME] if isinstance(value, str) else short_repr(value)


def _text(message: dict[str, Any], key: str) -> str:
    if key not in message:
        raise InvalidRequest(_MISSING.format(key))
    value = message[key]
    if not isinstance(value, str) or not value:
        raise InvalidRequest(f"Expected field {key} to be one of {str}. Invalid value: {short_repr(value)}")
    return value


def _name(message: dict[str, Any], key: str) -> str:
    """Return the name of a topic, service or action, as it was sent. Raises InvalidRequest."""
    name = _text(message, key)
    if len(name) > _MAX_NAME or not _NAME.fullmatch(name):
        raise InvalidRequest(f"{name[:100]!r} is not a valid name: expected words of letters, digits and _, separated by /")
    return name


def _optional_text(message: dict[str, Any], key: str) -> str | None:
    return _text(message, key) if message.get(key) is not None else None


def _number(message: dict[str, Any], key: str, default: int, least: int, most: int) -> int:
    value = message.get(key)
    if value is None:
        return default
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise InvalidRequest(f"Expected field {key} to be one of {int}. Invalid value: {short_repr(value)}")
    return max(least, min(most, int(value)))


def _flag(message: dict[str, Any], key: str) -> bool:
    if key not in message:
        raise InvalidRequest(_MISSING.format(key))
    if not isinstance(message[key], bool):
        raise InvalidRequest(f"Expected field {key} to be one of {bool}. Invalid value: {short_repr(message[key])}")
    return bool(message[key])
