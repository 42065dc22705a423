"""The state of a managed node (`get_state`), which clients of Nav2 and slam_toolbox wait for before they send anything."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lifecycle_msgs.msg import State
from rclpy.service import Service as RosService

from lupin_runtime.graph import Service
from lupin_runtime.ros.node import LupinNode


def serve_state(node: LupinNode, row: Service, is_active: Callable[[], bool]) -> RosService:
    """Answer `row` (lifecycle_msgs/srv/GetState) with `active` or `inactive`.

    There is no `change_state`: the supervisor starts and stops processes instead.
    """

    def answer(_request: Any, response: Any) -> Any:
        state = State(id=State.PRIMARY_STATE_INACTIVE, label="inactive")
        if is_active():
            state = State(id=State.PRIMARY_STATE_ACTIVE, label="active")
        response.current_state = state
        return response

    return node.service(row, answer)
