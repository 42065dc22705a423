"""Watch a connection while a command waits for something on it.

TCP notices a dead link. It does not notice a robot whose kernel acknowledges everything while no process runs, or a gateway
that acknowledges for a robot that is gone.
"""

from __future__ import annotations

import contextlib
import threading
import time

import paramiko

from lupin_cli.connection.channel import CONNECTION_ERRORS

KEEPALIVE_AFTER_S = 5.0
# The request queues behind the data sent before it, at most a channel's window of 2 MB: at 70 kB/s that takes 30 s.
ANSWER_TIMEOUT_S = 30.0


class ConnectionWatchdog:
    """Closes a connection that does not reply to keepalive requests, and any connection after `timeout_s`.

    The second limit is needed because some of paramiko's waits have no timeout.
    """

    def __init__(self, transport: paramiko.Transport, timeout_s: float) -> None:
        self.transport = transport
        self.timed_out = False  # the connection was closed because there was no reply
        self._deadline = time.monotonic() + timeout_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="lupin-keepalive", daemon=True)

    def __enter__(self) -> ConnectionWatchdog:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()

    @property
    def reason(self) -> str:
        """Why the connection is gone."""
        if self.timed_out:
            return f"the robot accepts data but has not replied for {ANSWER_TIMEOUT_S:g} s"
        return "the connection was closed"

    def _watch(self) -> None:
        while (left_s := self._deadline - time.monotonic()) > 0:
            if self._stop.wait(min(KEEPALIVE_AFTER_S, left_s)):
                return
            if left_s > KEEPALIVE_AFTER_S:
                self._send_keepalive(min(ANSWER_TIMEOUT_S, self._deadline - time.monotonic()))
        self.transport.close()

    def _send_keepalive(self, timeout_s: float) -> None:
        """Send OpenSSH's keepalive request: every server replies, at least with REQUEST_FAILURE."""
        timer = threading.Timer(max(0.0, timeout_s), self._close_unresponsive)
        timer.daemon = True
        timer.start()
        with contextlib.suppress(*CONNECTION_ERRORS):  # the command that waits on the connection gets the same error
            self.transport.global_request("keepalive@openssh.com", wait=True)
        timer.cancel()

    def _close_unresponsive(self) -> None:
        self.timed_out = time.monotonic() < self._deadline
        self.transport.close()
