"""Has a function called by the thread that spins a node, whichever thread asks for it."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node


class Wake:
    """A guard condition that is never lost: after `trigger()`, the executor calls the function at least once.

    Fast DDS's wait set asks each guard condition whether it is triggered, and resets it in a second step, also if it was not: a
    trigger between the two is lost (https://github.com/ros2/rmw_fastrtps/pull/895). Executors trigger again, before they wait,
    what was seen and not handled; a trigger counts as seen here from the beginning.
    """

    def __init__(self, node: Node, function: Callable[[], object], group: CallbackGroup | None = None) -> None:
        self._guard = node.create_guard_condition(function, callback_group=group)

    def trigger(self) -> None:
        """Have the function called soon; calls of `trigger` that come before it may share one."""
        self._guard._executor_triggered = True
        self._guard.trigger()
