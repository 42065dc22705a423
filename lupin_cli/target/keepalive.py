"""Watches a connection while something is waited for on it.

TCP notices a dead way, but neither a robot whose kernel acknowledges everything while nothing in it runs, nor a gateway that
does so for a robot which is gone.
"""

from __future__ import annotations

import contextlib
import threading
import time

import paramiko

from lupin_cli.target.channel import LOST

ASK_AFTER_S = 5.0
# The question waits behind what was sent before it: two megabytes of window, at no less than 70 kB/s.
ANSWER_S = 30.0


class Watch:
    """Closes a connection that answers nothing, and any at the deadline: paramiko waits for some answers without a bound."""

    def __init__(self, transport: paramiko.Transport, bound_s: float) -> None:
        self.transport = transport
        self.silent = False  # it was closed since it answered nothing
        self._deadline = time.monotonic() + bound_s
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="lupin-keepalive", daemon=True)

    def __enter__(self) -> Watch:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()

    @property
    def why(self) -> str:
        """Why the connection is gone."""
        return f"it takes what is sent and has answered nothing for {ANSWER_S:g} s" if self.silent else "it hung up"

    def _watch(self) -> None:
        while (left_s := self._deadline - time.monotonic()) > 0:
            if self._ended.wait(min(ASK_AFTER_S, left_s)):
                return
            if left_s > ASK_AFTER_S:
                self._ask(min(ANSWER_S, self._deadline - time.monotonic()))
        self.transport.close()

    def _ask(self, patience_s: float) -> None:
        """What OpenSSH's own client asks: every server answers, be it that it doesn't know the question."""
        give_up = threading.Timer(max(0.0, patience_s), self._give_up)
        give_up.daemon = True
        give_up.start()
        with contextlib.suppress(*LOST):  # whoever waits on the connection sees the same end
            self.transport.global_request("keepalive@openssh.com", wait=True)
        give_up.cancel()

    def _give_up(self) -> None:
        self.silent = time.monotonic() < self._deadline
        self.transport.close()
