"""A browser for tests of the console's single origin: it keeps its cookie, and sends the headers that browsers send."""

from __future__ import annotations

import http.client
import json
import ssl
from typing import Any

from tests.support.rosbridge_client import RosbridgeClient
from tests.support.waiting import WAIT_S

PHONE = "Mozilla/5.0 (Linux; Android 15; Pixel 9) Chrome/140.0 Mobile Safari/537.36"


def stop_texts(answer: dict[str, Any]) -> list[str]:
    """Return why the robot is stopped, by an answer of `/_api/session` or `/_api/stop`."""
    return [hold["text"] for hold in answer["stop"]]


class Browser:
    """A browser on the loopback interface.

    With `proxied`, its requests look as if they came from another computer. With `trust`, it uses HTTPS.
    """

    def __init__(self, port: int, agent: str = PHONE, *, proxied: bool = False, trust: ssl.SSLContext | None = None) -> None:
        self.port = port
        self._trust = trust
        self.headers = {"User-Agent": agent, "Accept": "text/html,*/*"}
        if proxied:
            self.headers["X-Forwarded-For"] = "192.0.2.7"

    @property
    def origin(self) -> str:
        """The origin of the console's page."""
        return f"{'http' if self._trust is None else 'https'}://127.0.0.1:{self.port}"

    def request(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, Any]:
        """Send a request; return the status and the contents of the response: parsed JSON, or text."""
        if self._trust is None:
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=WAIT_S)
        else:
            connection = http.client.HTTPSConnection("127.0.0.1", self.port, timeout=WAIT_S, context=self._trust)
        try:
            data = body if isinstance(body, (bytes, type(None))) else json.dumps(body)
            added = {"Origin": self.origin, "Content-Type": "application/json"} if method != "GET" else {}
            connection.request(method, path, data, {**self.headers, **added, **headers})
            response = connection.getresponse()
            text = response.read().decode()
            self.response_headers = dict(response.getheaders())
            cookie = self.response_headers.get("Set-Cookie")
            if cookie is not None:
                self.headers["Cookie"] = cookie.split(";", 1)[0]
            return response.status, json.loads(text) if "json" in self.response_headers.get("Content-Type", "") else text
        finally:
            connection.close()

    def get(self, path: str, **headers: str) -> Any:
        """Return the contents of a GET response, whose status must be 200."""
        status, contents = self.request("GET", path, **headers)
        assert status == 200, (status, contents)
        return contents

    def post(self, path: str, **body: Any) -> Any:
        """Return the contents of a POST response, whose status must be 200."""
        status, contents = self.request("POST", path, body)
        assert status == 200, (status, contents)
        return contents

    def socket(self, path: str = "/_ros") -> RosbridgeClient:
        """Open a WebSocket, as a page in this browser does."""
        headers = {key: value for key, value in self.headers.items() if key != "User-Agent"}
        options: dict[str, Any] = {} if self._trust is None else {"ssl": self._trust}
        agent = self.headers["User-Agent"]
        return RosbridgeClient(
            self.port, path, origin=self.origin, additional_headers=headers, user_agent_header=agent, **options
        )
