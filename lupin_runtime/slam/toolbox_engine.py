"""slam_toolbox in place of Lupin's own mapping."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time

from lupin_runtime.ros.goal_canceler import MOVING_ACTIONS, GoalCanceler
from lupin_runtime.ros.system_programs import SystemPrograms
from lupin_runtime.slam.parameters import TABLE

_NOT_IN_SLAM_TOOLBOX = ("session_file",)
CANCEL_S = 20.0  # the servers of the actions may be discovered late


def toolbox_parameters(simulated_time: bool, map_update_interval_s: float) -> dict[str, Any]:
    """Return the parameters of slam_toolbox 2.8 (ROS 2 Jazzy), from the table of Lupin's own mapping."""
    values = {row.name: row.default for row in TABLE if row.name not in _NOT_IN_SLAM_TOOLBOX}
    others = {
        "use_sim_time": simulated_time,
        "use_lifecycle_manager": False,  # no lifecycle manager listens: the process of the stack watches its programs
        "map_update_interval": map_update_interval_s,
    }
    return {"slam_toolbox": {"ros__parameters": {**values, **others}}}


class ToolboxEngine(SystemPrograms):
    """slam_toolbox's program. Its map begins where the robot stands, so goals that are older end: they refer to another map."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        given = dict(parameters or {})
        interval_s = given.pop("map_update_interval", next(r.default for r in TABLE if r.name == "map_update_interval"))
        super().__init__("toolbox_engine", toolbox_parameters(self.simulated_time, interval_s), {}, given)
        self._canceler, self._until, self._began_ns = GoalCanceler(self, MOVING_ACTIONS), Time(), self.monotonic_ns()

    def _step(self) -> None:
        super()._step()
        if self.monotonic_ns() - self._began_ns > CANCEL_S * 1e9:
            return
        if self._until == Time():
            self._until = self.get_clock().now().to_msg()  # zero before the first message of a simulation's clock
        if self._until != Time():
            self._canceler.cancel_all(self._until)
