"""The server of foxglove-sdk, restricted to what Lupin uses: channels only, without anything that clients could change."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable

import foxglove
from foxglove import Context
from foxglove.websocket import Capability, ChannelView, Client, ServerListener

from lupin_runtime.console.ports import check_free

# How many messages may wait for a slow client before the oldest is dropped. The SDK's 1024 would be 1 GB of raw images.
MESSAGE_BACKLOG = 128
_STOP_TIMEOUT_S = 2.0

OnChange = Callable[[int, int], None]


class _Listener(ServerListener):
    def __init__(self, on_subscribe: OnChange, on_unsubscribe: OnChange) -> None:
        self._subscribe = on_subscribe
        self._unsubscribe = on_unsubscribe

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        self._subscribe(channel.id, client.id)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        self._unsubscribe(channel.id, client.id)


class FoxgloveServer:
    """Serves the channels of a context. Port 0 is any free one. Raises PortInUse if the port is in use.

    `on_subscribe` and `on_unsubscribe` are called with the ids of channel and client, on the SDK's thread and possibly while it
    holds its locks, so they must only pass the work to another thread.
    """

    def __init__(
        self,
        context: Context,
        host: str,
        port: int,
        on_subscribe: OnChange,
        on_unsubscribe: OnChange,
        announces_time: bool,
    ) -> None:
        # A message for one client is addressed by the id of its sink, which the SDK does not report. Client and sink ids are
        # equal, but the SDK assigns them in two steps: with a second thread, two clients that connect at the same time could
        # get each other's number.
        os.environ["TOKIO_WORKER_THREADS"] = "1"
        # The SDK logs through Python while it holds its locks. A Python thread that waits for one of those locks meanwhile
        # would cause a deadlock.
        foxglove.set_log_level("CRITICAL")
        try:
            self._server = foxglove.start_server(
                name="Lupin",
                host=host,
                port=port,
                context=context,
                capabilities=[Capability.Time] if announces_time else [],
                server_listener=_Listener(on_subscribe, on_unsubscribe),
                message_backlog_size=MESSAGE_BACKLOG,
            )
        except RuntimeError:
            check_free(host, port)  # raises PortInUse, which names the owner
            raise
        self.port = self._server.port
        # The SDK raises if another of its methods is called while `stop` is running.
        self._lock = threading.Lock()
        self._stopped = False

    def announce_time(self, time_ns: int) -> None:
        """Send the graph's time to all clients."""
        with self._lock:
            if not self._stopped:
                self._server.broadcast_time(time_ns)

    def stop(self) -> None:
        """Disconnect all clients. One that does not read stays connected until the process exits."""
        with self._lock:
            if self._stopped:
                return
            self._stopped = True
        stopping = threading.Thread(target=self._server.stop, name="foxglove stop", daemon=True)
        stopping.start()
        stopping.join(_STOP_TIMEOUT_S)
