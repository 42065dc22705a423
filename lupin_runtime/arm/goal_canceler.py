"""Cancels all goals of the vendor's arm and gripper controllers, whatever client sent them."""

from __future__ import annotations

from action_msgs.srv import CancelGoal
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.task import Future

from lupin_runtime import graph
from lupin_runtime.ros import LupinNode


class GoalCanceler:
    """Clients of the cancel services of both controllers. Call it on the executor's thread."""

    def __init__(self, node: LupinNode, group: CallbackGroup | None = None) -> None:
        self._pending: dict[Client, Future | None] = {
            node.create_client(CancelGoal, f"{row.name}/_action/cancel_goal", callback_group=group): None
            for row in (graph.GRIPPER_COMMAND, graph.ARM_FOLLOW_TRAJECTORY)
        }

    def cancel_all(self) -> None:
        """Request the cancellation of every goal, without waiting. A server that is not there has no goals."""
        for client, pending in self._pending.items():
            if pending is not None and not pending.done():
                client.remove_pending_request(pending)
            # A request without an id and a stamp means every goal (action_msgs/CancelGoal).
            self._pending[client] = client.call_async(CancelGoal.Request()) if client.service_is_ready() else None
