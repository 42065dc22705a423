"""The two directions of an SSH channel, each with an end that holds."""

from __future__ import annotations

import contextlib
import selectors
import time
from collections.abc import Iterator

import paramiko

LOST = (OSError, EOFError, paramiko.SSHException)
_QUIET_S = 0.3  # after a script has ended: how long a child that kept its pipe may stay silent before nobody listens


def send(channel: paramiko.Channel, data: bytes) -> None:
    """All of it, then the end of input; to be run beside `read`, since either side may block."""
    with contextlib.suppress(*LOST):  # the reader sees the same end
        channel.sendall(data)
        channel.shutdown_write()


def read(channel: paramiko.Channel, deadline: float) -> Iterator[tuple[bool, bytes]]:
    """What comes on standard output (False) and error (True) until both end, or the script does and its heirs are silent."""
    heard = time.monotonic()
    with selectors.DefaultSelector() as selector:
        selector.register(channel.fileno(), selectors.EVENT_READ)
        while time.monotonic() < deadline:
            ready = False
            if channel.recv_ready():
                yield False, channel.recv(1 << 16)
                ready = True
            if channel.recv_stderr_ready():
                yield True, channel.recv_stderr(1 << 16)
                ready = True
            if ready:
                heard = time.monotonic()
                continue
            if channel.exit_status_ready() and (channel.closed or channel.eof_received or time.monotonic() > heard + _QUIET_S):
                # What arrived between the look and the end is still to be had.
                while channel.recv_ready():
                    yield False, channel.recv(1 << 16)
                while channel.recv_stderr_ready():
                    yield True, channel.recv_stderr(1 << 16)
                return
            if channel.eof_received and not channel.exit_status_ready():
                time.sleep(0.002)  # the descriptor stays readable after the end: the status follows
            else:
                selector.select(min(0.1, max(0.0, deadline - time.monotonic())))
