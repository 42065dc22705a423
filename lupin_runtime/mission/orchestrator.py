"""The mission orchestrator without ROS: receives every input and advances the mission.

No method blocks, and the caller must not make two calls at the same time. `tick` is called about 10 times a second. There is
one method for each other input: messages of topics and results of actions here, requests in OperatorRequests.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from lupin_runtime.layout import Layout
from lupin_runtime.localization import says_lost
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
    """The complete mission.

    `layout` has the tags that are known without discovery, `overrides` the operator's approach poses. `requests` handles the
    operator's requests.
    """

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
        """Return a snapshot of the mission, with the fields of MissionState."""
        return take_snapshot(self._context, self.hsm, self.mission_runner.inspecting)

    @mission_input
    def tick(self) -> None:
        """Check dependencies and timeouts, and advance the mission."""
        self.mission_runner.goal_runner.tick()
        self.mission_runner.lost_watch.tick()
        if self.hsm.top_level_state == BOOT:
            self.mission_runner.dependencies.tick()
        if self.hsm.top_level_state == EXPLORING and not self._context.world_model.lost:
            self.mission_runner.exploring.record_camera_pose()
        if not self.mission_runner.blocked:
            self._context.driver.tick()

    def shut_down(self) -> None:
        """Cancel the current goal, so that the robot stops before the process exits."""
        self.mission_runner.stop()

    # -- topics --------------------------------------------------------------------------------------------------------

    @mission_input
    def on_estop(self, engaged: bool) -> None:
        """Handle the state of the e-stop. A release only clears the flag; the mission stays paused until it is resumed."""
        if engaged == self._context.estop_engaged:
            return
        self._context.estop_engaged = engaged
        if engaged:
            self._stop_for_estop()
        else:
            self._context.estop_released_s = self._context.ports.clock.monotonic_s()
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
        """Handle a localized pose with the variances of x, y and yaw.

        The largest variance is stored. It is unknown if any is not finite, if all are negative, or if none is given. The
        variances of a lost robot say so. The next tick uses the pose, so this is not a `mission_input`.
        """
        self._context.world_model.lost = says_lost(variances)
        if not all(map(math.isfinite, (pose.x, pose.y))):
            return
        world_model = self._context.world_model
        world_model.has_pose, world_model.pose = True, pose
        largest = max(variances, default=math.nan)
        world_model.largest_variance = largest if all(map(math.isfinite, variances)) and largest >= 0.0 else None

    @mission_input
    def on_tags(self, tags: Mapping[str, MapPose]) -> None:
        """Handle the list of discovered tags. Tags missing from a later list are kept: perception may have restarted."""
        self._discovery.update(tags)
        if self.hsm.top_level_state == EXPLORING:
            self.mission_runner.exploring.request_first_readings()

    # -- navigation ----------------------------------------------------------------------------------------------------

    @mission_input
    def goal_accepted(self, token: int) -> None:
        """Handle navigation's acceptance of a goal."""
        self.mission_runner.goal_runner.accepted(token)

    def goal_feedback(self, token: int) -> None:
        """Handle feedback for a goal. It only shows that navigation works, so this is not a `mission_input`."""
        self.mission_runner.goal_runner.feedback(token)

    @mission_input
    def goal_rejected(self, token: int, detail: str = "nav_rejected") -> None:
        """Handle the rejection of a goal, or a failure to send it."""
        self.mission_runner.goal_runner.rejected(token, detail)

    @mission_input
    def goal_finished(self, token: int, status: int, sensors_lost: bool = False, estop: bool = False) -> None:
        """Handle the end of a goal with an action status.

        `sensors_lost`: it failed because lidar or odometry failed. `estop`: the e-stop ended it. Then the mission stops, too:
        navigation may receive a press of the e-stop earlier than the mission does, and its release later.
        """
        if estop and self.mission_runner.goal_runner.is_current(token):
            self._stop_for_estop()
            self._context.ports.publisher.state_changed()
        self.mission_runner.goal_runner.finished(token, status, sensors_lost)
