"""A browser for tests of the console's one origin: keeps its cookie, and sends the headers that browsers send."""

from __future__ import annotations

import http.client
import json
import ssl
from typing import Any

from tests.support.rosbridge_client import RosbridgeClient

PHONE = "Mozilla/5.0 (Linux; Android 15; Pixel 9) Chrome/140.0 Mobile Safari/537.36"


class Browser:
    """A browser on the loopback interface. With `proxied` its requests look as though they came from another computer.

    It uses HTTPS where it is given what it trusts.
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
        """Status and contents of an answer: parsed JSON, or text."""
        if self._trust is None:
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        else:
            connection = http.client.HTTPSConnection("127.0.0.1", self.port, timeout=20, context=self._trust)
        try:
            data = body if isinstance(body, (bytes, type(None))) else json.dumps(body)
            own = {"Origin": self.origin, "Content-Type": "application/json"} if method != "GET" else {}
            connection.request(method, path, data, {**self.headers, **own, **headers})
            answer = connection.getresponse()
            text = answer.read().decode()
            self.answer_headers = dict(answer.getheaders())
            cookie = self.answer_headers.get("Set-Cookie")
            if cookie is not None:
                self.headers["Cookie"] = cookie.split(";", 1)[0]
            return answer.status, json.loads(text) if "json" in self.answer_headers.get("Content-Type", "") else text
        finally:
            connection.close()

    def get(self, path: str, **headers: str) -> Any:
        """The contents of an answer that succeeds."""
        status, contents = self.request("GET", path, **headers)
        assert status == 200, (status, contents)
        return contents

    def post(self, path: str, **body: Any) -> Any:
        """The contents of an answer that succeeds."""
        status, contents = self.request("POST", path, body)
        assert status == 200, (status, contents)
        return contents

    def socket(self, path: str = "/_ros") -> RosbridgeClient:
        """A WebSocket of a page in this browser."""
        headers = {key: value for key, value in self.headers.items() if key != "User-Agent"}
        options: dict[str, Any] = {} if self._trust is None else {"ssl": self._trust}
        agent = self.headers["User-Agent"]
        return RosbridgeClient(
            self.port, path, origin=self.origin, additional_headers=headers, user_agent_header=agent, **options
        )
