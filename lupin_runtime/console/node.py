"""`lupin_console`: serves the graph to browsers and other clients."""

from __future__ import annotations

import os
from typing import Any

from rclpy.clock import Clock, ClockType

from lupin_runtime.console.authority import Authority
from lupin_runtime.console.bridge import STOP_PERIOD_S, Bridge
from lupin_runtime.console.publisher_pool import UNREGISTER_AFTER_S
from lupin_runtime.console.server import ConsoleServer
from lupin_runtime.ros import LupinNode
from lupin_runtime.stack.table import ROSBRIDGE_PORT

MAX_MISSED_TURNS = 6  # of the event loop, each of STOP_PERIOD_S


class Console(LupinNode):
    """The console's server as a node.

    Parameters: `rosbridge_host` and `rosbridge_port` (0: any free one), `unlisted` (clients may also use topics, services and
    actions that the graph's table does not have), `unregister_after_s` (how long a publisher that no client uses is kept).
    Raises OSError where the port is in use.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("lupin_console", parameters)
        logger = self.get_logger()
        authority = Authority(logger.info, unlisted=self.parameter("unlisted", False))
        bridge = Bridge(
            self,
            authority,
            os.environ.get("ROS_DISTRO", "jazzy"),
            self.parameter("unregister_after_s", UNREGISTER_AFTER_S),
        )
        host = self.parameter("rosbridge_host", "127.0.0.1")
        self._server = ConsoleServer(bridge, host, self.parameter("rosbridge_port", ROSBRIDGE_PORT))
        self.rosbridge_port = self._server.start()
        logger.info(f"rosbridge for other clients: ws://{host}:{self.rosbridge_port}")
        self._seen_turns = self._missed = 0
        self.create_timer(STOP_PERIOD_S, self._watch_event_loop, clock=Clock(clock_type=ClockType.STEADY_TIME))

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
