"""Cancels all goals of some actions, whatever client sent them."""

from __future__ import annotations

from collections.abc import Iterable

from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Time
from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.task import Future

from lupin_runtime.ros.node import LupinNode

# Every action of Nav2's that moves the robot.
MOVING_ACTIONS = (
    *("/navigate_to_pose", "/navigate_through_poses", "/follow_waypoints", "/follow_path"),
    *("/spin", "/backup", "/drive_on_heading"),
)


class GoalCanceler:
    """Clients of the cancel services of the named actions. Call it on the executor's thread."""

    def __init__(self, node: LupinNode, actions: Iterable[str], group: CallbackGroup | None = None) -> None:
        self._pending: dict[Client, Future | None] = {
            node.create_client(CancelGoal, f"{action}/_action/cancel_goal", callback_group=group): None for action in actions
        }

    def cancel_all(self, until: Time | None = None) -> None:
        """Request the cancellation of every goal, or of those accepted `until` then, without waiting.

        A server that is not there has no goals.
        """
        # A request without an id means every goal, up to its stamp if it has one (action_msgs/CancelGoal).
        request = CancelGoal.Request(goal_info=GoalInfo(stamp=until or Time()))
        for client, pending in self._pending.items():
            if pending is not None and not pending.done():
                client.remove_pending_request(pending)
            self._pending[client] = client.call_async(request) if client.service_is_ready() else None
