"""The operator's requests to a mission: start, pause, resume, abort, skip, dock and reset."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from dataclasses import dataclass

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.context import EXPLORATION, INSPECTION, ActiveMission
from lupin_runtime.mission.hsm_spec import (
    BOOT,
    BUSY,
    DONE,
    FAULT,
    INSPECTING,
    PREPARE,
    RESUMABLE,
    RESUME_TRIGGER,
    RETURNING,
)
from lupin_runtime.mission.mission_runner import MissionRunner, mission_input
from lupin_runtime.mission.missions import ExplorationMission, InspectionMission, tag_order
from lupin_runtime.mission.tag_discovery import TagDiscovery

# A request that was queued in this process while the e-stop was engaged is handled within milliseconds of the release, and
# navigation may notice the release one message later (0.2 s), and accepts goals 0.1 s and one control cycle after that.
SETTLE_S = 0.4


@dataclass(frozen=True)
class Reply:
    """The answer to a request; `message` says why it was refused, or what happens now."""

    success: bool
    message: str = ""
    mission_id: str = ""


class OperatorRequests:
    """Handles each request according to the mission's state. A refusal changes nothing."""

    def __init__(self, mission_runner: MissionRunner, discovery: TagDiscovery) -> None:
        self.mission_runner = mission_runner
        self._context, self._hsm, self._docking = mission_runner.context, mission_runner.hsm, mission_runner.docking
        self._discovery = discovery
        self._dock_captured = False

    # -- start ---------------------------------------------------------------------------------------------------------

    @mission_input
    def start(self, mission_type: str = "", tag_sequence: Sequence[str] = (), discovery_goal: int = 0) -> Reply:
        """Start a mission.

        `mission_type` is InspectionMission (the default for "") or ExplorationMission. An empty `tag_sequence` and a
        `discovery_goal` of 0 stand for the node's parameters.
        """
        refusal = self._start_refusal()
        if refusal:
            return Reply(False, refusal)
        context = self._context
        kind = mission_type.strip() or INSPECTION
        mission_id = f"{context.config.mission_id_prefix}-{secrets.token_hex(4)}"
        mission = ActiveMission(mission_id, kind, context.ports.clock.stamp_ns())
        if kind == EXPLORATION:
            goal = discovery_goal or context.config.discovery_goal
            if goal <= 0:
                return Reply(False, f"discovery goal is {goal}, expected 1 or more, or 65535 for all that can be found")
            mission.exploration = ExplorationMission(goal)
        elif kind == INSPECTION:
            tags, problem = self._inspection_tags(tag_sequence)
            if problem:
                return Reply(False, problem)
            mission.visits = InspectionMission(tags)
        else:
            return Reply(False, f"unknown mission type {kind!r}, expected {INSPECTION} or {EXPLORATION}")
        if self._hsm.top_level_state == DONE:
            self._hsm.fire("reset_for_next")
        context.mission = mission
        context.paused = False
        context.last_error = ""
        self.mission_runner.exploring.reset()
        self._discovery.restart()
        self._capture_dock()
        self._hsm.fire("start_mission")
        return Reply(True, "", mission_id)

    def _start_refusal(self) -> str:
        state = self._hsm.top_level_state
        if state in BUSY:
            return "mission already running; abort it first: lupin mission abort"
        if state == BOOT:
            missing = ", ".join(self.mission_runner.dependencies.missing())
            return f"not ready: still waiting for {missing or 'the next watchdog tick'}"
        if state == FAULT:
            return f"in FAULT ({self._context.last_error}); first: lupin mission reset"
        estop = self._estop_refusal("start")
        if estop:
            return estop
        if self._context.battery.low:
            return f"battery low ({self._context.battery.percentage:.0%}): charge it, then start again"
        return ""

    def _estop_refusal(self, request: str) -> str:
        """Return why the e-stop forbids a request that moves the robot: it is older than the release, or might be."""
        context = self._context
        if context.estop_engaged:
            return f"the e-stop is engaged: release it, then {request} again"
        released_s = context.estop_released_s
        if released_s is not None and context.ports.clock.monotonic_s() - released_s < SETTLE_S:
            return f"the e-stop was released less than {SETTLE_S:g} s ago: {request} again"
        return ""

    def _inspection_tags(self, requested: Sequence[str]) -> tuple[list[str], str]:
        """Return the tags to inspect, or the reason why there are none."""
        known = self._context.layout.tags.keys() | self._discovery.newest.keys()
        tags = [tag.strip() for tag in requested] or list(self._context.config.tag_sequence) or sorted(known, key=tag_order)
        unknown = [tag for tag in tags if tag not in known]
        if unknown:
            return [], f"unknown tag ids: {', '.join(map(repr, unknown))}; neither in the layout file nor discovered"
        if not tags:
            return [], "no tags to inspect: the list is empty, the layout file has none, and none was discovered"
        return tags, ""

    def _capture_dock(self) -> None:
        """Take the robot's position at the first start as the dock, if the dock is configured as the map's origin."""
        x, y, yaw = self._context.config.dock_pose
        if self._dock_captured or x != 0.0 or y != 0.0:
            return
        robot = self._context.ports.map_source.robot_pose()
        if robot is None:
            self._context.ports.publisher.log("no transform of the robot: the dock is the map's origin", warning=True)
            return
        self._context.dock = Pose2(robot.x, robot.y, yaw)
        self._dock_captured = True

    # -- during a mission ----------------------------------------------------------------------------------------------

    @mission_input
    def pause(self) -> Reply:
        """Stop the robot; the mission stays in its state."""
        if self._hsm.top_level_state not in BUSY:
            return Reply(False, "no mission is running")
        if self._context.paused:
            return Reply(False, "already paused")
        if self._hsm.top_level_state == RETURNING and self._context.battery.low:
            return Reply(False, "refused: the robot returns to the dock with a low battery; a pause would strand it")
        self._context.pause()
        self.mission_runner.activity.stop_motion()
        return Reply(True, "paused")

    @mission_input
    def resume(self) -> Reply:
        """Continue after a pause; at the dock, continue with the interrupted state."""
        returning, docking, battery = self._hsm.top_level_state == RETURNING, self._docking, self._context.battery
        if not self._context.paused:
            return Reply(False, "not paused")
        estop = self._estop_refusal("resume")
        if estop:
            return Reply(False, estop)
        # A robot that was stopped on its way may continue to the dock with a low battery: it has to charge there.
        if battery.low and (not returning or docking.docked):
            return Reply(False, f"battery low ({battery.percentage:.0%}): charge it, then resume")
        self._context.paused = False
        if returning and docking.resume_state is not None and (docking.docked or (docking.gave_up and not battery.low)):
            self._hsm.fire(RESUME_TRIGGER[docking.resume_state])
        elif returning:
            docking.retry()
        self._context.ports.publisher.state_changed()
        return Reply(True, "resumed")

    @mission_input
    def abort(self) -> Reply:
        """End the mission and return to the dock; while returning or docked, end it where the robot is."""
        state = self._hsm.top_level_state
        if state not in BUSY:
            return Reply(False, "no mission is running")
        if state == RETURNING:
            if self._docking.reason == "battery" and not self._context.paused:
                return Reply(False, "refused: the robot returns with a low battery; the mission ends by itself at the dock")
            self.mission_runner.skip_remaining_tags("mission_aborted")
            self._hsm.fire("returned")
            return Reply(True, "ended")
        if state == PREPARE:
            self._context.last_error = "aborted_in_prepare"
        self.mission_runner.activity.stop_motion()
        self.mission_runner.skip_remaining_tags("mission_aborted")
        self.mission_runner.divert("abort", None)
        if self._context.paused:
            return Reply(True, "aborted, but still paused: resume drives to the dock, another abort stops it here")
        return Reply(True, "aborted: driving to the dock")

    @mission_input
    def skip_current(self) -> Reply:
        """Skip the current tag of an inspection."""
        if self._hsm.top_level_state != INSPECTING:
            return Reply(False, f"tags can be skipped in {INSPECTING} only, the mission is in {self._hsm.top_level_state}")
        target = self.mission_runner.inspecting.target
        if not self.mission_runner.inspecting.skip():
            return Reply(False, f"tag {target!r} is already closed")
        return Reply(True, f"skipped tag {target}")

    @mission_input
    def dock(self) -> Reply:
        """Drive to the dock and wait there; a resume continues with the interrupted state."""
        state = self._hsm.top_level_state
        if state not in RESUMABLE:
            return Reply(False, f"cannot dock in {state}: docking works while exploring, inspecting or monitoring")
        self.mission_runner.divert("dock", state)
        return Reply(True, "paused: resume drives to the dock" if self.mission_runner.blocked else "driving to the dock")

    @mission_input
    def reset(self) -> Reply:
        """Leave FAULT. E-stop and low battery keep their state."""
        if self._hsm.top_level_state != FAULT:
            return Reply(False, f"only FAULT can be reset, the mission is in {self._hsm.top_level_state}")
        self.mission_runner.goal_runner.cancel()
        self._context.mission = None
        self._context.paused = False
        self._context.last_error = ""
        self._hsm.fire("recover")
        return Reply(True, "ready")
