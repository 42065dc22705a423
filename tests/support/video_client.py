"""A client of the video server that reads a stream as browsers do."""

from __future__ import annotations

import http.client
import json
import ssl
from collections.abc import Mapping
from typing import Any

from lupin_runtime.cameras.mjpeg import PartReader

TIMEOUT_S = 20.0


class VideoClient:
    """Requests one path after another; a stream is read picture by picture. `headers` go with every request."""

    def __init__(
        self, port: int, prefix: str = "", headers: Mapping[str, str] | None = None, trust: ssl.SSLContext | None = None
    ) -> None:
        self._port, self._prefix, self._headers, self._trust = port, prefix, headers or {}, trust
        self._open: list[http.client.HTTPResponse | http.client.HTTPConnection] = []

    def get(self, path: str) -> tuple[int, bytes, dict[str, str]]:
        """Status, content and headers of an answer that ends."""
        connection = self._connection()
        try:
            connection.request("GET", self._prefix + path, headers=dict(self._headers))
            answer = connection.getresponse()
            return answer.status, answer.read(), dict(answer.getheaders())
        finally:
            connection.close()

    def text(self, path: str, status: int = 200) -> str:
        """The content of an answer of that status."""
        seen, content, _ = self.get(path)
        assert seen == status, (seen, content)
        return content.decode()

    def json(self, path: str) -> Any:
        """The parsed content of an answer that succeeds."""
        return json.loads(self.text(path))

    def stream(self, path: str) -> Stream:
        """Begin to watch a stream."""
        connection = self._connection()
        connection.request("GET", self._prefix + path, headers=dict(self._headers))
        answer = connection.getresponse()
        self._open += [answer, connection]
        assert answer.status == 200, (answer.status, answer.read())
        return Stream(answer)

    def close(self) -> None:
        """Leave all streams."""
        while self._open:
            self._open.pop().close()

    def _connection(self) -> http.client.HTTPConnection:
        if self._trust is None:
            return http.client.HTTPConnection("127.0.0.1", self._port, timeout=TIMEOUT_S)
        return http.client.HTTPSConnection("127.0.0.1", self._port, timeout=TIMEOUT_S, context=self._trust)


class Stream:
    """A stream that is being watched."""

    def __init__(self, answer: http.client.HTTPResponse) -> None:
        self.headers = dict(answer.getheaders())
        self._answer = answer
        self._reader = PartReader()
        self._pictures: list[tuple[bytes, int]] = []

    def picture(self) -> tuple[bytes, int]:
        """The next picture and its stamp in ns. Raises EOFError where the stream ends."""
        while not self._pictures:
            try:
                data = self._answer.read1(65536)
            except (ConnectionError, http.client.HTTPException) as error:
                raise EOFError from error
            if not data:
                raise EOFError
            self._pictures += self._reader.feed(data)
        return self._pictures.pop(0)

    def close(self) -> None:
        """Leave."""
        self._answer.close()
