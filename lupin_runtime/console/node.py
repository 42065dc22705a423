"""`lupin_console`: serves the graph to browsers and other clients."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

from rclpy.clock import Clock, ClockType

from lupin_runtime.console.authority import Authority, Role
from lupin_runtime.console.bridge import STOP_PERIOD_S, Bridge
from lupin_runtime.console.certificate import CertificateError, ServerCertificate
from lupin_runtime.console.command_journal import CommandJournal
from lupin_runtime.console.description import ConsoleDescription, remove_description
from lupin_runtime.console.pairing import PairingCodes
from lupin_runtime.console.publisher_pool import UNREGISTER_AFTER_S
from lupin_runtime.console.server import ConsoleServer
from lupin_runtime.console.sessions import Sessions, sessions_file
from lupin_runtime.ros import LupinNode
from lupin_runtime.stack.runs import Run
from lupin_runtime.stack.table import CONSOLE_PORT, DOCTOR, ROSBRIDGE_PORT, VIDEO_PORT

JOURNAL = "console_commands.jsonl"
MAX_MISSED_TURNS = 6  # of the event loop, each of STOP_PERIOD_S


class Console(LupinNode):
    """The console's server as a node.

    Parameters: `host` and `port` of the one origin, `rosbridge_host` and `rosbridge_port` (port 0: any free one; an empty
    host: all of this computer's addresses), `tls` (HTTPS on the one origin, to which browsers of other computers are sent),
    `video_target` (the URL of the video server [the robot's, or this computer's]), `folder` (where the journal of commands and
    `console.json` are written), `sessions_file` (the paired browsers), `unlisted` (clients may also use topics, services and
    actions that the graph's table does not have), `unregister_after_s` (how long a publisher that no client uses is kept).
    Raises OSError where a port is in use.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("lupin_console", parameters)
        logger = self.get_logger()
        folder = Path(self.parameter("folder", "") or sessions_file().parent)
        folder.mkdir(parents=True, exist_ok=True)
        self._journal = CommandJournal(folder / JOURNAL)
        record = self._journal.record

        def note_control(line: str) -> None:
            logger.info(line)
            record("control", line)

        authority = Authority(note_control, unlisted=self.parameter("unlisted", False))
        bridge = Bridge(
            self,
            authority,
            os.environ.get("ROS_DISTRO", "jazzy"),
            self.parameter("unregister_after_s", UNREGISTER_AFTER_S),
            record,
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
            DOCTOR,
            self.parameter("video_target", "") or _video_target(),
            logger.warning,
        )
        try:
            self.port, self.rosbridge_port = self._server.start()
        except OSError:
            # Nothing of it is left on the graph or on a port where one of the two ports was free.
            self._server.stop()
            self._journal.close()
            self.destroy_node()
            raise
        self._describe()
        logger.info(
            f"console: http://{self._host}:{self.port}; rosbridge for other clients: ws://{rosbridge_host}:{self.rosbridge_port}"
        )
        self._seen_turns = self._missed = 0
        self.create_timer(STOP_PERIOD_S, self._watch_event_loop, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _certificate(self) -> ServerCertificate | None:
        """None where there can be none; this computer alone is served then, which needs no encryption."""
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
        """Raise where the event loop hangs, which ends the process: the supervisor sees only that this executor works."""
        turns = self._server.turns
        self._missed = self._missed + 1 if turns == self._seen_turns else 0
        self._seen_turns = turns
        if self._missed >= MAX_MISSED_TURNS:
            raise RuntimeError(f"the console's event loop has not responded for {MAX_MISSED_TURNS * STOP_PERIOD_S:g} s")

    def before_shutdown(self) -> None:
        """Close all connections, which stops a robot that one of them drives."""
        self._server.stop()
        remove_description(self._folder)
        self._journal.close()


def _video_target() -> str:
    """Where the pictures are: at the robot, which serves discovery, or on this computer for a simulated one."""
    servers = [each.strip() for each in os.environ.get("ROS_DISCOVERY_SERVER", "").split(";")]
    host = next(filter(None, servers), "").rsplit(":", 1)[0]
    return f"http://{host or '127.0.0.1'}:{VIDEO_PORT}"
