"""The video server over HTTP, with the paths and parameters of web_video_server, from the standard library alone.

A robot has no HTTP framework, and each client blocks on nothing but its own thread.
"""

from __future__ import annotations

import html
import json
import select
import socket
import threading
import time
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from socketserver import ThreadingTCPServer
from typing import Any
from urllib.parse import parse_qsl, quote, urlsplit

from lupin_runtime.cameras import mjpeg
from lupin_runtime.cameras.stream_request import BadRequest, NoSuchCamera, StreamRequest, read_request
from lupin_runtime.cameras.video_streams import GraphSilent, VideoStreams

MAX_CONNECTIONS = 64
MAX_CONNECTIONS_OF_ADDRESS = 16
REQUEST_S = 10.0  # within which a client must have sent its request, and taken a picture
SNAPSHOT_S = 5.0
_STOP_S = 2.0
_LOOK_S = 0.5  # how often a stream without pictures looks whether its client is still there
# What the kernel may keep for a slow client beyond what is on its way: pictures that wait there are late when they arrive.
_UNSENT_BYTES = 32_768
_HEADERS = {"Cache-Control": "no-store", "Connection": "close", "X-Content-Type-Options": "nosniff"}


class VideoHttpServer(ThreadingTCPServer):  # an HTTPServer resolves this host's name, which may take long on a robot
    """Serves `/stream`, `/snapshot`, `/streams`, `/stream_viewer` and a list at `/`. The constructor raises OSError."""

    allow_reuse_address = True
    daemon_threads = True
    block_on_close = False
    request_queue_size = 64

    def __init__(self, host: str, port: int, streams: VideoStreams) -> None:
        self.streams = streams
        self.closing = False
        self._open: dict[socket.socket, tuple[str, float]] = {}  # address, and until when it must have sent its request
        self._open_lock = threading.Lock()
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        super().__init__((host, port), _Handler)
        self._thread = threading.Thread(target=self.serve_forever, kwargs={"poll_interval": _LOOK_S}, name="video", daemon=True)

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return int(self.server_address[1])

    def start(self) -> None:
        """Accept connections, on a thread of the server."""
        self._thread.start()

    def stop(self) -> None:
        """Stop accepting, and end all streams; returns when they have left the graph."""
        self.closing = True
        if self._thread.is_alive():
            self.shutdown()
        self.server_close()
        self.streams.close()
        deadline_s = time.monotonic() + _STOP_S
        while self._hang_up_all() and time.monotonic() < deadline_s:
            time.sleep(0.01)

    def _hang_up_all(self) -> int:
        """How many connections there were still."""
        with self._open_lock:
            for connection in self._open:
                _hang_up(connection)
            return len(self._open)

    def requested(self, connection: socket.socket) -> None:
        """Note that a client has sent its request."""
        with self._open_lock:
            address, _ = self._open[connection]
            self._open[connection] = (address, float("inf"))

    # -- of the base class --------------------------------------------------------------------------------------------
    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Whether there is room for another connection."""
        address = str(client_address[0])
        with self._open_lock:
            of_address = sum(known == address for known, _ in self._open.values())
            if len(self._open) >= MAX_CONNECTIONS or of_address >= MAX_CONNECTIONS_OF_ADDRESS:
                return False
            self._open[request] = (address, time.monotonic() + REQUEST_S)
        return True

    def service_actions(self) -> None:
        """Hang up on those who send no request."""
        now_s = time.monotonic()
        with self._open_lock:
            for connection, (_, until_s) in self._open.items():
                if now_s > until_s:
                    _hang_up(connection)

    def shutdown_request(self, request: Any) -> None:
        """Forget and close a connection."""
        with self._open_lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that went away is none; all else would be a defect, which the base class prints."""
        import sys

        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """One connection, which carries one request."""

    protocol_version = "HTTP/1.1"
    server_version = "Lupin"
    sys_version = ""
    timeout = REQUEST_S
    server: VideoHttpServer

    def do_GET(self) -> None:
        """Answer a request."""
        self.close_connection = True
        self.server.requested(self.connection)
        try:
            url = urlsplit(self.path)
        except ValueError as error:
            self._refuse(HTTPStatus.BAD_REQUEST, f"not a URL: {error}")
            return
        answers: dict[str, Callable[[StreamRequest], None]] = {"/stream": self._stream, "/snapshot": self._snapshot}
        try:
            if url.path in answers:
                answers[url.path](self._request(url.query))
            elif url.path == "/streams":
                self._send("application/json", json.dumps(self.server.streams.describe()).encode())
            elif url.path == "/stream_viewer":
                self._send("text/html; charset=utf-8", _viewer(self._request(url.query), url.query).encode())
            elif url.path == "/":
                self._send("text/html; charset=utf-8", _index(self.server.streams.describe()).encode())
            else:
                self._refuse(HTTPStatus.NOT_FOUND, "there are /stream, /snapshot and /streams")
        except BadRequest as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
        except NoSuchCamera as error:
            self._refuse(HTTPStatus.NOT_FOUND, str(error))
        except GraphSilent as error:
            self._refuse(HTTPStatus.GATEWAY_TIMEOUT, str(error))

    def _request(self, query: str) -> StreamRequest:
        try:
            return read_request(dict(parse_qsl(query, keep_blank_values=True, max_num_fields=20)))
        except BadRequest:
            raise
        except ValueError as error:
            raise BadRequest(str(error)) from error

    def _stream(self, request: StreamRequest) -> None:
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _UNSENT_BYTES)
        with self.server.streams.watch(request) as frames:
            self._begin(mjpeg.CONTENT_TYPE)
            self.wfile.write(mjpeg.OPENING)
            number = 0
            while not self.server.closing and not _has_left(self.connection):
                frame = frames.after(number, _LOOK_S)
                if frame is not None:
                    number = frame.number
                    self.wfile.write(mjpeg.part(frame.data, frame.stamp_ns))

    def _snapshot(self, request: StreamRequest) -> None:
        with self.server.streams.watch(request) as frames:
            frame = frames.after(frames.number, SNAPSHOT_S)
        if frame is None:
            raise GraphSilent(f"no picture came from {request.topic} within {SNAPSHOT_S:g} s")
        self._send("image/jpeg", frame.data, X_Timestamp=mjpeg.stamp_text(frame.stamp_ns))

    def _begin(self, content_type: str, status: HTTPStatus = HTTPStatus.OK, **headers: str) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": content_type, **_HEADERS, **headers}.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()

    def _send(self, content_type: str, content: bytes, status: HTTPStatus = HTTPStatus.OK, **headers: str) -> None:
        self._begin(content_type, status, Content_Length=str(len(content)), **headers)
        self.wfile.write(content)

    def _refuse(self, status: HTTPStatus, reason: str) -> None:
        self._send("text/plain; charset=utf-8", f"{reason}\n".encode(), status)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not logged: there is one for every picture that a page asks for."""


def _has_left(connection: socket.socket) -> bool:
    """Whether the client has closed its side; what it may send beyond its request is passed over."""
    readable, _, _ = select.select([connection], [], [], 0)
    return bool(readable) and not connection.recv(65536)


def _hang_up(connection: socket.socket) -> None:
    try:
        connection.shutdown(socket.SHUT_RDWR)
    except OSError:
        return  # it has left by itself


def _viewer(request: StreamRequest, query: str) -> str:
    source = html.escape(f"stream?{query}", quote=True)
    return (
        f'<!doctype html><title>{html.escape(request.topic)}</title><img src="{source}" alt="{html.escape(request.topic)}">\n'
    )


def _index(rows: list[dict[str, Any]]) -> str:
    items = "".join(
        f'<li>{html.escape(row["topic"])}: <a href="stream?topic={quote(row["topic"])}">stream</a>, '
        f'<a href="snapshot?topic={quote(row["topic"])}">snapshot</a></li>'
        for row in rows
    )
    return f"<!doctype html><title>Cameras</title><ul>{items or '<li>no node publishes pictures</li>'}</ul>\n"
