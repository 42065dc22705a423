"""Reports the state of a service to systemd: sd_notify(3), datagrams to the socket in NOTIFY_SOCKET."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import MutableMapping


class Notifier:
    """Sends notifications to the service manager that started this process; does nothing without one.

    It removes NOTIFY_SOCKET and WATCHDOG_USEC from `environment`, so that no child process sends notifications (sd_notify(3),
    Notes).
    """

    def __init__(self, environment: MutableMapping[str, str] | None = None) -> None:
        environment = os.environ if environment is None else environment
        address = environment.pop("NOTIFY_SOCKET", "")
        watchdog_us = environment.pop("WATCHDOG_USEC", "0")
        watchdog_pid = environment.pop("WATCHDOG_PID", str(os.getpid()))
        # A leading @ stands for the null byte of an abstract socket.
        self._address = f"\0{address[1:]}" if address.startswith("@") else address
        enabled = watchdog_pid == str(os.getpid()) and watchdog_us.isdigit()
        # Half of the limit, as sd_watchdog_enabled(3) advises; 0 without a watchdog.
        self.watchdog_period_s = int(watchdog_us) / 2e6 if enabled else 0.0
        self._watchdog_due_s = 0.0
        self._status = ""

    def ready(self) -> None:
        """Report that the service is up, so that units ordered after it may start."""
        self._send("READY=1")

    def stopping(self) -> None:
        """Report that the service is stopping."""
        self._send("STOPPING=1")

    def status(self, text: str) -> None:
        """Set the line that `systemctl status` shows; an unchanged line is not sent again."""
        line = " ".join(text.split())
        if line != self._status:
            self._status = line
            self._send(f"STATUS={line}")

    def alive(self) -> None:
        """Notify the watchdog when it is due; call it in every iteration of the main loop."""
        now = time.monotonic()
        if self.watchdog_period_s and now >= self._watchdog_due_s:
            self._watchdog_due_s = now + self.watchdog_period_s
            self._send("WATCHDOG=1")

    def _send(self, text: str) -> None:
        if not self._address:
            return
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
            # A busy service manager must not block the service.
            channel.settimeout(1.0)
            try:
                channel.sendto(text.encode(), self._address)
            except OSError as error:
                print(f"systemd did not receive {text.partition('=')[0]}: {error.strerror or error}", flush=True)
