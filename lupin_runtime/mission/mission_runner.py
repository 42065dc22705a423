"""Runs the activity that belongs to the current state of the mission's state machine."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from typing import Concatenate, ParamSpec, Protocol, TypeVar

from lupin_runtime.geometry import Pose2
from lupin_runtime.layout import Layout
from lupin_runtime.mission.activity import Activity
from lupin_runtime.mission.config import MissionConfig
from lupin_runtime.mission.context import EXPLORATION, Context
from lupin_runtime.mission.dependencies import Dependencies
from lupin_runtime.mission.docking import Docking, DockReason
from lupin_runtime.mission.driving import Driver
from lupin_runtime.mission.exploring import Exploring
from lupin_runtime.mission.goal_runner import GoalRunner
from lupin_runtime.mission.hsm import MissionHsm
from lupin_runtime.mission.hsm_spec import DONE, EXPLORING, INSPECTING, MONITORING, PREPARE, RETURNING
from lupin_runtime.mission.inspecting import Inspecting
from lupin_runtime.mission.localizing import Localizing
from lupin_runtime.mission.lost_watch import LostWatch
from lupin_runtime.mission.missions import SKIPPED, InspectionMission, MonitoringMission
from lupin_runtime.mission.overrides import Override
from lupin_runtime.mission.ports import Ports
from lupin_runtime.safety.battery_monitor import BatteryMonitor

_MAX_TICKS_PER_INPUT = 50  # far more than the longest chain of states that need no waiting


class MissionRunner:
    """Owns the state machine, the context and the activities of a mission, and advances the current activity."""

    def __init__(
        self, config: MissionConfig, ports: Ports, layout: Layout | None = None, overrides: Mapping[str, Override] | None = None
    ) -> None:
        self.goal_runner = GoalRunner(ports.navigation, ports.clock)
        self.hsm = MissionHsm(
            {
                "is_exploration": lambda: self._kind == EXPLORATION,
                "is_inspection": lambda: self._kind not in (EXPLORATION, None),
                "has_discovered_tags": lambda: bool(self.context.world_model.discovered),
                "has_no_tags": lambda: not self.context.world_model.discovered,
            },
            self._on_transition,
        )
        self.context = Context(
            config,
            ports,
            Driver(self.goal_runner, ports.arm, ports.clock, config),
            layout or Layout(),
            overrides or {},
            self.hsm.fire,
            BatteryMonitor(config.battery_low_threshold),
            dock=Pose2(*config.dock_pose),
        )
        self.dependencies = Dependencies(self.context)
        self.exploring = Exploring(self.context)
        self.inspecting = Inspecting(self.context)
        self.docking = Docking(self.context)
        self.lost_watch = LostWatch(self.context, self.hsm, lambda: self.activity.stop_motion())
        self._idle = Activity()
        self._activities: dict[str, Activity] = {
            PREPARE: Localizing(self.context),
            EXPLORING: self.exploring,
            INSPECTING: self.inspecting,
            MONITORING: self.inspecting,
            RETURNING: self.docking,
        }
        self._input_depth = 0
        self._stopped = False

    @property
    def _kind(self) -> str | None:
        return self.context.mission.kind if self.context.mission is not None else None

    @property
    def activity(self) -> Activity:
        """The activity of the current state."""
        return self._activity_of(self.hsm.top_level_state)

    def _activity_of(self, state: str) -> Activity:
        return self._activities.get(state, self._idle)

    @property
    def blocked(self) -> bool:
        """Whether the mission must not advance. A low battery does not block RETURNING: the robot returns to charge."""
        low = self.context.battery.low and self.hsm.top_level_state != RETURNING
        return self.context.paused or self.context.estop_engaged or self.lost_watch.lost or low

    # -- advancing -----------------------------------------------------------------------------------------------------

    @contextmanager
    def handling_input(self) -> Iterator[None]:
        """Handle one input within the block; the mission advances once, after the block.

        Inputs nest: the answer to a request (a cancel, for example) may arrive while the request is still being sent. The
        mission then advances only after the outermost input, when all effects are known.
        """
        self._input_depth += 1
        try:
            yield
            if self._input_depth == 1 and not self._stopped:
                self._advance()
        finally:
            self._input_depth -= 1

    def _advance(self) -> None:
        """Tick until the state no longer changes, the mission is blocked, or the limit is reached."""
        for _ in range(_MAX_TICKS_PER_INPUT):
            before = self.hsm.state
            if self.blocked:
                return
            self.activity.tick()
            if self.hsm.state == before:
                return

    def stop(self) -> None:
        """Cancel the current drive and never advance again, because the process is shutting down."""
        self._stopped = True
        self.context.driver.stop()

    # -- transitions ---------------------------------------------------------------------------------------------------

    def _on_transition(self, source: str, dest: str) -> None:
        before, after = source.split(".")[0], dest.split(".")[0]
        if before != after:
            self._activity_of(before).leave()
        if before == EXPLORING and after == MONITORING:
            self._plan_monitoring()
        if after == DONE:
            self.context.paused = False
            self.skip_remaining_tags("dock_unreachable")  # left over after a dock request if the dock was not reached
        self.context.ports.publisher.log(f"{source} -> {dest}")
        self._activity_of(after).enter(self.hsm.substate)
        self.context.ports.publisher.state_changed()

    def _plan_monitoring(self) -> None:
        mission = self.context.mission
        assert mission is not None, "EXPLORING needs a mission"
        robot = self.context.ports.map_source.robot_pose()
        mission.visits = MonitoringMission(
            {tag: (pose.x, pose.y) for tag, pose in self.context.world_model.discovered.items()},
            (robot.x, robot.y) if robot is not None else None,
            self.context.config.monitoring_sweeps,
        )

    def divert(self, reason: DockReason, resume_state: str | None) -> None:
        """Interrupt the activity and drive to the dock.

        The operator's resume at the dock continues with `resume_state`; with None, the mission ends there.
        """
        self.activity.stop_motion()
        self.docking.begin(reason, resume_state)
        self.hsm.fire("abort_to_return")

    def skip_remaining_tags(self, detail: str) -> None:
        """Record the remaining tags of an inspection as skipped, and publish an observation with `detail` for each."""
        mission = self.context.mission
        if mission is None or not isinstance(mission.visits, InspectionMission):
            return
        for tag_id in mission.visits.record_remaining(SKIPPED):
            self.context.publish_observation(mission.visits.source, tag_id, SKIPPED, detail)


class _HasMissionRunner(Protocol):
    @property
    def mission_runner(self) -> MissionRunner: ...


_Owner = TypeVar("_Owner", bound=_HasMissionRunner)
_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def mission_input(
    method: Callable[Concatenate[_Owner, _Arguments], _Result],
) -> Callable[Concatenate[_Owner, _Arguments], _Result]:
    """Decorate a method that handles an input, so that the mission advances after it (see `MissionRunner.handling_input`)."""

    @wraps(method)
    def handle(self: _Owner, /, *args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        with self.mission_runner.handling_input():
            return method(self, *args, **kwargs)

    return handle
