"""The executive brings the robot to a goal: it plans, follows the path, checks progress, recovers, or fails with a reason.

It replaces Nav2's behavior tree. It is free of ROS: the caller passes a `View` at the controller's frequency and sends the
returned velocity to the base.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.checkers import GoalChecker, GoalTolerance, ProgressChecker
from lupin_runtime.navigation.costmap import Costmap
from lupin_runtime.navigation.decision import Decision, Failure, Progress, View
from lupin_runtime.navigation.mppi import MppiController, NoValidControl
from lupin_runtime.navigation.planning import NoPath, Plan
from lupin_runtime.navigation.recoveries import STANDSTILL, BackUp, Behavior, BehaviorLimits, Spin, Velocity, Wait
from lupin_runtime.navigation.tracked_path import TrackedPath
from lupin_runtime.safety.estop_monitor import ESTOP_ENGAGED

_LOG_SLOW_PERIOD_S = 30.0


class PlanSource(Protocol):
    """The source of plans: a worker thread, or a function in a test."""

    def request(self, start: Pose2, goals: Sequence[Pose2]) -> None:
        """Request a path from `start` through the goals (map frame). It replaces a waiting request."""
        ...

    def take(self) -> Plan | NoPath | None:
        """Return the answer to the last request, but only once; None before the answer and after it."""
        ...

    def drop(self) -> None:
        """Cancel the last request: its answer is discarded."""
        ...

    def clear_obstacles(self) -> None:
        """Forget the obstacles that are not in the map."""
        ...


@dataclass(frozen=True)
class ExecutiveParameters:
    """Times in seconds, distances in meters."""

    planner_period_s: float = 1.0
    blocked_replan_s: float = 0.4
    planning_timeout_s: float = 5.0
    failure_tolerance: float = 0.3
    required_movement_radius: float = 0.5
    required_movement_angle: float = 0.5
    movement_time_allowance: float = 10.0
    max_recoveries: int = 6
    sensor_timeout_s: float = 10.0
    off_path_m: float = 0.6
    passed_radius_m: float = 0.7
    beside_goal_m: float = 0.1
    # With a scan up to this age the robot drives at full speed; with an older one it drives no farther than in this time.
    fresh_scan_s: float = 0.45
    # How fast the noted age of a scan decays, in seconds per second: a machine that stalled is likely to stall again soon.
    scan_age_decay: float = 0.2
    # From this age on the robot stands still (LidarMonitor): an older scan, as after a lost link, does not slow it down more.
    scan_timeout_s: float = 1.0
    tolerance: GoalTolerance = field(default_factory=GoalTolerance)
    behaviors: BehaviorLimits = field(default_factory=BehaviorLimits)


class _Phase(Enum):
    IDLE = "idle"
    PLANNING = "planning"
    FOLLOWING = "following"
    RECOVERING = "recovering"


class Executive:
    """Runs one navigation at a time: `start` replaces a running one; call `tick` until its decision is `finished`.

    An engaged e-stop fails the running navigation and every one that starts before its release, so that after the release the
    robot moves only on a newer command.
    """

    def __init__(
        self,
        planner: PlanSource,
        controller: MppiController | None = None,
        parameters: ExecutiveParameters | None = None,
        clear_local: Callable[[], None] = lambda: None,
        log: Callable[[str], None] = lambda _: None,
    ) -> None:
        self._planner = planner
        self._controller = controller or MppiController()
        self._p = parameters or ExecutiveParameters()
        self._clear_local = clear_local
        self._log = log
        self._goal_checker = GoalChecker(self._p.tolerance)
        self._progress_checker = ProgressChecker(
            self._p.required_movement_radius, self._p.required_movement_angle, self._p.movement_time_allowance
        )
        self._phase = _Phase.IDLE
        self._goals: list[Pose2] = []
        self._logged_slow_s = -math.inf
        self._estop_engaged = False
        self._stopped_by_estop = False

    @property
    def active(self) -> bool:
        """Whether a navigation runs."""
        return self._phase is not _Phase.IDLE

    @property
    def estop_engaged(self) -> bool:
        """Whether a navigation that starts now would fail at once."""
        return self._estop_engaged

    def start(self, goals: Sequence[Pose2], now_s: float) -> None:
        """Navigate through these poses of the map frame to the last of them."""
        if not goals:
            raise ValueError("a navigation needs at least one pose")
        # A path to the previous goal that is still being planned would be mistaken for a path to this one.
        self._planner.drop()
        self._goals = list(goals)
        self._target = self._goals[-1]
        self._path: TrackedPath | None = None
        self._started_s = now_s
        self._age_s = 0.0
        self._ticked_s = now_s
        self._driven_m = 0.0
        self._last_pose: Pose2 | None = None
        self._recoveries = 0
        self._behavior: Behavior | None = None
        self._planning_since_s: float | None = None
        self._last_request_s = -math.inf
        self._retried = False
        self._blocked = False
        self._logged_beside = False
        self._sensors_lost_since_s: float | None = None
        self._invalid_since_s: float | None = None
        self._goal_checker.reset()
        self._progress_checker.reset()
        self._controller.reset()
        self._stopped_by_estop = self._estop_engaged
        self._phase = _Phase.PLANNING

    def set_estop(self, engaged: bool) -> None:
        """Handle the e-stop's state. A release does not revive a navigation, even if no tick saw the e-stop engaged."""
        self._estop_engaged = engaged
        self._stopped_by_estop = self._stopped_by_estop or engaged

    def stop(self) -> None:
        """End the navigation without a result: it was cancelled or replaced."""
        self._phase = _Phase.IDLE
        self._goals = []

    def progress(self, now_s: float) -> Progress:
        """Return the feedback; the estimated time uses the mean speed so far, at least a fifth of the maximum."""
        if not self.active:
            return Progress()
        remaining = math.inf if self._path is None else self._path.remaining_m
        elapsed = now_s - self._started_s
        speed = max(self._driven_m / elapsed if elapsed > 1.0 else 0.0, 0.2 * self._controller.parameters.vx_max)
        eta = remaining / speed if math.isfinite(remaining) else 0.0
        return Progress(remaining, elapsed, eta, self._recoveries, len(self._goals))

    def tick(self, view: View) -> Decision:
        """Run one control cycle."""
        if not self.active:
            return Decision(STANDSTILL, finished=True)
        if self._stopped_by_estop:
            return self._give_up(Failure.ESTOP_ENGAGED, f"{ESTOP_ENGAGED}; send a new goal after its release")
        self._note_age(view)
        robot, base, map_from_odom = self._robot(view), view.odom_from_base, view.map_from_odom
        reason = self._blocking_reason(view)
        if reason is not None or robot is None or base is None or map_from_odom is None or view.local is None:
            return self._wait_for_sensors(view, reason or "the local costmap is not ready yet")
        self._sensors_lost_since_s = None
        self._add_distance(base)
        self._drop_passed(robot)
        if len(self._goals) == 1 and self._goal_checker.reached(robot, self._target, view.now_s):
            return self._arrive()
        decision = self._update_plan(view, robot)
        if decision is not None and decision.finished:
            return decision
        new_path = None if decision is None else decision.new_path
        if self._phase is _Phase.RECOVERING:
            velocity = self._recover(base, view)
        elif self._phase is _Phase.FOLLOWING:
            outcome = self._follow(view, base, robot, map_from_odom.inverse(), view.local)
            if isinstance(outcome, Decision):
                return outcome
            velocity = outcome
        else:
            velocity = STANDSTILL
        return Decision(velocity, new_path=new_path)

    # -- reasons to stop -----------------------------------------------------------------------------------------------
    @staticmethod
    def _robot(view: View) -> Pose2 | None:
        if view.odom_from_base is None or view.map_from_odom is None:
            return None
        return view.map_from_odom @ view.odom_from_base

    def _reset_following(self) -> None:
        self._progress_checker.reset()
        self._controller.reset()
        self._invalid_since_s = None
        self._sensors_lost_since_s = None
        if self._planning_since_s is not None:
            self._planning_since_s = None
            self._last_request_s = -math.inf

    @staticmethod
    def _blocking_reason(view: View) -> str | None:
        if not view.estop_known:
            return "the e-stop's state has not been received"
        if view.odom_from_base is None:
            return "no recent transform odom -> base_link"
        if view.map_from_odom is None:
            return "no recent transform map -> odom"
        return view.lidar_fault

    def _wait_for_sensors(self, view: View, reason: str) -> Decision:
        if self._sensors_lost_since_s is None:
            self._sensors_lost_since_s = view.now_s
            self._log(f"standing still: {reason}")
        waited_s = view.now_s - self._sensors_lost_since_s
        since_s = self._sensors_lost_since_s
        self._reset_following()
        self._sensors_lost_since_s = since_s
        if waited_s <= self._p.sensor_timeout_s:
            return Decision(STANDSTILL)
        code = Failure.TF_ERROR if view.lidar_fault is None and view.estop_known else Failure.SENSOR_LOST
        return self._give_up(code, f"{reason}, for {waited_s:.0f} s")

    def _arrive(self) -> Decision:
        self._phase = _Phase.IDLE
        return Decision(STANDSTILL, finished=True)

    def _give_up(self, failure: Failure, reason: str) -> Decision:
        self._phase = _Phase.IDLE
        return Decision(STANDSTILL, finished=True, failure=failure, reason=reason)

    # -- bookkeeping ---------------------------------------------------------------------------------------------------
    def _add_distance(self, base: Pose2) -> None:
        if self._last_pose is not None:
            self._driven_m += base.distance_to(self._last_pose)
        self._last_pose = base

    def _drop_passed(self, robot: Pose2) -> None:
        while len(self._goals) > 1 and robot.distance_to(self._goals[0]) < self._p.passed_radius_m:
            del self._goals[0]
            self._goal_checker.reset()

    def _note_age(self, view: View) -> None:
        """Note the largest recent age of a scan on which the robot drove: its own plus the time since the last command."""
        gap_s = max(view.now_s - self._ticked_s, 0.0)
        self._ticked_s = view.now_s
        driven_on_s = min(view.scan_age_s, self._p.scan_timeout_s)
        self._age_s = max(driven_on_s + gap_s, self._age_s - self._p.scan_age_decay * gap_s)

    def _limit_for_scan_age(self, velocity: Velocity, now_s: float) -> Velocity:
        """Slow down so that the robot drives no farther on an old scan than at full speed on a fresh one."""
        if self._age_s <= self._p.fresh_scan_s:
            return velocity
        share = self._p.fresh_scan_s / self._age_s
        if share < 0.75 and now_s - self._logged_slow_s > _LOG_SLOW_PERIOD_S:
            self._logged_slow_s = now_s
            self._log(f"driving at {share:.0%}: the last scan is up to {self._age_s:.1f} s old")
        return velocity[0] * share, velocity[1] * share, velocity[2] * share

    # -- plans ---------------------------------------------------------------------------------------------------------
    def _update_plan(self, view: View, robot: Pose2) -> Decision | None:
        now_s = view.now_s
        answer = self._planner.take()
        decision = None
        if answer is not None:
            self._planning_since_s = None
            decision = self._accept_plan(answer) if isinstance(answer, Plan) else self._handle_no_path(answer)
        if self._planning_since_s is not None:
            if now_s - self._planning_since_s > self._p.planning_timeout_s:
                return self._give_up(Failure.PLANNING_TIMED_OUT, f"no plan arrived within {self._p.planning_timeout_s:.0f} s")
        elif self.active and self._phase is not _Phase.RECOVERING and now_s - self._last_request_s >= self._request_period_s():
            self._planner.request(robot, tuple(self._goals))
            self._planning_since_s = self._last_request_s = now_s
        return decision

    def _request_period_s(self) -> float:
        if self._phase is _Phase.PLANNING or self._path is None:
            return 0.1
        return self._p.blocked_replan_s if self._blocked else self._p.planner_period_s

    def _accept_plan(self, plan: Plan) -> Decision:
        self._path = TrackedPath(plan.points)
        self._blocked = False
        self._retried = False
        if self._phase is _Phase.PLANNING:
            self._phase = _Phase.FOLLOWING
        # The path may end beside the goal, within the planner's tolerance. Its end is the target.
        self._target = Pose2(*plan.goal, self._goals[-1].yaw)
        goal, beside_m = self._goals[-1], self._target.distance_to(self._goals[-1])
        if beside_m > self._p.beside_goal_m and not self._logged_beside:
            self._logged_beside = True
            self._log(
                f"the goal is not free ({goal.x:.2f}, {goal.y:.2f}): going to ({self._target.x:.2f}, "
                f"{self._target.y:.2f}), {beside_m:.2f} m beside it"
            )
        return Decision(STANDSTILL, new_path=plan.points)

    def _handle_no_path(self, no_path: NoPath) -> Decision | None:
        if self._phase is _Phase.FOLLOWING and not self._blocked:
            # An obstacle mark beside the path may block the global costmap; the path in use is free as far as the lidar sees.
            return None
        if not self._retried:
            self._retried = True
            self._log(f"{no_path}; clearing the global costmap")
            self._planner.clear_obstacles()
            self._phase = _Phase.PLANNING
            return None
        if self._path is None or self._recoveries >= self._p.max_recoveries:
            return self._give_up(Failure[no_path.failure.name], str(no_path))
        self._begin_recovery(str(no_path))
        return None

    # -- following -----------------------------------------------------------------------------------------------------
    def _follow(self, view: View, base: Pose2, robot: Pose2, odom_from_map: Pose2, local: Costmap) -> Velocity | Decision:
        assert self._path is not None
        p = self._controller.parameters
        off_path_m = self._path.advance(robot)
        path = self._path.extract_local_path(odom_from_map, base, local, p.prune_distance, p.robot_radius)
        self._blocked = bool((~path.free).sum() > 2) or off_path_m > self._p.off_path_m
        if self._progress_checker.stuck(base, view.now_s):
            return self._fail(Failure.FAILED_TO_MAKE_PROGRESS, "the robot makes no progress")
        try:
            command = self._controller.compute(base, view.velocity, path, odom_from_map @ self._target, local)
        except NoValidControl as error:
            if self._invalid_since_s is None:
                self._invalid_since_s = view.now_s
            if view.now_s - self._invalid_since_s <= self._p.failure_tolerance:
                return STANDSTILL
            return self._fail(Failure.NO_VALID_CONTROL, str(error))
        self._invalid_since_s = None
        return self._limit_for_scan_age((command.vx, command.vy, command.wz), view.now_s)

    def _fail(self, failure: Failure, reason: str) -> Velocity | Decision:
        if self._goal_checker.was_within_tolerance:
            return self._arrive()
        if self._recoveries >= self._p.max_recoveries:
            return self._give_up(failure, f"{reason} after {self._recoveries} recoveries")
        self._begin_recovery(reason)
        return STANDSTILL

    # -- recoveries ----------------------------------------------------------------------------------------------------
    def _begin_recovery(self, reason: str) -> None:
        limits = self._p.behaviors
        table: tuple[Callable[[], Behavior | None], ...] = (
            lambda: None,
            lambda: BackUp(limits=limits),
            lambda: Spin(limits=limits),
            lambda: Wait(),
        )
        self._behavior = table[self._recoveries % len(table)]()
        self._recoveries += 1
        name = self._behavior.name if self._behavior else "clear the costmaps"
        self._log(f"recovery {self._recoveries} of {self._p.max_recoveries}, {name}: {reason}")
        self._planner.clear_obstacles()
        self._clear_local()
        self._invalid_since_s = None
        self._phase = _Phase.RECOVERING

    def _recover(self, base: Pose2, view: View) -> Velocity:
        velocity = None
        if self._behavior is not None and view.local is not None:
            velocity = self._behavior.tick(base, view.local, view.now_s)
        if velocity is not None:
            return velocity
        self._behavior = None
        self._progress_checker.reset()
        self._controller.reset()
        self._last_request_s = -math.inf
        self._phase = _Phase.PLANNING
        return STANDSTILL
