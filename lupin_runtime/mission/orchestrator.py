"""The mission orchestrator without ROS: receives every input and advances the mission.

All methods are called from one thread and none blocks. `tick` is called about 10 times a second; everything else that
happens outside (a topic's message, an action's result, an operator's request) arrives through its own method.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from lupin_runtime.layout import Layout
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.hsm import MissionHsm
from lupin_runtime.mission.hsm_spec import BOOT, EXPLORING, FAULT, RESUMABLE, RETURNING
from lupin_runtime.mission.mission_runner import MissionRunner, mission_input
from lupin_runtime.mission.overrides import Override
from lupin_runtime.mission.ports import Ports
from lupin_runtime.mission.records import MapPose, MissionSnapshot
from lupin_runtime.mission.requests import OperatorRequests
from lupin_runtime.mission.snapshot import take_snapshot
from lupin_runtime.mission.tag_discovery import TagDiscovery
from lupin_runtime.safety.battery_monitor import BatteryEdge


class Orchestrator:
    """The complete mission. `layout` and `overrides` are known before the first drive; `requests` serves the operator."""

    def __init__(
        self, config: MissionConfig, ports: Ports, layout: Layout | None = None, overrides: Mapping[str, Override] | None = None
    ) -> None:
        self.mission_runner = MissionRunner(config, ports, layout, overrides)
        self._context = self.mission_runner.context
        self._discovery = TagDiscovery(self._context, self.mission_runner.hsm)
        self.requests = OperatorRequests(self.mission_runner, self._discovery)

    @property
    def hsm(self) -> MissionHsm:
        """The state machine."""
        return self.mission_runner.hsm

    def snapshot(self) -> MissionSnapshot:
        """Return the current MissionState."""
        return take_snapshot(self._context, self.hsm, self.mission_runner.inspecting)

    @mission_input
    def tick(self) -> None:
        """Check dependencies and timeouts, and advance the mission."""
        self.mission_runner.goal_runner.tick()
        if self.hsm.top_level_state == BOOT:
            self.mission_runner.dependencies.tick()
        if self.hsm.top_level_state == EXPLORING:
            self.mission_runner.exploring.sample()
        if not self.mission_runner.blocked:
            self._context.driver.tick()

    def shut_down(self) -> None:
        """Cancel the current goal, so that the robot stops when the process ends."""
        self.mission_runner.stop()

    # -- topics --------------------------------------------------------------------------------------------------------

    @mission_input
    def on_estop(self, engaged: bool) -> None:
        """Handle the state of the e-stop. A release clears the flag only: driving on takes a resume."""
        if engaged == self._context.estop_engaged:
            return
        self._context.estop_engaged = engaged
        if engaged:
            self._stop_for_estop()
        self._context.ports.publisher.state_changed()

    def _stop_for_estop(self) -> None:
        self._context.last_error = "estop_engaged"
        self._context.paused = True
        self.mission_runner.activity.stop_motion()

    @mission_input
    def on_battery(self, percentage: float) -> None:
        """Handle the percentage of a BatteryState, 0..1 or 0..100."""
        edge = self._context.battery.update(percentage)
        if edge is None:
            return
        if edge is BatteryEdge.LOW:
            self._context.last_error = "battery_low"
            state = self.hsm.top_level_state
            if state in RESUMABLE:
                self.mission_runner.divert("battery", state)
            elif state not in (RETURNING, FAULT):
                self._context.paused = True
                self.mission_runner.activity.stop_motion()
        self._context.ports.publisher.state_changed()

    def on_pose(self, pose: MapPose, variances: Sequence[float]) -> None:
        """Handle a localized pose with the variances of x, y and yaw. Variances that are not finite count as unknown."""
        if not all(map(math.isfinite, (pose.x, pose.y))):
            return
        world_model = self._context.world_model
        world_model.has_pose, world_model.pose = True, pose
        largest = max(variances, default=math.nan)
        world_model.covariance = largest if all(map(math.isfinite, variances)) and largest >= 0.0 else None

    @mission_input
    def on_tags(self, tags: Mapping[str, MapPose]) -> None:
        """Handle the list of discovered tags. Tags that a later list lacks are kept: perception may have restarted."""
        self._discovery.update(tags)
        if self.hsm.top_level_state == EXPLORING:
            self.mission_runner.exploring.seed()

    # -- navigation ----------------------------------------------------------------------------------------------------

    @mission_input
    def goal_accepted(self, token: int) -> None:
        """Navigation accepted a goal."""
        self.mission_runner.goal_runner.accepted(token)

    def goal_feedback(self, token: int) -> None:
        """Navigation sent feedback for a goal."""
        self.mission_runner.goal_runner.feedback(token)

    @mission_input
    def goal_rejected(self, token: int, detail: str = "nav_rejected") -> None:
        """Navigation rejected a goal, or the goal could not be sent."""
        self.mission_runner.goal_runner.rejected(token, detail)

    @mission_input
    def goal_finished(self, token: int, status: int, blind: bool = False, estop: bool = False) -> None:
        """A goal ended with an action status; `blind` if it failed because lidar or odometry failed, `estop` if the e-stop
        ended it. Navigation may receive the e-stop's state before the mission, and its release after."""
        if estop and self.mission_runner.goal_runner.drives(token):
            self._stop_for_estop()
            self._context.ports.publisher.state_changed()
        self.mission_runner.goal_runner.finished(token, status, blind)
