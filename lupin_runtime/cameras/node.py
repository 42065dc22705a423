"""`lupin_video`: serves the images of the graph's cameras over HTTP."""

from __future__ import annotations

import concurrent.futures
import errno
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from lupin_runtime.cameras.http_server import VideoHttpServer
from lupin_runtime.cameras.stream_request import Source
from lupin_runtime.cameras.video_streams import GraphSilent, VideoStreams
from lupin_runtime.ports import VIDEO_PORT
from lupin_runtime.ros import LupinNode
from lupin_runtime.ros.interfaces import interface
from lupin_runtime.ros.raw_subscription import RawSubscription
from lupin_runtime.ros.ros_thread import RosThread

_GRAPH_TIMEOUT_S = 5.0
_FOLLOW_PERIOD_S = 1.0


class VideoServer(LupinNode):
    """The video server as a node.

    Parameters: `host` and `port` (0: any free one). Raises OSError if the port is in use.
    """

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        super().__init__("lupin_video", parameters)
        host, port = self.parameter("host", "127.0.0.1"), self.parameter("port", VIDEO_PORT)
        self._graph = _Graph(self)
        streams = VideoStreams(self._graph, self.get_logger().warning)
        try:
            self._server = VideoHttpServer(host, port, streams)
        except OSError as error:
            self.destroy_node()
            if error.errno == errno.EADDRINUSE:
                raise OSError(
                    errno.EADDRINUSE, f"port {port} is in use; show its owner with: ss -ltnp 'sport = :{port}'"
                ) from error
            raise
        self.port = self._server.port
        self._server.start()
        self.create_timer(_FOLLOW_PERIOD_S, self._graph.follow_publishers, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.get_logger().info(f"video: http://{host}:{self.port}/")

    def before_shutdown(self) -> None:
        """End all streams."""
        self._server.stop()


class _Graph:
    """Gives threads other than the executor's access to the graph's topics."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._ros = RosThread(node)
        self._subscriptions: set[RawSubscription] = set()

    def publishers(self) -> Mapping[str, Sequence[str]]:
        """Return the image topics that have a publisher, with their types. Raises GraphSilent."""
        published: dict[str, Sequence[str]] = self._call(self._published)
        return published

    def subscribe(self, source: Source, receive: Callable[[bytes], None]) -> Callable[[], None]:
        """Receive a topic's messages until the returned function is called. Raises GraphSilent."""
        subscription: RawSubscription = self._call(lambda: self._open(source, receive))

        def unsubscribe() -> None:
            self._ros.run(lambda: self._close(subscription))

        return unsubscribe

    def follow_publishers(self) -> None:
        """Reopen subscriptions whose publishers now offer another QoS."""
        for subscription in self._subscriptions:
            subscription.follow_publishers()

    def _published(self) -> dict[str, Sequence[str]]:
        return {
            name: types
            for name, types in self._node.get_topic_names_and_types()
            if any("Image" in kind for kind in types) and self._node.count_publishers(name)
        }

    def _open(self, source: Source, receive: Callable[[bytes], None]) -> RawSubscription:
        message_class = interface("sensor_msgs/msg/CompressedImage" if source.compressed else "sensor_msgs/msg/Image")
        subscription = RawSubscription(self._node, source.topic, message_class, receive, depth=1)
        self._subscriptions.add(subscription)
        return subscription

    def _close(self, subscription: RawSubscription) -> None:
        self._subscriptions.discard(subscription)
        subscription.close()

    def _call(self, function: Callable[[], Any]) -> Any:
        """Call a function on the executor's thread and return its result. Raises GraphSilent."""
        try:
            return self._ros.run(function).result(_GRAPH_TIMEOUT_S)
        except concurrent.futures.TimeoutError as error:
            raise GraphSilent(f"the graph has not responded for {_GRAPH_TIMEOUT_S:g} s") from error
