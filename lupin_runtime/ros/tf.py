"""Publishes and receives transforms on `/tf` and `/tf_static`; the ROS wheels have no tf2_ros."""

from __future__ import annotations

from geometry_msgs.msg import TransformStamped
from rclpy.publisher import Publisher
from tf2_msgs.msg import TFMessage

from lupin_runtime import graph
from lupin_runtime.ros.node import LupinNode
from lupin_runtime.ros.stamps import stamp_from_ns, stamp_ns
from lupin_runtime.transforms import Transform, TransformTree


def to_message(parent: str, child: str, time_ns: int, transform: Transform) -> TransformStamped:
    """Return the TransformStamped of `transform`, which is `parent_from_child`."""
    message = TransformStamped()
    message.header.stamp = stamp_from_ns(time_ns)
    message.header.frame_id = parent
    message.child_frame_id = child
    t, q = message.transform.translation, message.transform.rotation
    t.x, t.y, t.z = transform.translation
    q.x, q.y, q.z, q.w = transform.rotation
    return message


def from_message(message: TransformStamped) -> Transform:
    """Return the transform `parent_from_child` of a TransformStamped."""
    t, q = message.transform.translation, message.transform.rotation
    return Transform((t.x, t.y, t.z), (q.x, q.y, q.z, q.w))


# A reliable subscription delivers in order: on a WiFi link that loses 2 % of the packets, every second transform of a stream of
# 50 Hz then waits 0.14 s or more for one that was lost, and some wait for 2 s. The next transform is better than a late one.
STREAM_QOS = graph.BEST100


class TransformListener:
    """Fills a TransformTree from the graph; its callbacks run on the executor of its node."""

    def __init__(self, node: LupinNode, tree: TransformTree | None = None) -> None:
        self.tree = tree or TransformTree()
        self._node = node
        self._subscriptions = (
            node.subscription(graph.TF, lambda message: self._take(message, static=False), STREAM_QOS),
            node.subscription(graph.TF_STATIC, lambda message: self._take(message, static=True)),
        )

    def close(self) -> None:
        """Unsubscribe; the tree keeps its transforms."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _take(self, message: TFMessage, static: bool) -> None:
        for item in message.transforms:
            try:
                self.tree.insert(
                    item.header.frame_id, item.child_frame_id, stamp_ns(item.header.stamp), from_message(item), static
                )
            except ValueError as error:
                self._node.get_logger().warning(f"transform dropped: {error}", throttle_duration_sec=5.0)


class TransformBroadcaster:
    """Publishes moving transforms on `/tf`, fixed ones latched on `/tf_static`."""

    def __init__(self, node: LupinNode) -> None:
        self._node = node
        self._moving = node.publisher(graph.TF)
        self._fixed_publisher: Publisher | None = None
        self._fixed: dict[str, TransformStamped] = {}

    def send(self, *transforms: TransformStamped) -> None:
        """Publish moving transforms in one message."""
        self._moving.publish(TFMessage(transforms=list(transforms)))

    def send_static(self, *transforms: TransformStamped) -> None:
        """Publish fixed transforms in one message with all earlier ones, since a late joiner receives only the last message."""
        if self._fixed_publisher is None:
            self._fixed_publisher = self._node.publisher(graph.TF_STATIC)
        self._fixed.update((item.child_frame_id, item) for item in transforms)
        self._fixed_publisher.publish(TFMessage(transforms=list(self._fixed.values())))
