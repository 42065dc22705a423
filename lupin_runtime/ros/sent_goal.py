"""A goal of an action that can be cancelled from the moment it is sent."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID


class SentGoal:
    """A goal under an id of the client's own choice. It is sent by the constructor.

    rclpy gives a goal its handle with the server's answer. If that answer is lost, the server works on a goal that cannot be
    cancelled. `handle` exists at once, but only that of `answer` tells whether the goal was accepted. A cancel request may
    overtake the goal: repeat it until it is answered with the goal.
    """

    def __init__(self, client: ActionClient, action: Any, goal: Any, on_feedback: Callable[[Any], None] | None = None) -> None:
        goal_id = UUID(uuid=list(uuid.uuid4().bytes))
        self.handle = ClientGoalHandle(client, goal_id, action.Impl.SendGoalService.Response())
        self.answer: Future = client.send_goal_async(goal, on_feedback, goal_uuid=goal_id)
