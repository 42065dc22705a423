"""Subscribes a node to the e-stop state through an EStopMonitor, so that every node releases by the same evidence."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.subscription import Subscription
from std_msgs.msg import Bool

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.safety.estop_monitor import EStopMonitor


def subscribe_estop(node: LupinNode, on_state: Callable[[bool], None], topic: graph.Topic = graph.ESTOP_STATE) -> Subscription:
    """Call `on_state` with every message of the e-stop state: whether the e-stop is engaged, by the rules of EStopMonitor."""
    monitor = EStopMonitor(lambda: node.count_publishers(topic.name))

    def receive(message: Bool) -> None:
        monitor.update(bool(message.data), time.monotonic_ns())
        on_state(monitor.engaged)

    return node.subscription(topic, receive)
