"""A rosbridge client for tests that sends and receives single messages over a WebSocket."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import cbor2
from websockets.sync.client import ClientConnection, connect

from tests.support.waiting import WAIT_S


class RosbridgeClient:
    """Sends messages, and collects all that it receives."""

    def __init__(self, port: int, path: str = "/", **options: Any) -> None:
        self._open = ExitStack()
        url = f"{'wss' if 'ssl' in options else 'ws'}://127.0.0.1:{port}{path}"
        self.socket: ClientConnection = self._open.enter_context(connect(url, max_size=None, **options))
        self.received: list[dict[str, Any]] = []
        self.raw: list[str | bytes] = []

    def send(self, op: str, **fields: Any) -> None:
        """Send one message."""
        self.socket.send(json.dumps({"op": op, **fields}))

    def wait(self, condition: Callable[[dict[str, Any]], Any], timeout_s: float = WAIT_S) -> dict[str, Any]:
        """Return the first message ever received that meets the condition; wait for it if necessary. Raises TimeoutError."""
        checked, deadline_s = 0, time.monotonic() + timeout_s
        while True:
            for message in self.received[checked:]:
                if condition(message):
                    return message
            checked = len(self.received)
            self.take(max(0.001, deadline_s - time.monotonic()))

    def take(self, timeout_s: float) -> dict[str, Any]:
        """Receive and return the next message. Raises TimeoutError."""
        frame = self.socket.recv(timeout=timeout_s)
        message: dict[str, Any] = cbor2.loads(frame) if isinstance(frame, bytes) else json.loads(frame)
        self.raw.append(frame)
        self.received.append(message)
        return message

    def publication(self, topic: str, condition: Callable[[Any], Any] = lambda _: True) -> Any:
        """Return the contents of the first message on a topic that meets the condition; wait for it if necessary."""
        found = self.wait(lambda m: m["op"] == "publish" and m["topic"] == topic and condition(m["msg"]))
        return found["msg"]

    def call(self, service: str, **arguments: Any) -> Any:
        """Call a service, and return the whole response."""
        identifier = f"call {len(self.received)} {service}"
        self.send("call_service", service=service, args=arguments, id=identifier)
        return self.wait(lambda m: m["op"] == "service_response" and m.get("id") == identifier)

    def refusal(self, text: str) -> dict[str, Any]:
        """Wait for a `status` message that contains a text; the client must have set its level."""
        return self.wait(lambda m: m["op"] == "status" and text in m["msg"])

    def close(self) -> None:
        """Close the connection."""
        self._open.close()
