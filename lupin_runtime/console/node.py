"""`lupin_console`: serves the graph to browsers and other clients."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path
from typing import Any

from rclpy.clock import Clock, ClockType

from lupin_runtime.console.authority import Authority, Role
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.certificate import CertificateError, ServerCertificate
from lupin_runtime.console.command_journal import CommandJournal
from lupin_runtime.console.console_events import ConsoleEvent
from lupin_runtime.console.description import ConsoleDescription, remove_description
from lupin_runtime.console.manual_control import STOP_PERIOD_S
from lupin_runtime.console.pairing import PairingCodes
from lupin_runtime.console.program import LUPIN
from lupin_runtime.console.publisher_pool import UNREGISTER_AFTER_S
from lupin_runtime.console.run_files import last_commands
from lupin_runtime.console.run_history import RunHistory
from lupin_runtime.console.server import ConsoleServer
from lupin_runtime.console.sessions import Sessions, sessions_file
from lupin_runtime.mission.overrides import OVERRIDES_NAME
from lupin_runtime.ports import CONSOLE_PORT, ROSBRIDGE_PORT, VIDEO_PORT
from lupin_runtime.ros import LupinNode
from lupin_runtime.stack.runs import Run, make_state_folder

JOURNAL = "console_commands.jsonl"
MAX_MISSED_TURNS = 6  # an event loop that misses this many turns, one every STOP_PERIOD_S, hangs


class Console(LupinNode):
    """The console as a node.

    Parameters: `host` and `port` for browsers, `rosbridge_host` and `rosbridge_port` for other programs (port 0: any free one;
    an empty host: all of this computer's addresses), `tls` (serve HTTPS too, and redirect browsers on other computers to it),
    `video_target` (the URL of the video server [the robot's, or this computer's]), `folder` (of the command journal and
    `console.json`), `overrides_file` (the approach overrides that the mission reads), `sessions_file` (the paired browsers),
    `unlisted` (clients may also use topics, services and actions that the graph's table does not contain), `unregister_after_s`
    (how long a publisher that no client uses is kept).
    If `rosbridge_port` is in use, only browsers are served. Raises OSError if `port` is in use.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("lupin_console", parameters)
        logger = self.get_logger()
        run_folder = self.parameter("folder", "")
        folder = Path(run_folder or sessions_file().parent)
        make_state_folder(folder)
        self._journal = CommandJournal(folder / JOURNAL, logger.warning)
        # The events of an earlier console of this run. The folder of a console that belongs to no run has those of many days.
        rows = last_commands(folder / JOURNAL) if run_folder else []
        history = RunHistory(self, self._journal, rows)

        def log_control_change(event: ConsoleEvent) -> None:
            logger.info(event.text)
            history.note(event)

        authority = Authority(log_control_change, allow_unlisted=self.parameter("unlisted", False))
        bridge = Bridge(
            self,
            authority,
            os.environ.get("ROS_DISTRO", "jazzy"),
            self.parameter("unregister_after_s", UNREGISTER_AFTER_S),
            self._journal.record,
            history,
        )
        sessions = Sessions(Path(self.parameter("sessions_file", "") or sessions_file()))
        self._folder = folder
        self._codes = PairingCodes(self._describe, time.monotonic_ns())
        self._host, rosbridge_host = self.parameter("host", "127.0.0.1"), self.parameter("rosbridge_host", "127.0.0.1")
        certificate = self._certificate() if self.parameter("tls", False) else None
        self._tls = certificate is not None
        self._server = ConsoleServer(
            bridge,
            sessions,
            self._codes,
            Run(folder),
            (self._host, self.parameter("port", CONSOLE_PORT)),
            (rosbridge_host, self.parameter("rosbridge_port", ROSBRIDGE_PORT)),
            certificate,
            LUPIN,
            self.parameter("video_target", "") or _video_target(),
            Path(self.parameter("overrides_file", "") or folder / OVERRIDES_NAME),
            logger.warning,
        )
        try:
            self.port, self.rosbridge_port = self._server.start()
        except OSError:
            # If only one of the two ports is free, nothing is left open on it or on the graph.
            self._server.stop()
            self._journal.close()
            self.destroy_node()
            raise
        with contextlib.suppress(OSError):  # on a full disk; the server tries again and reports it
            self._codes.announce()
        programs = f"; rosbridge for programs: ws://{rosbridge_host}:{self.rosbridge_port}" if self.rosbridge_port else ""
        logger.info(f"console: http://{self._host}:{self.port}{programs}")
        self._last_turns = self._missed = 0
        self._stopping = False
        self.create_timer(STOP_PERIOD_S, self._watch_event_loop, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _certificate(self) -> ServerCertificate | None:
        """Load the certificate. If that fails, return None and serve only this computer, which needs no encryption."""
        try:
            return ServerCertificate()
        except CertificateError as error:
            self.get_logger().error(f"no HTTPS, so only browsers on this computer are served: {error}")
            self._host = "127.0.0.1"
            return None

    def _describe(self) -> None:
        codes = {role.value: self._codes.code(role) for role in Role}
        ConsoleDescription(os.getpid(), self._host, self.port, self.rosbridge_port, codes, self._tls).write(self._folder)

    def _watch_event_loop(self) -> None:
        """Raise RuntimeError, which ends the process, if the event loop hangs: the supervisor watches only this executor."""
        if self._stopping:
            return
        turns = self._server.turns
        self._missed = self._missed + 1 if turns == self._last_turns else 0
        self._last_turns = turns
        if self._missed >= MAX_MISSED_TURNS:
            raise RuntimeError(f"the console's event loop has not responded for {MAX_MISSED_TURNS * STOP_PERIOD_S:g} s")

    def before_shutdown(self) -> None:
        """Close all connections. If a client was driving, this stops the robot."""
        self._stopping = True
        self._server.stop()
        remove_description(self._folder)
        self._journal.close()


def _video_target() -> str:
    """Return the video server's URL: on the robot, which is also the discovery server, or on this computer if simulated."""
    servers = [each.strip() for each in os.environ.get("ROS_DISCOVERY_SERVER", "").split(";")]
    host = next(filter(None, servers), "").rsplit(":", 1)[0]
    return f"http://{host or '127.0.0.1'}:{VIDEO_PORT}"
