"""A process's end of the channel to its supervisor, which carries heartbeats and says when nothing may move.

The channel is the process's standard input. The kernel closes it when the supervisor dies, and the process then exits, too.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import stat
import threading
import time

from lupin_runtime.ending import exit_within
from lupin_runtime.heartbeat import MAX_BYTES, SUPERVISOR_TIMEOUT_S, Beat, decode, encode

ORPHAN_GRACE_S = 5.0
SUPERVISOR_SILENT = "the supervisor does not respond"


class Supervision:
    """The channel at descriptor `stream`. Without a supervisor nothing is sent, and nothing forbids motion."""

    def __init__(self, stream: int = 0) -> None:
        self._stream = stream
        self._socket = _beat_socket(stream)
        self._received: Beat | None = None

    def start(self) -> None:
        """Terminate this process when the stream ends: send SIGTERM, and exit if it still runs after ORPHAN_GRACE_S.

        A stream that is neither a pipe nor a socket, such as a terminal, is ignored.
        """
        mode = _mode(self._stream)
        if stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode):
            threading.Thread(target=self._follow, name="supervision", daemon=True).start()

    def beat(self, responded_ns: int, node: str) -> None:
        """Send a heartbeat: `node`, the slowest one, handled its events up to `responded_ns` of CLOCK_MONOTONIC."""
        if self._socket is None:
            return
        # If the supervisor does not read, it judges by the heartbeats that it has received.
        with contextlib.suppress(OSError):
            self._socket.send(encode(Beat(responded_ns, node)), socket.MSG_DONTWAIT)

    def motion_hold(self) -> str:
        """Return why nothing may move now: the supervisor's reason, or that it is silent; empty if motion is allowed."""
        received = self._received
        if received is None:
            return ""
        silent_ns = time.monotonic_ns() - received.time_ns
        return SUPERVISOR_SILENT if silent_ns > SUPERVISOR_TIMEOUT_S * 1e9 else received.text

    def _follow(self) -> None:
        while packet := self._read():
            self._received = decode(packet) or self._received
        exit_within(ORPHAN_GRACE_S)
        os.kill(os.getpid(), signal.SIGTERM)

    def _read(self) -> bytes:
        try:
            return os.read(self._stream, MAX_BYTES)
        except OSError:
            return b""  # a reset: the supervisor was killed before it read the last heartbeats


def end_with_parent() -> None:
    """Terminate this process when its standard input ends, see `Supervision.start`."""
    Supervision().start()


def _mode(stream: int) -> int:
    """Return the file mode of a descriptor; 0 if it is closed."""
    try:
        return os.fstat(stream).st_mode
    except OSError:
        return 0


def _beat_socket(stream: int) -> socket.socket | None:
    """Return the stream as a socket for heartbeats, or None. A remote shell's input is a socket, too, but of another type."""
    if not stat.S_ISSOCK(_mode(stream)):
        return None
    channel = socket.socket(fileno=os.dup(stream))
    if (channel.family, channel.type) != (socket.AF_UNIX, socket.SOCK_SEQPACKET):
        channel.close()
        return None
    return channel
