"""Whether something drives the robot by its map now, so that the map must not be replaced."""

from __future__ import annotations

from typing import Any

from lupin_runtime import graph
from lupin_runtime.json_text import parse_json
from lupin_runtime.mission.hsm_spec import BUSY
from lupin_runtime.ros import LupinNode

# Reasons of refusals.
MISSION_RUNS = "a mission is running ({state}); abort it first, or wait for its end"
DRIVES_TO_GOAL = "the robot drives to a goal; cancel it first, or wait until it is there"


class MotionWatch:
    """Follows mission and drive bus. `update` is called on the executor's thread; `refusal` may be called on any."""

    def __init__(self, node: LupinNode) -> None:
        self._node = node
        self._mission = ""  # the lifecycle state; empty without a mission node
        self._winner = ""  # the input that drives; empty without a drive bus
        node.subscription(graph.MISSION_STATE, self._receive_mission)
        node.subscription(graph.DRIVE_STATUS, self._receive_status)

    def update(self) -> None:
        """Forget what a process said that is gone. To be called about twice a second."""
        if self._mission and not self._node.count_publishers(graph.MISSION_STATE.name):
            self._mission = ""
        if self._winner and not self._node.count_publishers(graph.DRIVE_STATUS.name):
            self._winner = ""

    def refusal(self) -> str:
        """Return why the map must not be replaced now, with what helps; empty if it may be."""
        if self._mission in BUSY:
            return MISSION_RUNS.format(state=self._mission)
        if self._winner == "auto":
            return DRIVES_TO_GOAL
        return ""

    def _receive_mission(self, message: Any) -> None:
        self._mission = str(message.lifecycle_state)

    def _receive_status(self, message: Any) -> None:
        try:
            winner = parse_json(message.data)["winner"]
        except (ValueError, KeyError, TypeError):
            winner = None
        self._winner = winner if isinstance(winner, str) else ""
