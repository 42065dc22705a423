"""`lupin_foxglove`: serves the graph to Foxglove and Lichtblick, read-only."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from foxglove import Context
from rclpy.clock import Clock, ClockType

from lupin_runtime.foxglove.channels import GraphChannels
from lupin_runtime.foxglove.server import FoxgloveServer
from lupin_runtime.ports import FOXGLOVE_PORT
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.ros_thread import RosThread

_FOLLOW_PERIOD_S = 0.5
_ANNOUNCE_TIME_PERIOD_S = 0.1


class FoxgloveBridge(LupinNode):
    """The Foxglove server as a node.

    Parameters: `host` and `port` (0: any free one). Raises PortInUse if the port is in use.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("lupin_foxglove", parameters)
        host = self.parameter("host", "127.0.0.1")
        context = Context()
        self._ros = RosThread(self)
        self._channels = GraphChannels(self, context, self._log_time_ns)
        try:
            self._server = FoxgloveServer(
                context,
                host,
                self.parameter("port", FOXGLOVE_PORT),
                on_subscribe=lambda channel, client: self._run(lambda: self._channels.add_client(channel, client)),
                on_unsubscribe=lambda channel, client: self._run(lambda: self._channels.remove_client(channel, client)),
                announces_time=self.simulated_time,
            )
        except OSError:
            self.destroy_node()
            raise
        self.port = self._server.port
        # Steady time: a stopped /clock must not keep channels from following the graph.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_FOLLOW_PERIOD_S, self._channels.follow_graph, clock=steady)
        if self.simulated_time:
            self.create_timer(_ANNOUNCE_TIME_PERIOD_S, self._announce_time, clock=steady)
        self.get_logger().info(f"Foxglove and Lichtblick connect to ws://{host}:{self.port}")

    def _announce_time(self) -> None:
        if (now_ns := self.now_ns()) > 0:  # 0 until the first message of /clock
            self._server.announce_time(now_ns)

    def _log_time_ns(self) -> int | None:
        return self.now_ns() if self.simulated_time else None

    def _run(self, function: Callable[[], None]) -> None:
        self._ros.run(function).add_done_callback(self._log_failure)

    def _log_failure(self, future: Future[None]) -> None:
        """Log a defect of the server, which would otherwise be lost."""
        error = future.exception()
        if error is not None:
            self.get_logger().error("".join(traceback.format_exception(error)))

    def before_shutdown(self) -> None:
        """Disconnect all clients."""
        self._server.stop()
