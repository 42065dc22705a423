"""A WebSocket client for tests that does only what its test does: it answers no ping and reads nothing by itself."""

from __future__ import annotations

import json
import socket
from typing import Any

from tests.support.waiting import WAIT_S


def open_raw_websocket(port: int, path: str = "/", *, receive_buffer: int | None = None) -> socket.socket:
    """Open a WebSocket on this computer, and return its TCP connection.

    A small `receive_buffer`, in bytes, makes the sender notice early that nothing is read.
    """
    connection = socket.socket()
    connection.settimeout(WAIT_S)
    if receive_buffer is not None:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
    connection.connect(("127.0.0.1", port))
    lines = (
        f"GET {path} HTTP/1.1",
        f"Host: 127.0.0.1:{port}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Version: 13",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
    )
    connection.sendall("\r\n".join((*lines, "", "")).encode())
    answer = b""
    while not answer.endswith(b"\r\n\r\n"):
        byte = connection.recv(1)
        assert byte, answer
        answer += byte
    assert b" 101 " in answer, answer
    return connection


def text_frame(op: str, **fields: Any) -> bytes:
    """Return a masked frame with a message of the protocol."""
    data = json.dumps({"op": op, **fields}).encode()
    length = bytes([0x80 | len(data)]) if len(data) < 126 else bytes([0xFE]) + len(data).to_bytes(2, "big")
    return b"\x81" + length + bytes(4) + data
