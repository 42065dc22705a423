"""The video server's HTTP side, with the paths and parameters of web_video_server.

It needs only the standard library, because a robot has no HTTP framework. Each client has its own thread.
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
MAX_CONNECTIONS_PER_ADDRESS = 16
REQUEST_TIMEOUT_S = 10.0  # a client must send its request, and take each image, within this time
SNAPSHOT_TIMEOUT_S = 5.0
_STOP_TIMEOUT_S = 2.0
_CHECK_PERIOD_S = 0.5  # how often a stream without images checks that its client is still connected
# How much unsent data the kernel may hold for a slow client: images that wait there are outdated when they arrive.
_UNSENT_BYTES = 32_768
_HEADERS = {"Cache-Control": "no-store", "Connection": "close", "X-Content-Type-Options": "nosniff"}


class VideoHttpServer(ThreadingTCPServer):  # not HTTPServer, which resolves this host's name: on a robot that may be slow
    """Serves `/stream`, `/snapshot`, `/streams`, `/stream_viewer` and a list at `/`. The constructor raises OSError."""

    allow_reuse_address = True
    daemon_threads = True
    block_on_close = False
    request_queue_size = 64

    def __init__(self, host: str, port: int, streams: VideoStreams) -> None:
        self.streams = streams
        self.closing = False
        self._open: dict[socket.socket, tuple[str, float]] = {}  # the address, and the deadline for the request
        self._open_lock = threading.Lock()
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        super().__init__((host, port), _Handler)
        self._thread = threading.Thread(
            target=self.serve_forever, kwargs={"poll_interval": _CHECK_PERIOD_S}, name="video", daemon=True
        )

    @property
    def port(self) -> int:
        """The port that it listens on."""
        return int(self.server_address[1])

    def start(self) -> None:
        """Accept connections on the server's own thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stop accepting connections, and end all streams; returns once they are closed, or after a timeout."""
        self.closing = True
        if self._thread.is_alive():
            self.shutdown()
        self.server_close()
        self.streams.close()
        deadline_s = time.monotonic() + _STOP_TIMEOUT_S
        while self._shut_down_all() and time.monotonic() < deadline_s:
            time.sleep(0.01)

    def _shut_down_all(self) -> int:
        """Shut down all connections, and return how many there were."""
        with self._open_lock:
            for connection in self._open:
                _shut_down(connection)
            return len(self._open)

    def note_request(self, connection: socket.socket) -> None:
        """Note that a client has sent its request."""
        with self._open_lock:
            address, _ = self._open[connection]
            self._open[connection] = (address, float("inf"))

    # -- overrides ----------------------------------------------------------------------------------------------------
    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Return whether another connection is allowed, and register it if so."""
        address = str(client_address[0])
        with self._open_lock:
            from_address = sum(known == address for known, _ in self._open.values())
            if len(self._open) >= MAX_CONNECTIONS or from_address >= MAX_CONNECTIONS_PER_ADDRESS:
                return False
            self._open[request] = (address, time.monotonic() + REQUEST_TIMEOUT_S)
        return True

    def service_actions(self) -> None:
        """Shut down connections on which no request was sent in time."""
        now_s = time.monotonic()
        with self._open_lock:
            for connection, (_, deadline_s) in self._open.items():
                if now_s > deadline_s:
                    _shut_down(connection)

    def shutdown_request(self, request: Any) -> None:
        """Forget and close a connection."""
        with self._open_lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Let the base class print errors, except those of clients that have disconnected."""
        import sys

        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """One connection, which carries one request."""

    protocol_version = "HTTP/1.1"
    server_version = "Lupin"
    sys_version = ""
    timeout = REQUEST_TIMEOUT_S
    server: VideoHttpServer

    def do_GET(self) -> None:
        """Answer a request."""
        self.close_connection = True
        self.server.note_request(self.connection)
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
                self._refuse(HTTPStatus.NOT_FOUND, "no such path; there are /stream, /snapshot and /streams")
        except BadRequest as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
        except NoSuchCamera as error:
            self._refuse(HTTPStatus.NOT_FOUND, str(error))
        except GraphSilent as error:
            self._refuse(HTTPStatus.GATEWAY_TIMEOUT, str(error))

    do_HEAD = do_GET  # RFC 9110, 9.3.2: the same answer without its content

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
        with self.server.streams.watch(request) as view:
            frames = view.frames
            self._begin(mjpeg.CONTENT_TYPE)
            if self.command == "HEAD":
                return
            self.wfile.write(mjpeg.OPENING)
            number = 0
            while not self.server.closing and not _has_disconnected(self.connection):
                frame = frames.after(number, _CHECK_PERIOD_S)
                if frame is not None:
                    number = frame.number
                    self.wfile.write(mjpeg.part(frame.data, frame.stamp_ns))

    def _snapshot(self, request: StreamRequest) -> None:
        with self.server.streams.watch(request) as view:
            frame = view.frames.after(view.frames.number, SNAPSHOT_TIMEOUT_S)
        if frame is None:
            reason = f"; {request.topic} is not shown: {view.error}" if view.error else ""
            raise GraphSilent(f"no image came from {request.topic} within {SNAPSHOT_TIMEOUT_S:g} s{reason}")
        self._send("image/jpeg", frame.data, X_Timestamp=mjpeg.stamp_text(frame.stamp_ns))

    def _begin(self, content_type: str, status: HTTPStatus = HTTPStatus.OK, **headers: str) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": content_type, **_HEADERS, **headers}.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()

    def _send(self, content_type: str, content: bytes, status: HTTPStatus = HTTPStatus.OK, **headers: str) -> None:
        self._begin(content_type, status, Content_Length=str(len(content)), **headers)
        if self.command != "HEAD":
            self.wfile.write(content)

    def _refuse(self, status: HTTPStatus, reason: str) -> None:
        self._send("text/plain; charset=utf-8", f"{reason}\n".encode(), status)

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: pages may send a request for every image."""


def _has_disconnected(connection: socket.socket) -> bool:
    """Return whether the client has closed its side. Data that it sends after its request is discarded."""
    readable, _, _ = select.select([connection], [], [], 0)
    return bool(readable) and not connection.recv(65536)


def _shut_down(connection: socket.socket) -> None:
    try:
        connection.shutdown(socket.SHUT_RDWR)
    except OSError:
        return  # it is closed already


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
    return f"<!doctype html><title>Cameras</title><ul>{items or '<li>no node publishes images</li>'}</ul>\n"
