"""Whole navigations in closed loop with a kinematic robot, a ray-cast lidar and drifting odometry."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.decision import Failure, View
from lupin_runtime.navigation.executive import Executive
from lupin_runtime.navigation.planning import Plan
from tests.support.kinematic_base import Arena, Drive, greenhouse, random_arena

ZERO = (0.0, 0.0, 0.0)


def assert_arrived(drive: Drive, goal: Pose2) -> None:
    away, turn = drive.error_to(goal)
    assert away <= 0.25
    assert turn <= 0.12
    assert drive.collisions == 0


def test_aisles_of_90_cm_are_driven_both_ways_with_u_turns() -> None:
    drive = Drive(greenhouse(2, 0.9), Pose2(0.45, 0.45, 0.0), drift=0.02)
    goals = [Pose2(3.75, 0.45, 0.0), Pose2(2.1, 1.95, math.pi), Pose2(2.1, 3.45, 0.0), Pose2(0.45, 0.6, -math.pi / 2)]
    for goal in goals:
        assert drive.go(goal).failure is None
        assert_arrived(drive, goal)
    assert drive.logs == []
    # Turns on the spot included.
    assert drive.driven_m() / drive.now_s > 0.25


def test_aisle_of_65_cm_is_still_driven() -> None:
    drive = Drive(greenhouse(2, 0.65), Pose2(0.33, 0.33, 0.0))
    for goal in (Pose2(3.3, 0.33, 0.0), Pose2(2.0, 1.58, math.pi)):
        assert drive.go(goal).failure is None
        assert_arrived(drive, goal)


def test_final_pose_is_far_better_than_its_tolerance() -> None:
    drive = Drive(Arena(4.0, 4.0), Pose2(0.6, 0.6, 0.0))
    goal = Pose2(3.0, 2.8, 2.5)
    assert drive.go(goal).failure is None
    away, turn = drive.error_to(goal)
    assert away < 0.06
    assert turn < 0.06


@pytest.mark.parametrize("seed", range(4))
def test_no_box_is_touched_in_a_random_room(seed: int) -> None:
    arena = random_arena(seed)
    drive = Drive(arena, Pose2(0.45, 0.45, 0.0), drift=0.02, seed=seed)
    costmap = drive.world.snapshot(None)
    random = np.random.default_rng(seed)
    for _ in range(3):
        while True:
            goal = Pose2(*random.uniform((0.3, 0.3, -3.1), (arena.width_m - 0.3, arena.height_m - 0.3, 3.1)))
            if costmap.distance_at(goal.x, goal.y) > 0.4:
                break
        assert drive.go(goal).failure is None
        assert_arrived(drive, goal)


def test_robot_with_old_scans_drives_slower_and_touches_nothing() -> None:
    fastest = {}
    for every in (4, 18):
        drive = Drive(Arena(6.0, 3.0, [(2.7, 0.9, 3.2, 2.1)]), Pose2(0.6, 1.5, 0.0), grid=Arena(6.0, 3.0).grid())
        drive.scan_every = every
        goal = Pose2(5.3, 1.5, 0.0)
        assert drive.go(goal).failure is None
        assert_arrived(drive, goal)
        fastest[every] = max(math.hypot(vx, vy) for vx, vy, _ in drive.commands[60:])
        assert any("the last scan is up to" in line for line in drive.logs) == (every == 18)
    assert fastest[18] < 0.65 * fastest[4]


def test_turn_on_the_spot_is_a_valid_goal() -> None:
    drive = Drive(Arena(3.0, 3.0), Pose2(1.5, 1.5, 0.0))
    assert drive.go(Pose2(1.5, 1.5, math.pi)).failure is None
    assert_arrived(drive, Pose2(1.5, 1.5, math.pi))


def test_unmapped_box_is_driven_around() -> None:
    empty = Arena(6.0, 3.0)
    drive = Drive(Arena(6.0, 3.0, [(2.7, 0.9, 3.2, 2.1)]), Pose2(0.6, 1.5, 0.0), grid=empty.grid())
    goal = Pose2(5.3, 1.5, 0.0)
    assert drive.go(goal).failure is None
    assert_arrived(drive, goal)


def test_path_blocked_while_driving_is_replaced() -> None:
    arena = Arena(6.0, 4.0, [(2.5, 1.0, 3.5, 3.0)])
    drive = Drive(arena, Pose2(0.6, 0.5, 0.0), grid=arena.grid())
    goal = Pose2(5.4, 0.5, 0.0)
    drive.executive.start([goal], drive.now_s)
    for _ in range(80):
        drive.step()
    assert drive.base.truth.x > 1.2
    arena.boxes.append((2.9, -0.1, 3.2, 1.1))  # the lower path is blocked now
    for _ in range(1200):
        step = drive.step()
        if step.finished:
            break
    assert step.finished
    assert step.failure is None
    assert_arrived(drive, goal)
    assert max(pose.y for pose in drive.track) > 3.2


def test_goal_that_becomes_unreachable_fails_in_bounded_time() -> None:
    arena = Arena(6.0, 2.0)
    drive = Drive(arena, Pose2(0.6, 1.0, 0.0), grid=arena.grid())
    drive.executive.start([Pose2(5.4, 1.0, 0.0)], drive.now_s)
    for _ in range(60):
        drive.step()
    arena.boxes.append((3.2, -0.1, 3.5, 2.1))
    for _ in range(3000):
        step = drive.step()
        if step.finished:
            break
    assert step.finished
    assert step.failure in (Failure.NO_VALID_PATH, Failure.FAILED_TO_MAKE_PROGRESS, Failure.NO_VALID_CONTROL)
    assert step.reason
    assert step.velocity == ZERO
    assert drive.collisions == 0
    assert any("recovery" in line for line in drive.logs)


def test_goal_in_a_bench_fails_within_a_second_without_moving() -> None:
    drive = Drive(greenhouse(2), Pose2(0.45, 0.45, 0.0))
    step = drive.go(Pose2(2.1, 1.2, 0.0))
    assert step.failure is Failure.GOAL_OCCUPIED
    assert "from an obstacle" in step.reason
    assert drive.now_s < 1.0
    assert all(command == ZERO for command in drive.commands)


def test_blind_robot_stands_still_then_fails_with_the_reason() -> None:
    drive = Drive(Arena(6.0, 3.0), Pose2(0.6, 1.5, 0.0))
    drive.executive.start([Pose2(5.0, 1.5, 0.0)], drive.now_s)
    for _ in range(60):
        drive.step()
    drive.lidar_fault = "no message arrives on /scan"
    assert drive.step().velocity == ZERO
    for _ in range(400):
        step = drive.step()
        assert step.velocity == ZERO
        if step.finished:
            break
    assert step.failure is Failure.SENSOR_LOST
    assert "no message arrives on /scan" in step.reason


def test_robot_continues_when_the_lidar_recovers() -> None:
    drive = Drive(Arena(6.0, 3.0), Pose2(0.6, 1.5, 0.0))
    goal = Pose2(5.0, 1.5, 0.0)
    drive.executive.start([goal], drive.now_s)
    for i in range(900):
        drive.lidar_fault = "fog" if 60 < i < 200 else None
        if (step := drive.step()).finished:
            break
    assert step.failure is None
    assert_arrived(drive, goal)


def test_robot_soon_drives_as_fast_as_before_an_outage() -> None:
    drive = Drive(Arena(9.0, 3.0), Pose2(0.6, 1.5, 0.0))
    drive.executive.start([Pose2(8.4, 1.5, 0.0)], drive.now_s)
    for _ in range(100):
        drive.step()
    drive.scan_every = 10_000  # no scan arrives any more
    for _ in range(100):
        drive.lidar_fault = "no scan" if drive.now_s - drive.last_scan_s > 1.0 else None
        drive.step()
    assert set(drive.commands[-70:]) == {ZERO}
    drive.lidar_fault, drive.scan_every = None, 4
    for _ in range(100):
        drive.step()
    speeds = [math.hypot(vx, vy) for vx, vy, _ in drive.commands]
    assert max(speeds[-10:]) > 0.9 * max(speeds[50:100])
    assert max(speeds[210:220]) < 0.75 * max(speeds[50:100]), "slower at first: the link may be lost again"


def test_engaged_estop_fails_goal_and_release_moves_nothing() -> None:
    drive = Drive(Arena(6.0, 3.0), Pose2(0.6, 1.5, 0.0))
    goal = Pose2(5.0, 1.5, 0.0)
    drive.executive.start([goal], drive.now_s)
    for _ in range(60):
        drive.step()
    drive.executive.set_estop(True)
    step = drive.step()
    assert (step.failure, step.velocity) == (Failure.ESTOP_ENGAGED, ZERO)
    assert step.reason.startswith("e-stop engaged")
    drive.executive.set_estop(False)
    for _ in range(100):
        assert drive.step().velocity == ZERO
    assert drive.go(goal).failure is None
    assert_arrived(drive, goal)


@pytest.mark.parametrize("ticks_before_release", [0, 1])
def test_goal_that_starts_under_estop_fails(ticks_before_release: int) -> None:
    drive = Drive(Arena(6.0, 3.0), Pose2(0.6, 1.5, 0.0))
    drive.executive.set_estop(True)
    drive.executive.start([Pose2(5.0, 1.5, 0.0)], drive.now_s)
    steps = [drive.step() for _ in range(ticks_before_release)]
    drive.executive.set_estop(False)
    steps += [drive.step() for _ in range(40)]
    assert steps[0].failure is Failure.ESTOP_ENGAGED
    assert all(step.velocity == ZERO for step in steps)


def test_estop_between_two_ticks_fails_the_goal() -> None:
    drive = Drive(Arena(6.0, 3.0), Pose2(0.6, 1.5, 0.0))
    drive.executive.start([Pose2(5.0, 1.5, 0.0)], drive.now_s)
    for _ in range(60):
        drive.step()
    drive.executive.set_estop(True)
    drive.executive.set_estop(False)
    assert drive.step().failure is Failure.ESTOP_ENGAGED


class GoalsUnderEstop(RuleBasedStateMachine):
    """Goals, e-stop messages, ticks and cancellations in any order."""

    def __init__(self) -> None:
        super().__init__()
        self.drive = Drive(Arena(6.0, 3.0), Pose2(0.6, 1.5, 0.0))
        self.engaged = False
        self.may_move = False

    @rule(x=st.sampled_from((1.5, 5.0)), through=st.booleans())
    def goal(self, x: float, through: bool) -> None:
        goals = [Pose2(3.0, 1.5, 0.0)] * through + [Pose2(x, 1.5, 0.0)]
        self.drive.executive.start(goals, self.drive.now_s)
        self.may_move = not self.engaged

    @rule(engaged=st.booleans())
    def estop(self, engaged: bool) -> None:
        self.drive.executive.set_estop(engaged)
        self.engaged = engaged
        self.may_move = self.may_move and not engaged

    @rule()
    def cancel(self) -> None:
        self.drive.executive.stop()
        self.may_move = False

    @rule(ticks=st.integers(1, 12), lidar_fails=st.booleans())
    def tick(self, ticks: int, lidar_fails: bool) -> None:
        self.drive.lidar_fault = "fog" if lidar_fails else None
        for _ in range(ticks):
            step = self.drive.step()
            if not self.may_move:
                assert step.velocity == ZERO
                assert step.finished
            self.may_move = self.may_move and not step.finished


TestGoalsUnderEstop = GoalsUnderEstop.TestCase
TestGoalsUnderEstop.settings = settings(max_examples=30, stateful_step_count=30)


def test_lost_transforms_fail_with_their_own_error() -> None:
    executive = Executive(_SilentPlanner())
    executive.start([Pose2(1.0, 1.0, 0.0)], 0.0)
    for i in range(400):
        step = executive.tick(View(i * 0.05, None, None, ZERO, None))
        if step.finished:
            break
    assert step.failure is Failure.TF_ERROR
    assert "odom -> base_link" in step.reason


class _SilentPlanner:
    """A planner that never answers."""

    def request(self, start: Pose2, goals: Sequence[Pose2]) -> None: ...

    def take(self) -> None:
        return None

    def drop(self) -> None: ...

    def clear_obstacles(self) -> None: ...


def test_planner_that_never_answers_times_out() -> None:
    drive = Drive(Arena(3.0, 3.0), Pose2(1.0, 1.0, 0.0))
    drive.executive = Executive(_SilentPlanner())
    step = drive.go(Pose2(2.0, 2.0, 0.0), limit_s=20.0)
    assert step.failure is Failure.PLANNING_TIMED_OUT


class _StuckPlanner:
    """A planner whose path keeps the robot stuck."""

    def __init__(self, at: Pose2, goal: Pose2) -> None:
        self._plan = Plan(np.linspace((at.x, at.y), (goal.x, goal.y), 60))

    def request(self, start: Pose2, goals: Sequence[Pose2]) -> None: ...

    def take(self) -> Plan:
        return self._plan

    def drop(self) -> None: ...

    def clear_obstacles(self) -> None: ...


def test_stuck_robot_tries_all_recoveries_then_fails() -> None:
    drive = Drive(Arena(6.0, 3.0), Pose2(1.0, 1.5, 0.0))
    drive.base.drive = lambda _command, _dt: None  # type: ignore[assignment, method-assign]  # the wheels do not move
    drive.executive = Executive(_StuckPlanner(Pose2(1.0, 1.5), Pose2(5.0, 1.5)), log=drive.logs.append)
    step = drive.go(Pose2(5.0, 1.5, 0.0), limit_s=300.0)
    assert step.failure is Failure.FAILED_TO_MAKE_PROGRESS
    tried = " ".join(drive.logs)
    assert all(name in tried for name in ("clear the costmaps", "backup", "spin", "wait"))
    assert len(drive.logs) == 6


def test_new_goal_replaces_the_old_one_in_mid_drive() -> None:
    drive = Drive(Arena(6.0, 3.0), Pose2(0.6, 1.5, 0.0))
    drive.executive.start([Pose2(5.0, 1.5, 0.0)], drive.now_s)
    for _ in range(100):
        drive.step()
    goal = Pose2(0.8, 0.8, 1.0)
    assert drive.go(goal).failure is None
    assert_arrived(drive, goal)


class _ManualPlanner:
    """A planner whose answer the test sets."""

    def __init__(self) -> None:
        self.answer: Plan | None = None

    def request(self, start: Pose2, goals: Sequence[Pose2]) -> None: ...

    def take(self) -> Plan | None:
        answer, self.answer = self.answer, None
        return answer

    def drop(self) -> None:
        self.answer = None

    def clear_obstacles(self) -> None: ...


def test_path_planned_to_the_last_goal_is_discarded() -> None:
    drive = Drive(Arena(6.0, 3.0), Pose2(0.6, 1.5, 0.0))
    desk = _ManualPlanner()
    drive.executive = Executive(desk)
    drive.executive.start([Pose2(0.7, 1.5, 0.0)], 0.0)
    drive.step()
    drive.executive.stop()
    desk.answer = Plan(np.array([[0.6, 1.5], [0.62, 1.5], [0.64, 1.5]]))  # a late replan of the first goal
    # The same heading: a path that ends at the robot would count as an arrival.
    drive.executive.start([Pose2(5.0, 1.5, 0.0)], drive.now_s)
    assert not any(drive.step().finished for _ in range(10))


def test_intermediate_poses_are_passed_without_stopping() -> None:
    drive = Drive(Arena(6.0, 6.0), Pose2(0.6, 0.6, 0.0))
    corner, goal = Pose2(5.0, 0.8, 0.0), Pose2(5.0, 5.0, math.pi / 2)
    assert drive.go(corner, goal).failure is None
    assert_arrived(drive, goal)
    assert min(pose.distance_to(corner) for pose in drive.track) < 0.7


def test_step_after_stop_is_idle() -> None:
    drive = Drive(Arena(6.0, 3.0), Pose2(0.6, 1.5, 0.0))
    drive.executive.start([Pose2(5.0, 1.5, 0.0)], drive.now_s)
    for _ in range(60):
        drive.step()
    at_speed = drive.base.velocity[0]
    assert at_speed > 0.3
    drive.executive.stop()
    stopped_at = drive.base.truth
    for _ in range(40):
        step = drive.step()
        assert step.finished
        assert step.velocity == ZERO
    assert drive.base.truth.distance_to(stopped_at) < 0.15
    assert abs(drive.base.velocity[0]) < 0.01


def test_remaining_distance_decreases_while_driving() -> None:
    drive = Drive(Arena(6.0, 3.0), Pose2(0.6, 1.5, 0.0))
    drive.executive.start([Pose2(5.0, 1.5, 0.0)], drive.now_s)
    distances, etas = [], []
    for i in range(160):
        drive.step()
        if i % 20 == 19:
            progress = drive.executive.progress(drive.now_s)
            distances.append(progress.distance_remaining_m)
            etas.append(progress.estimated_time_remaining_s)
    assert distances == sorted(distances, reverse=True)
    assert distances[0] == pytest.approx(4.4, abs=0.3)
    assert 0.0 < etas[-1] < 20.0
