"""Cancels all goals of some actions, whatever client sent them."""

from __future__ import annotations

from collections.abc import Iterable

from action_msgs.srv import CancelGoal
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.task import Future

from lupin_runtime.ros.node import LupinNode


class GoalCanceler:
    """Clients of the cancel services of the named actions. Call it on the executor's thread."""

    def __init__(self, node: LupinNode, actions: Iterable[str], group: CallbackGroup | None = None) -> None:
        self._pending: dict[Client, Future | None] = {
            node.create_client(CancelGoal, f"{action}/_action/cancel_goal", callback_group=group): None for action in actions
        }

    def cancel_all(self) -> None:
        """Request the cancellation of every goal, without waiting. A server that is not there has no goals."""
        for client, pending in self._pending.items():
            if pending is not None and not pending.done():
                client.remove_pending_request(pending)
            # A request without an id and a stamp means every goal (action_msgs/CancelGoal).
            self._pending[client] = client.call_async(CancelGoal.Request()) if client.service_is_ready() else None
