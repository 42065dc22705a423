"""A client of the video server that reads streams like a browser."""

from __future__ import annotations

import http.client
import json
import ssl
from collections.abc import Mapping
from typing import Any

from lupin_runtime.cameras.mjpeg import PartReader
from tests.support.waiting import WAIT_S


class VideoClient:
    """Requests paths, and opens streams that are read image by image. `headers` are sent with every request."""

    def __init__(
        self, port: int, prefix: str = "", headers: Mapping[str, str] | None = None, trust: ssl.SSLContext | None = None
    ) -> None:
        self._port, self._prefix, self._headers, self._trust = port, prefix, headers or {}, trust
        self._open: list[http.client.HTTPResponse | http.client.HTTPConnection] = []

    def get(self, path: str, method: str = "GET") -> tuple[int, bytes, dict[str, str]]:
        """Request a path; return status, content and headers of the response."""
        connection = self._connection()
        try:
            connection.request(method, self._prefix + path, headers=dict(self._headers))
            response = connection.getresponse()
            return response.status, response.read(), dict(response.getheaders())
        finally:
            connection.close()

    def text(self, path: str, status: int = 200) -> str:
        """Request a path, and return the content of the response, whose status must be `status`."""
        actual_status, content, _ = self.get(path)
        assert actual_status == status, (actual_status, content)
        return content.decode()

    def json(self, path: str) -> Any:
        """Request a path, and return the parsed JSON of the response, whose status must be 200."""
        return json.loads(self.text(path))

    def stream(self, path: str) -> Stream:
        """Open a stream."""
        connection = self._connection()
        connection.request("GET", self._prefix + path, headers=dict(self._headers))
        response = connection.getresponse()
        self._open += [response, connection]
        assert response.status == 200, (response.status, response.read())
        return Stream(response)

    def close(self) -> None:
        """Close all streams."""
        while self._open:
            self._open.pop().close()

    def _connection(self) -> http.client.HTTPConnection:
        if self._trust is None:
            return http.client.HTTPConnection("127.0.0.1", self._port, timeout=WAIT_S)
        return http.client.HTTPSConnection("127.0.0.1", self._port, timeout=WAIT_S, context=self._trust)


class Stream:
    """An open stream."""

    def __init__(self, response: http.client.HTTPResponse) -> None:
        self.headers = dict(response.getheaders())
        self._response = response
        self._reader = PartReader()
        self._images: list[tuple[bytes, int]] = []

    def image(self) -> tuple[bytes, int]:
        """Return the next image and its stamp in ns. Raises EOFError at the end of the stream."""
        while not self._images:
            try:
                data = self._response.read1(65536)
            except (ConnectionError, http.client.HTTPException) as error:
                raise EOFError from error
            if not data:
                raise EOFError
            self._images += self._reader.feed(data)
        return self._images.pop(0)

    def close(self) -> None:
        """Close the stream."""
        self._response.close()
