"""Serialized messages of a topic, from a subscription whose QoS follows the topic's publishers."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.subscription import Subscription

from lupin_runtime import graph
from lupin_runtime.ros.node import qos_profile

QUEUE_DEPTH = 100  # for topics that are not in the graph's table


class RawSubscription:
    """Passes on every serialized message of a topic; `receive` is called on the thread of the node's executor.

    `qos` is what all present publishers offer. `kept` holds the last messages of a latched topic, for readers that join late.
    `depth` is the length of the queue; None uses that of the graph's table. All methods are called on the thread of the node's
    executor. For an invalid topic name the constructor raises what rclpy raises, a different class for each fault.
    """

    def __init__(
        self, node: Node, topic: str, message_class: Any, receive: Callable[[bytes], None], depth: int | None = None
    ) -> None:
        self._node = node
        self._topic = topic
        self._message_class = message_class
        self._receive = receive
        self._default = _default_qos(topic) if depth is None else replace(_default_qos(topic), depth=depth)
        self.qos = self._offered_qos() or self._default
        self.kept: deque[bytes] = deque()
        self._subscription: Subscription | None = None
        self._open()

    def follow_publishers(self) -> None:
        """Open the subscription again if the publishers now offer another QoS. Call it about once a second."""
        qos = self._offered_qos()
        if qos is not None and qos != self.qos:
            self.close()
            self.qos = qos
            self._open()

    def close(self) -> None:
        """Leave the topic."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _open(self) -> None:
        self.kept = deque(maxlen=self.qos.depth if self.qos.latched else 0)
        self._subscription = self._node.create_subscription(
            self._message_class, self._topic, self._take_all, qos_profile(self.qos), raw=True
        )

    def _take_all(self, data: bytes) -> None:
        """Pass on a message and all that wait behind it, because a cycle of the executor costs more than a message."""
        self._pass_on(data)
        for _ in range(self.qos.depth):
            subscription = self._subscription
            if subscription is None:
                return
            with subscription.handle:
                taken = subscription.handle.take_message(self._message_class, True)
            if taken is None:
                return
            self._pass_on(taken[0])

    def _pass_on(self, data: bytes) -> None:
        if self.qos.latched:
            self.kept.append(data)
        self._receive(data)

    def _offered_qos(self) -> graph.Qos | None:
        """Return what all present publishers offer; None without publishers."""
        offers = [info.qos_profile for info in self._node.get_publishers_info_by_topic(self._topic)]
        if not offers:
            return None
        return graph.Qos(
            reliable=all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers),
            latched=all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers),
            depth=self._default.depth,
        )


def _default_qos(topic: str) -> graph.Qos:
    """Return the QoS in the graph's table, or reliable for a topic that is not in it."""
    row = graph.topic(topic)
    return row.qos if row is not None else graph.Qos(reliable=True, depth=QUEUE_DEPTH)
