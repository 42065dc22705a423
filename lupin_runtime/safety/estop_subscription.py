"""Subscribes a node to the e-stop, so that every node engages and releases on the same evidence."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.subscription import Subscription

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_runtime.safety.estop_monitor import EStopMonitor
from lupin_runtime.safety.unheard_press import UnheardPress


def subscribe_estop(
    node: LupinNode,
    on_state: Callable[[bool], None],
    topic: graph.Topic = graph.ESTOP_STATE,
    pressed_since_ns: int | None = None,
) -> tuple[Subscription, ...]:
    """Call `on_state` with every message: whether the e-stop is engaged, by the rules of EStopMonitor.

    A press since `pressed_since_ns` of the monotonic clock counts even if it is over; None stands for UnheardPress's default.
    """
    monitor = EStopMonitor(lambda: node.count_publishers(topic.name))

    def receive(stop: bool) -> None:
        monitor.update(stop, node.monotonic_ns())
        on_state(monitor.engaged)

    return subscribe_stops(node, receive, topic, pressed_since_ns)


def subscribe_stops(
    node: LupinNode,
    on_message: Callable[[bool], None],
    topic: graph.Topic = graph.ESTOP_STATE,
    pressed_since_ns: int | None = None,
) -> tuple[Subscription, ...]:
    """Call `on_message` with every message of the e-stop's state, and with True for a press that was missed.

    Either this node did not hear it (UnheardPress), or the e-stop's process did not. The process that replaces the latter makes
    up for a missed press with a short stop. On a busy machine a node may discover that process only after the stop has ended,
    but it discovered the drive process, which reports the missed press, long before.
    """
    missed = False
    unheard = UnheardPress(pressed_since_ns)

    def on_state(message: Any) -> None:
        on_message(bool(message.data) or missed)

    def on_missed_press(message: Any) -> None:
        nonlocal missed
        missed = bool(message.data)
        if missed:
            on_message(True)

    def on_status(message: Any) -> None:
        if unheard.status(message.data, node.monotonic_ns()):
            on_message(True)

    return (
        node.subscription(topic, on_state),
        node.subscription(graph.ESTOP_MISSED_PRESS, on_missed_press),
        node.subscription(graph.ESTOP_STATUS, on_status),
    )
