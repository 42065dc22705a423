"""Send input to an SSH channel and read its output, with time limits."""

from __future__ import annotations

import contextlib
import selectors
import time
from collections.abc import Iterator

import paramiko

CONNECTION_ERRORS = (OSError, EOFError, paramiko.SSHException)  # what paramiko raises when a connection is lost
_CHILD_SILENCE_S = 0.3  # after the script has exited: how long to wait for output of a child that kept its pipe


def send_input(channel: paramiko.Channel, data: bytes, is_all: bool = True) -> None:
    """Send `data`, and the end of input if that `is_all`. Run it beside `read_output`, because either side may block."""
    with contextlib.suppress(*CONNECTION_ERRORS):  # read_output notices the lost connection too
        channel.sendall(data)
        if is_all:
            channel.shutdown_write()


def read_output(channel: paramiko.Channel, deadline: float) -> Iterator[tuple[bool, bytes]]:
    """Yield `(is_stderr, data)` until both streams end, the script has exited and its children are silent, or `deadline`."""
    last_data = time.monotonic()
    with selectors.DefaultSelector() as selector:
        selector.register(channel.fileno(), selectors.EVENT_READ)
        while time.monotonic() < deadline:
            data = list(_buffered(channel))
            if data:
                yield from data
                last_data = time.monotonic()
                continue
            silent = time.monotonic() > last_data + _CHILD_SILENCE_S
            if channel.exit_status_ready() and (channel.closed or channel.eof_received or silent):
                while data := list(_buffered(channel)):  # what arrived between the reading above and the end
                    yield from data
                return
            if channel.eof_received and not channel.exit_status_ready():
                time.sleep(0.002)  # the descriptor stays readable after the end of the streams; the status follows
            else:
                selector.select(min(0.1, max(0.0, deadline - time.monotonic())))


def _buffered(channel: paramiko.Channel) -> Iterator[tuple[bool, bytes]]:
    if channel.recv_ready():
        yield False, channel.recv(1 << 16)
    if channel.recv_stderr_ready():
        yield True, channel.recv_stderr(1 << 16)
