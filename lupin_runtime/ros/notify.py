"""Tells systemd how a service is doing: sd_notify(3), a datagram to the socket that the service manager names."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import MutableMapping


class Notifier:
    """Speaks to the service manager that started this process; says nothing where none did.

    Takes NOTIFY_SOCKET and WATCHDOG_USEC out of `environment`, so that no child speaks in our name (sd_notify(3), Notes).
    """

    def __init__(self, environment: MutableMapping[str, str] | None = None) -> None:
        environment = os.environ if environment is None else environment
        address = environment.pop("NOTIFY_SOCKET", "")
        watchdog_us = environment.pop("WATCHDOG_USEC", "0")
        meant_for = environment.pop("WATCHDOG_PID", str(os.getpid()))
        # A leading @ stands for the zero byte of an abstract socket.
        self._address = f"\0{address[1:]}" if address.startswith("@") else address
        mine = meant_for == str(os.getpid()) and watchdog_us.isdigit()
        # Twice within the limit, as sd_watchdog_enabled(3) advises; 0 where nobody watches.
        self.watchdog_period_s = int(watchdog_us) / 2e6 if mine else 0.0
        self._watchdog_due_s = 0.0
        self._status = ""

    def ready(self) -> None:
        """The service is up: what is ordered after it may start."""
        self._send("READY=1")

    def stopping(self) -> None:
        """The service has begun to end."""
        self._send("STOPPING=1")

    def status(self, text: str) -> None:
        """One line for `systemctl status`; what was said last is not said again."""
        line = " ".join(text.split())
        if line != self._status:
            self._status = line
            self._send(f"STATUS={line}")

    def alive(self) -> None:
        """Say so to the watchdog when it is due; call it at every turn of the main loop."""
        now = time.monotonic()
        if self.watchdog_period_s and now >= self._watchdog_due_s:
            self._watchdog_due_s = now + self.watchdog_period_s
            self._send("WATCHDOG=1")

    def _send(self, text: str) -> None:
        if not self._address:
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
            # A service manager too busy to take a line must not hold the service up.
            channel.settimeout(1.0)
            try:
                channel.sendto(text.encode(), self._address)
            except OSError as error:
                print(f"systemd does not hear {text.partition('=')[0]}: {error.strerror or error}", flush=True)
