"""The mission orchestrator without ROS: flags, operator's requests and the state machine over the activities.

Everything is called from one thread. Nothing here waits: `tick` is called about 10 times a second, and whatever happens
outside (an answer, an edge, a request) comes in through a method. Two flags of the world, the e-stop and the low battery, are
read from their monitors and nowhere kept a second time, so that no request can clear what is still so.
"""

from __future__ import annotations

import math
import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from typing import Any, Protocol, TypeVar, cast

from lupin_runtime.geometry import Pose2
from lupin_runtime.mission.approach import TagPose
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.context import EXPLORATION, INSPECTION, Context, Run
from lupin_runtime.mission.driving import Driver, GoalRunner
from lupin_runtime.mission.events import classify
from lupin_runtime.mission.exploring import Exploring
from lupin_runtime.mission.homing import Homing, Reason
from lupin_runtime.mission.hsm import (
    BOOT,
    BUSY,
    DONE,
    EXPLORING,
    FAMILIES,
    FAULT,
    INSPECTING,
    MONITORING,
    PREPARE,
    READY,
    RESUME_TRIGGER,
    RETURNING,
    MissionHsm,
)
from lupin_runtime.mission.layout import Layout, Override
from lupin_runtime.mission.missions import (
    SKIPPED,
    Counters,
    ExplorationMission,
    InspectionMission,
    MonitoringMission,
    tag_order,
)
from lupin_runtime.mission.ports import Beliefs, MissionSnapshot, Ports
from lupin_runtime.mission.visiting import Visiting
from lupin_runtime.safety.battery_monitor import BatteryEdge, BatteryMonitor
from lupin_runtime.safety.estop_monitor import EStopEdge, EStopMonitor

_MAX_STEPS_PER_EVENT = 50  # a chain of states that need no waiting; far above the longest


@dataclass(frozen=True)
class Reply:
    """The answer to an operator's request."""

    success: bool
    message: str = ""
    mission_id: str = ""


class _Activity(Protocol):
    def enter(self, leaf: str) -> None: ...
    def leave(self) -> None: ...
    def hold(self) -> None: ...
    def tick(self) -> None: ...


class _Idle:
    """A state in which nothing is done."""

    def enter(self, leaf: str) -> None:
        pass

    def leave(self) -> None:
        pass

    def hold(self) -> None:
        pass

    def tick(self) -> None:
        pass


class _Localizing(_Idle):
    """PREPARE: wait, unpaused, for a pose that can be trusted."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._waited_s = 0.0
        self._tick_s: float | None = None

    def enter(self, leaf: str) -> None:
        self._waited_s, self._tick_s = 0.0, None

    def hold(self) -> None:
        self._tick_s = None

    def tick(self) -> None:
        context, now = self._context, self._context.now_s
        if self._tick_s is not None:
            self._waited_s += now - self._tick_s
        self._tick_s = now
        covariance = context.beliefs.covariance
        if covariance is not None and covariance <= context.config.localization_covariance_threshold:
            context.fire("localized")
        elif self._waited_s >= context.config.localization_timeout_s:
            context.note("localization_failed")
            found = "no pose was heard" if covariance is None else f"its variance is {covariance:.3f}"
            context.ports.outlet.log(
                f"not localized after {self._waited_s:.0f} s on {context.config.amcl_pose_topic}: {found}, expected at most"
                f" {context.config.localization_covariance_threshold}; then: lupin mission reset",
                warning=True,
            )
            context.fire("fault")


_Method = TypeVar("_Method", bound=Callable[..., Any])


def _handled(method: _Method) -> _Method:
    """A method of the orchestrator through which something comes in from outside."""

    @wraps(method)
    def handled(self: Orchestrator, *args: Any, **kwargs: Any) -> Any:
        with self._handling():
            return method(self, *args, **kwargs)

    return cast(_Method, handled)


def _uint16(count: int) -> int:
    """What a uint16 field can hold of a count: a monitoring that goes on for weeks passes it."""
    return min(65535, count)


class Orchestrator:
    """The whole mission. `layout` and `overrides` are what is known before the first drive."""

    def __init__(
        self,
        config: MissionConfig,
        ports: Ports,
        layout: Layout | None = None,
        overrides: Mapping[str, Override] | None = None,
    ) -> None:
        self._config, self._ports = config, ports
        self._estop = EStopMonitor()
        self._battery = BatteryMonitor(config.battery_low_threshold)
        self._paused = False
        self._last_error = ""
        self._handling_depth = 0
        self._closed = False
        self._boot_s: float | None = None
        self._dock_captured = False
        self._last_heard: dict[str, TagPose] = {}
        self.runner = GoalRunner(ports.navigation, ports.clock)
        driver = Driver(
            self.runner,
            ports.arm,
            ports.clock,
            config.arm_patrol_enabled,
            config.arm_travel_preset,
            config.arm_travel_settle_s,
        )
        self.hsm = MissionHsm(
            {
                "explores": lambda: self._run is not None and self._run.kind == EXPLORATION,
                "inspects": lambda: self._run is not None and self._run.kind != EXPLORATION,
                "found_some": lambda: bool(self._context.beliefs.discovered),
                "found_none": lambda: not self._context.beliefs.discovered,
            },
            self._changed,
        )
        self._context = Context(
            config,
            ports,
            driver,
            Beliefs(),
            layout or Layout(),
            overrides or {},
            self.hsm.fire,
            self._note,
            self._pause,
            lambda: self._battery.low,
            dock=Pose2(*config.dock_pose),
        )
        self._exploring = Exploring(self._context)
        self._visiting = Visiting(self._context)
        self._homing = Homing(self._context)
        idle = _Idle()
        self._activities: dict[str, _Activity] = {
            BOOT: idle,
            READY: idle,
            PREPARE: _Localizing(self._context),
            EXPLORING: self._exploring,
            INSPECTING: self._visiting,
            MONITORING: self._visiting,
            RETURNING: self._homing,
            DONE: idle,
            FAULT: idle,
        }

    # -- state ---------------------------------------------------------------------------------------------------------

    @property
    def _run(self) -> Run | None:
        return self._context.run

    @property
    def _activity(self) -> _Activity:
        return self._activities[self.hsm.lifecycle]

    @property
    def blocked(self) -> bool:
        """Whether nothing may advance. On the way home a low battery is the reason to go, not to stop."""
        return self._paused or self._estop.engaged or (self._battery.low and self.hsm.lifecycle != RETURNING)

    def snapshot(self) -> MissionSnapshot:
        """What MissionState says now."""
        lifecycle, run = self.hsm.lifecycle, self._run
        event = classify(self._last_error)
        exploration = run.exploration if run is not None else None
        visiting = lifecycle in (INSPECTING, MONITORING)
        phase = "CONFIRMING" if visiting and self._visiting.confirming else self.hsm.leaf
        counters = Counters()
        if run is not None and run.walk is not None:
            counters = run.walk.counters
        elif exploration is not None:
            counters = exploration.counters
        return MissionSnapshot(
            mission_id=run.mission_id if run is not None else "",
            mission_type=run.kind if run is not None else "",
            lifecycle_state=lifecycle,
            mission_phase=phase,
            current_target=self._visiting.target if visiting else "",
            targets_total=_uint16(counters.total),
            targets_completed=_uint16(counters.completed),
            targets_failed=_uint16(counters.failed),
            targets_unreachable=_uint16(counters.unreachable),
            targets_skipped=_uint16(counters.skipped),
            last_error=event.code,
            last_event=event.label,
            last_event_severity=event.severity,
            tags_discovered=_uint16(exploration.discovered) if exploration is not None else 0,
            discovery_goal=_uint16(exploration.goal) if exploration is not None else 0,
            estop_engaged=self._estop.engaged,
            paused=self._paused,
            battery_percentage=self._battery.percentage,
            battery_low=self._battery.low,
            started_at_ns=run.started_at_ns if run is not None else 0,
        )

    def _note(self, code: str) -> None:
        self._last_error = code

    def _pause(self) -> None:
        self._paused = True
        self._ports.outlet.changed()

    def _changed(self, source: str, dest: str) -> None:
        """A transition was taken; called by the state machine, before anything that it queued."""
        before, after = source.split(".")[0], dest.split(".")[0]
        if before != after:
            self._activities[before].leave()
        if before == EXPLORING and after == MONITORING:
            self._plan_sweep()
        if after == DONE:
            self._paused = False
            self._close_remaining()  # a dock request whose dock was never reached has left some
        self._ports.outlet.log(f"{source} -> {dest}")
        self._activities[after].enter(self.hsm.leaf)
        self._ports.outlet.changed()

    def _plan_sweep(self) -> None:
        run = self._run
        assert run is not None, "only a run explores"
        robot = self._ports.world.robot_pose()
        positions = {tag: (pose.x, pose.y) for tag, pose in self._context.beliefs.discovered.items()}
        run.walk = MonitoringMission(
            positions, (robot.x, robot.y) if robot is not None else None, self._config.monitoring_sweeps
        )

    # -- time ----------------------------------------------------------------------------------------------------------

    @_handled
    def tick(self) -> None:
        """The watchdog: dependencies, localization, time-outs and whatever can go on."""
        self.runner.tick()
        if self.hsm.lifecycle == BOOT:
            self._wait_for_dependencies()
        if self.hsm.lifecycle == EXPLORING:
            self._exploring.sample()
        if not self.blocked:
            self._context.driver.tick()

    @contextmanager
    def _handling(self) -> Iterator[None]:
        """Around everything that comes in: what it brings about is acted on once, when all of it is known. An answer that
        comes while its question is still being asked (a cancel's, say) must not start the next thing in between."""
        self._handling_depth += 1
        try:
            yield
            if self._handling_depth == 1 and not self._closed:
                self._advance()
        finally:
            self._handling_depth -= 1

    def _advance(self) -> None:
        """Let the activity go on until it waits for something."""
        for _ in range(_MAX_STEPS_PER_EVENT):
            before = self.hsm.state
            if self.blocked:
                return
            self._activity.tick()
            if self.hsm.state == before:
                return

    def _wait_for_dependencies(self) -> None:
        now = self._ports.clock.now_s()
        if self._boot_s is None:
            self._boot_s = now
        missing = [name for name, ready in self._dependencies() if not ready]
        if not missing:
            # A mission that died may have left a goal behind, and nobody else would end it.
            self._ports.navigation.cancel_all()
            self.hsm.fire("deps_up")
        elif now - self._boot_s >= self._config.dependency_timeout_s:
            self._note("dependency_timeout")
            self._ports.outlet.log(
                f"not there after {self._config.dependency_timeout_s:.0f} s: {', '.join(missing)};"
                " see: lupin status; then: lupin mission reset",
                warning=True,
            )
            self.hsm.fire("fault")

    def _dependencies(self) -> list[tuple[str, bool]]:
        found = [
            (self._config.nav_action_name, self._ports.navigation.is_ready()),
            (self._config.bridge_service_name, self._ports.greenhouse.is_ready()),
        ]
        if self._config.require_visual_confirmation:
            found.append((self._config.visual_confirmation_service, self._ports.gate.is_ready()))
        return found

    # -- what the world says -------------------------------------------------------------------------------------------

    @_handled
    def heard_estop(self, engaged: bool) -> None:
        """A message of `/e_stop_state`. Its release clears the flag only: going on takes a resume."""
        edge = self._estop.update(engaged)
        if edge is EStopEdge.ENGAGED:
            self._note("estop_engaged")
            self._paused = True
            self._activity.hold()
        if edge is not None:
            self._ports.outlet.changed()

    @_handled
    def heard_battery(self, percentage: float) -> None:
        """A BatteryState's percentage, on whatever scale."""
        edge = self._battery.update(percentage)
        if edge is None:
            return
        if edge is BatteryEdge.LOW:
            self._note("battery_low")
            lifecycle = self.hsm.lifecycle
            if lifecycle in FAMILIES:
                self._divert("battery", lifecycle)
            elif lifecycle not in (RETURNING, FAULT):
                self._paused = True
                self._activity.hold()
        self._ports.outlet.changed()

    def heard_pose(self, pose: TagPose, variances: Sequence[float]) -> None:
        """A localized pose with the variances of x, y and yaw. A measure that is not a number is none."""
        beliefs = self._context.beliefs
        if not all(map(math.isfinite, (pose.x, pose.y))):
            return
        beliefs.has_pose, beliefs.pose = True, pose
        worst = max(variances, default=math.nan)
        beliefs.covariance = worst if all(map(math.isfinite, variances)) and worst >= 0.0 else None

    @_handled
    def heard_tags(self, tags: Mapping[str, TagPose]) -> None:
        """All tags discovered so far. Tags that are missing from a later list are kept: perception may have restarted."""
        good = {tag: pose for tag, pose in tags.items() if tag and all(map(math.isfinite, (pose.x, pose.y, pose.z)))}
        self._last_heard = good
        self._context.beliefs.discovered.update(good)
        self._count_discovered()
        if self.hsm.lifecycle == EXPLORING:
            self._exploring.seed()

    def _count_discovered(self) -> None:
        run = self._run
        if run is None or run.exploration is None:
            return
        run.exploration.discovered = len(self._context.beliefs.discovered)
        if isinstance(run.walk, MonitoringMission) and self.hsm.lifecycle == MONITORING:
            for tag_id in sorted(self._context.beliefs.discovered, key=tag_order):
                run.walk.add(tag_id)

    @_handled
    def goal_accepted(self, token: int) -> None:
        """Navigation has taken a goal."""
        self.runner.accepted(token)

    def goal_feedback(self, token: int) -> None:
        """Navigation is working on a goal."""
        self.runner.feedback(token)

    @_handled
    def goal_rejected(self, token: int, detail: str = "nav_rejected") -> None:
        """Navigation has refused a goal, or it could not be sent."""
        self.runner.rejected(token, detail)

    @_handled
    def goal_finished(self, token: int, status: int, blind: bool = False) -> None:
        """A goal has ended with an action status; `blind` where the robot's senses failed, and not the goal."""
        self.runner.finished(token, status, blind)

    # -- what the operator asks ----------------------------------------------------------------------------------------

    @_handled
    def start(self, mission_type: str = "", tag_sequence: Sequence[str] = (), discovery_goal: int = 0) -> Reply:
        """Start a mission: "" and InspectionMission walk tags, ExplorationMission looks for them; goal 0 takes the
        parameter's."""
        refusal = self._start_refusal()
        if refusal:
            return Reply(False, refusal)
        kind = mission_type.strip() or INSPECTION
        mission_id = f"{self._config.mission_id_prefix}-{secrets.token_hex(4)}"
        run = Run(mission_id, kind, self._ports.clock.stamp_ns())
        if kind == EXPLORATION:
            goal = discovery_goal or self._config.discovery_goal
            if goal <= 0:
                return Reply(False, f"discovery goal is {goal}, expected 1 or more, or 65535 for all that can be found")
            run.exploration = ExplorationMission(goal)
        elif kind == INSPECTION:
            tags, problem = self._inspection_tags(tag_sequence)
            if problem:
                return Reply(False, problem)
            run.walk = InspectionMission(tags)
        else:
            return Reply(False, f"unknown mission type {kind!r}, expected {INSPECTION} or {EXPLORATION}")
        if self.hsm.lifecycle == DONE:
            self.hsm.fire("reset_for_next")
        self._context.run = run
        self._context.beliefs.discovered = dict(self._last_heard)
        self._paused = False
        self._last_error = ""
        self._exploring.reset()
        self._count_discovered()
        self._capture_dock()
        self.hsm.fire("start_mission")
        return Reply(True, "", mission_id)

    def _start_refusal(self) -> str:
        lifecycle = self.hsm.lifecycle
        if lifecycle in BUSY:
            return "mission already running; end it first: lupin mission abort"
        if lifecycle == BOOT:
            missing = ", ".join(name for name, ready in self._dependencies() if not ready)
            return f"not ready: still waiting for {missing or 'the next watchdog tick'}"
        if lifecycle == FAULT:
            return f"in FAULT ({self._last_error}); first: lupin mission reset"
        if self._estop.engaged:
            return "the e-stop is engaged: release it, then start again"
        if self._battery.low:
            return f"battery low ({self._battery.percentage:.0%}): charge it, then start again"
        return ""

    def _inspection_tags(self, asked: Sequence[str]) -> tuple[list[str], str]:
        known = self._context.layout.tags.keys() | self._last_heard.keys()
        tags = [tag.strip() for tag in asked] or list(self._config.tag_sequence) or sorted(known, key=tag_order)
        unknown = [tag for tag in tags if tag not in known]
        if unknown:
            return [], f"unknown tag ids: {', '.join(map(repr, unknown))}; neither in the layout file nor discovered"
        if not tags:
            return [], "no tags to inspect: the list is empty, and no layout file nor discovery knows any"
        return tags, ""

    def _capture_dock(self) -> None:
        """A dock at the origin means: where the robot stands when its first mission starts."""
        x, y, yaw = self._config.dock_pose
        if self._dock_captured or x != 0.0 or y != 0.0:
            return
        robot = self._ports.world.robot_pose()
        if robot is None:
            self._ports.outlet.log("no transform of the robot: the dock is the map's origin", warning=True)
            return
        self._context.dock = Pose2(robot.x, robot.y, yaw)
        self._dock_captured = True

    @_handled
    def pause(self) -> Reply:
        """Hold where the mission is."""
        if self.hsm.lifecycle not in BUSY:
            return Reply(False, "no mission is running")
        if self._paused:
            return Reply(False, "already paused")
        if self.hsm.lifecycle == RETURNING and self._battery.low:
            return Reply(False, "refused: on the way home with a low battery; a pause would strand the robot")
        self._paused = True
        self._activity.hold()
        self._ports.outlet.changed()
        return Reply(True, "paused")

    @_handled
    def resume(self) -> Reply:
        """Go on: with what was held, or, from the dock, with what was left for it."""
        returning, homing = self.hsm.lifecycle == RETURNING, self._homing
        if not self._paused:
            return Reply(False, "not paused")
        if self._estop.engaged:
            return Reply(False, "the e-stop is engaged: release it, then resume")
        # Stopped on its way home, the robot may go on to the dock: with a low battery that is where it has to be.
        if self._battery.low and (not returning or homing.docked):
            return Reply(False, f"battery low ({self._battery.percentage:.0%}): charge it, then resume")
        self._paused = False
        if returning and homing.origin is not None and (homing.docked or (homing.gave_up and not self._battery.low)):
            self.hsm.fire(RESUME_TRIGGER[homing.origin])
        elif returning:
            homing.retry()
        self._ports.outlet.changed()
        return Reply(True, "resumed")

    @_handled
    def abort(self) -> Reply:
        """End the mission and drive home; a second time, or at the dock, end it where the robot is."""
        lifecycle = self.hsm.lifecycle
        if lifecycle not in BUSY:
            return Reply(False, "no mission is running")
        if lifecycle == RETURNING:
            if self._homing.reason == "battery" and not self._paused:
                return Reply(False, "refused: on the way home with a low battery; it ends by itself at the dock")
            self.hsm.fire("returned")
            return Reply(True, "ended")
        if lifecycle == PREPARE:
            self._note("aborted_in_prepare")
        self._activity.hold()
        self._close_remaining()
        self._divert("abort", None)
        if self._paused:
            return Reply(True, "aborted, and held by the pause: resume drives home, another abort ends it here")
        return Reply(True, "aborted: driving home")

    def _close_remaining(self) -> None:
        run = self._run
        if run is None or not isinstance(run.walk, InspectionMission):
            return
        for tag_id in run.walk.close_remaining(SKIPPED):
            self._context.observe(run.walk.source, tag_id, SKIPPED, "mission_aborted")

    @_handled
    def skip_current(self) -> Reply:
        """Give up the tag of an inspection and go on to the next."""
        if self.hsm.lifecycle != INSPECTING:
            return Reply(False, f"only an inspection skips tags, not {self.hsm.lifecycle}")
        target = self._visiting.target
        if not self._visiting.skip():
            return Reply(False, f"tag {target!r} is closed already")
        return Reply(True, f"skipped tag {target}")

    @_handled
    def dock(self) -> Reply:
        """Drive home and wait there; a resume comes back to what was left."""
        lifecycle = self.hsm.lifecycle
        if lifecycle not in FAMILIES:
            return Reply(
                False, f"nothing to come back to from {lifecycle}; docking works while exploring, inspecting, monitoring"
            )
        self._divert("dock", lifecycle)
        return Reply(True, "driving to the dock" if not self.blocked else "held by the pause: resume drives to the dock")

    def _divert(self, reason: Reason, origin: str | None) -> None:
        self._activity.hold()
        self._homing.begin(reason, origin)
        self.hsm.fire("abort_to_return")

    @_handled
    def reset(self) -> Reply:
        """Leave FAULT. What the world still says, an e-stop or a low battery, stays as it is."""
        if self.hsm.lifecycle != FAULT:
            return Reply(False, f"only FAULT is reset, not {self.hsm.lifecycle}")
        self.runner.cancel()
        self._context.run = None
        self._paused = False
        self._last_error = ""
        self.hsm.fire("recover")
        return Reply(True, "ready")

    def shut_down(self) -> None:
        """The process ends: leave no goal behind that would go on driving."""
        self._closed = True
        self._context.driver.stop()
