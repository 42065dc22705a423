"""Moves, holds and replays stay within the limits and need fresh feedback."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.arm import ArmMotion, ArmState, Point, Refused, retime, window
from lupin_runtime.graph import ARM_JOINTS
from lupin_runtime.safety.estop_monitor import DRAIN_S
from tests.support.optional import present

S = 10**9
ANGLE = st.floats(-2, 2)
ARM = st.tuples(ANGLE, ANGLE, ANGLE, ANGLE)
POINTS = st.lists(st.tuples(st.floats(0, 60), ARM), min_size=1, max_size=40).map(
    lambda rows: [Point(*row) for row in sorted(rows)]
)


class Arm:
    """The arm behind an ArmMotion: the test sets its pose, and it records the commands."""

    def __init__(self, at: tuple[float, ...] | None = (0.0, 0.0, 0.0, 0.0)) -> None:
        self.now_ns = 100 * S
        self.state: ArmState | None = None
        self.sent: list[Any] = []
        self.motion = ArmMotion(lambda: self.state, self.sent.append, lambda: self.now_ns, real_ns=lambda: self.now_ns)
        self.motion.set_estop(False)
        if at is not None:
            self.set_pose(at)

    def set_pose(self, arm: Iterable[float]) -> None:
        pan, lift, elbow, wrist = arm
        self.state = ArmState((pan, lift, elbow, wrist), 0.0, self.now_ns)

    @property
    def last(self) -> Any:
        return self.sent[-1][-1]


@given(POINTS, st.floats(0, 5), st.floats(0, 3))
def test_replay_times_strictly_increase_to_the_last_point(points: list[Any], speed: float, lead_in_s: float) -> None:
    path = retime(points, speed, lead_in_s)
    assert path[0].t_s >= 0.1
    assert all(a.t_s < b.t_s for a, b in pairwise(path))
    assert path[-1].arm == points[-1].arm


@pytest.mark.parametrize(("speed", "scale"), [(0.0, 1.0), (math.nan, 1.0), (0.1, 4.0), (9.0, 0.5), (2.0, 0.5)])
def test_replay_speed_is_clamped_and_zero_means_recorded(speed: float, scale: float) -> None:
    path = retime([Point(0.0, (0.0,) * 4), Point(10.0, (1.0,) * 4)], speed, lead_in_s=1.0)
    assert path[-1].t_s == pytest.approx(1.0 + 10.0 * scale)


def test_empty_replay_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        retime([])


@given(ARM)
def test_move_sends_all_four_joints_within_their_windows(target: tuple[float, ...]) -> None:
    arm = Arm()
    arm.motion.move(target, 3.0)
    for joint, angle in zip(ARM_JOINTS, arm.last.arm):
        lower, upper = window(joint)
        assert lower <= angle <= upper


@given(ARM)
def test_hold_keeps_the_arm_even_outside_its_windows(at: tuple[float, ...]) -> None:
    arm = Arm(at)
    arm.motion.pin()
    assert arm.last.arm == at


def test_hold_needs_fresh_feedback() -> None:
    arm = Arm()
    arm.now_ns += 2 * S
    with pytest.raises(Refused, match="joint_states"):
        arm.motion.pin()


def moving_arm(since_feedback_s: float) -> Arm:
    """Return an arm on its way, whose feedback is as old as that: this process was held up."""
    arm = Arm()
    arm.motion.move((1.2, 0.0, 0.0, 0.0), 3.0)
    arm.now_ns += S
    arm.set_pose((0.4, 0.0, 0.0, 0.0))
    arm.now_ns += int(since_feedback_s * S)
    return arm


@pytest.mark.parametrize("is_press", [True, False], ids=["e-stop", "stop"])
def test_moving_arm_is_held_where_it_is_not_where_it_was(is_press: bool) -> None:
    arm = moving_arm(0.45)
    if is_press:
        arm.motion.set_estop(True)
    else:
        arm.motion.stop(0.3)
    assert len(arm.sent) == 1
    arm.set_pose((0.58, 0.0, 0.0, 0.0))
    arm.motion.set_estop(is_press)  # repeated, as it is five times a second
    assert arm.last.arm == (0.58, 0.0, 0.0, 0.0)
    arm.motion.set_estop(is_press)
    assert len(arm.sent) == 2


@pytest.mark.parametrize("is_press", [True, False], ids=["e-stop", "stop"])
def test_last_feedback_must_do_if_no_other_comes(is_press: bool) -> None:
    arm = moving_arm(0.2)
    if is_press:
        arm.motion.set_estop(True)
    else:
        arm.motion.stop(0.3)
    arm.now_ns += S // 5
    arm.motion.set_estop(is_press)
    assert arm.last.arm == (0.4, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("stop", [lambda motion: motion.set_estop(True), lambda motion: motion.stop(0.3)])
def test_old_feedback_is_not_used_before_the_wait_ends(stop: Callable[[ArmMotion], None]) -> None:
    arm = moving_arm(0.25)
    stop(arm.motion)
    for _ in range(3):
        arm.motion.hold_if_due()  # as arm_monitor calls it, at any time
        arm.now_ns += S // 20
    assert len(arm.sent) == 1
    arm.now_ns += S // 20
    arm.motion.hold_if_due()
    assert arm.last.arm == (0.4, 0.0, 0.0, 0.0)


def test_stop_after_a_hang_uses_later_feedback() -> None:
    arm = moving_arm(0.0)
    arm.motion.stop_soon()
    arm.now_ns += S // 20
    arm.motion.hold_if_due()  # what there is has waited while the process was held up
    assert len(arm.sent) == 1
    arm.now_ns += S // 20
    arm.set_pose((0.6, 0.0, 0.0, 0.0))
    arm.motion.hold_if_due()
    assert arm.last.arm == (0.6, 0.0, 0.0, 0.0)


def test_stop_that_waits_gives_way_to_a_later_command() -> None:
    arm = moving_arm(0.45)
    arm.motion.stop(0.3)
    arm.motion.move((0.9, 0.0, 0.0, 0.0), 3.0)
    arm.set_pose((0.6, 0.0, 0.0, 0.0))
    arm.motion.set_estop(False)
    assert arm.last.arm == (0.9, 0.0, 0.0, 0.0)


def test_limp_arm_is_not_held() -> None:
    arm = moving_arm(0.45)
    arm.motion.torque = False
    arm.motion.stop(0.3)
    arm.set_pose((0.6, 0.0, 0.0, 0.0))
    arm.motion.set_estop(False)
    assert len(arm.sent) == 1


def test_single_joint_is_refused_until_the_pose_is_known() -> None:
    arm = Arm()
    with pytest.raises(Refused, match="pose is not known"):
        arm.motion.move_joint("wrist_joint", 0.1, 1.0)
    arm.motion.pin()
    arm.motion.move_joint("wrist_joint", 0.1, 1.0)
    assert arm.last.arm == (0.0, 0.0, 0.0, 0.1)


def test_single_joint_duration_follows_distance_and_rate() -> None:
    arm = Arm()
    arm.motion.pin()
    arm.motion.move_joint("elbow_joint", 1.0, 0.5)
    assert arm.last.t_s == pytest.approx(2.0)
    arm.motion.pin()
    arm.motion.move_joint("elbow_joint", 1.0, 0.0)
    assert arm.last.t_s == pytest.approx(1.0 / math.radians(60))
    arm.motion.move_joint("elbow_joint", 1.0, 1.0)
    assert arm.last.t_s >= 0.1


def test_other_joints_ignore_sag_but_follow_a_hand() -> None:
    arm = Arm()
    arm.motion.move((0.5, 0.5, 0.5, 0.5), 3.0)
    arm.set_pose((0.5, 0.45, 0.5, 0.5))
    arm.motion.move_joint("wrist_joint", 0.1, 1.0)
    assert arm.last.arm == (0.5, 0.5, 0.5, 0.1)
    arm.set_pose((0.5, 0.2, 0.5, 0.1))
    arm.motion.move_joint("wrist_joint", 0.2, 1.0)
    assert arm.last.arm == (0.5, 0.2, 0.5, 0.2)


def test_stale_feedback_does_not_move_the_other_joints() -> None:
    arm = Arm()
    arm.motion.move((0.5, 0.5, 0.5, 0.5), 3.0)
    arm.set_pose((0.0, 0.0, 0.0, 0.0))
    arm.now_ns += S
    arm.motion.move_joint("wrist_joint", 0.1, 1.0)
    assert arm.last.arm == (0.5, 0.5, 0.5, 0.1)


def test_limp_arm_is_not_commanded() -> None:
    arm = Arm()
    arm.motion.pin()
    arm.motion.torque = False
    sent = len(arm.sent)
    for command in (
        lambda: arm.motion.move((0.0,) * 4, 1.0),
        lambda: arm.motion.move_joint("wrist_joint", 0.1, 1.0),
        lambda: arm.motion.play([Point(0.0, (0.0,) * 4)], 1.0, "playing x"),
    ):
        with pytest.raises(Refused, match="set_torque"):
            command()
    assert len(arm.sent) == sent


def test_replay_reserves_the_arm() -> None:
    arm = Arm()
    arm.motion.pin()
    arm.motion.hold("playing wave")
    with pytest.raises(Refused, match="playing wave"):
        arm.motion.move((0.0,) * 4, 1.0)
    with pytest.raises(Refused, match="playing wave"):
        arm.motion.hold("playing nod")
    arm.motion.release("playing nod")
    assert arm.motion.holder == "playing wave"
    arm.motion.play([Point(0.0, (0.0,) * 4)], 1.0, "playing wave")
    arm.motion.release("playing wave")
    arm.motion.move((0.0,) * 4, 1.0)


def test_distant_replay_start_gets_a_slow_lead_in() -> None:
    arm = Arm((0.0, 0.0, 0.0, 0.0))
    path = arm.motion.play([Point(0.0, (0.8, 0.0, 0.0, 0.0)), Point(1.0, (1.0, 0.0, 0.0, 0.0))], 1.0, "p")
    assert path[0].t_s == pytest.approx(1.0) and path[1].t_s == pytest.approx(2.0)


def test_stop_holds_the_current_pose_even_without_feedback() -> None:
    arm = Arm((0.1, 0.2, 0.3, 0.4))
    arm.motion.stop(0.3)
    assert arm.last == Point(0.3, (0.1, 0.2, 0.3, 0.4))
    blind = Arm(None)
    blind.motion.stop(0.3)
    assert blind.sent == []


def test_exit_holds_an_arm_that_still_moves() -> None:
    arm = Arm()
    arm.motion.play([Point(0.0, (0.0,) * 4), Point(30.0, (1.0,) * 4)], 1.0, "playing wave")
    arm.set_pose((0.4, 0.4, 0.4, 0.4))
    assert arm.motion.stop_unfinished() and arm.last.arm == (0.4, 0.4, 0.4, 0.4)
    assert not arm.motion.stop_unfinished(), "the nodes of a process share the arm"
    arm.motion.move((1.0,) * 4, 3.0)
    arm.now_ns += 4 * S
    arm.set_pose((0.9,) * 4)  # sagged
    assert not arm.motion.stop_unfinished(), "at rest"
    arm.motion.move((0.0,) * 4, 3.0)
    arm.motion.torque = False
    assert not arm.motion.stop_unfinished(), "limp"


def test_move_without_a_subscriber_is_refused() -> None:
    arm = Arm()
    deaf = ArmMotion(lambda: arm.state, arm.sent.append, lambda: arm.now_ns, listeners=lambda: 0)
    deaf.set_estop(False)
    for command in (lambda: deaf.move((0.0,) * 4, 1.0), deaf.pin):
        with pytest.raises(Refused, match="lupin home"):
            command()  # type: ignore[no-untyped-call]
    assert arm.sent == [] and not deaf.pinned


def test_arm_is_not_moved_before_the_estop_is_known() -> None:
    arm = Arm()
    new = ArmMotion(lambda: arm.state, arm.sent.append, lambda: arm.now_ns, real_ns=lambda: arm.now_ns)
    new.pin()
    sent = len(arm.sent)
    for move in (
        lambda: new.move((0.0,) * 4, 3.0),
        lambda: new.move_joint(ARM_JOINTS[0], 0.0, 1.0),
        lambda: new.play([Point(0.0, (0.0,) * 4)], 1.0, "playing nod"),
        new.require_released,
    ):
        with pytest.raises(Refused, match=r"^no e-stop state received yet"):  # auto-home repeats its request
            move()
    assert len(arm.sent) == sent
    new.set_estop(False)
    new.move((0.0,) * 4, 3.0)


def test_estop_holds_the_present_pose_and_refuses_moves() -> None:
    arm = Arm()
    arm.motion.move((1.0, 0.0, 0.0, 0.0), 3.0)
    arm.set_pose((0.4, 0.1, 0.0, 0.0))  # on its way
    arm.motion.set_estop(True)
    assert arm.last.arm == (0.4, 0.1, 0.0, 0.0)
    sent = len(arm.sent)
    for move in (
        lambda: arm.motion.move((0.0,) * 4, 3.0),
        lambda: arm.motion.move_joint(ARM_JOINTS[0], 0.0, 1.0),
        lambda: arm.motion.play([Point(0.0, (0.0,) * 4)], 1.0, "playing nod"),
    ):
        with pytest.raises(Refused, match="e-stop engaged"):
            move()
    arm.motion.set_estop(True)
    assert len(arm.sent) == sent
    arm.motion.set_estop(False)
    assert len(arm.sent) == sent + 1 and arm.last.arm == (0.4, 0.1, 0.0, 0.0)
    with pytest.raises(Refused, match="e-stop engaged"):
        arm.motion.move((0.0,) * 4, 3.0)  # it was queued before the release
    arm.now_ns += int(DRAIN_S * S)
    arm.motion.move((0.0,) * 4, 3.0)


def test_arm_that_leaves_its_hold_is_brought_back() -> None:
    """A trajectory of another publisher may reach the controller after the hold that was sent to replace it."""
    arm = Arm((0.1, 0.2, 0.3, -0.4))
    arm.motion.set_estop(True)
    held = arm.last.arm
    arm.set_pose((0.15, 0.2, 0.3, -0.4))  # within the deviation of an arm at rest
    arm.motion.set_estop(True)
    assert len(arm.sent) == 1
    arm.set_pose((0.3, 0.2, 0.3, -0.4))
    arm.motion.set_estop(True)
    assert len(arm.sent) == 2 and arm.last.arm == held
    arm.now_ns += 5 * S  # without fresh feedback it is unknown whether the arm left
    arm.motion.set_estop(True)
    assert len(arm.sent) == 2


def test_release_replaces_whatever_the_controller_follows() -> None:
    arm = Arm((0.1, 0.2, 0.3, -0.4))
    arm.motion.set_estop(True)
    held = arm.last.arm
    arm.motion.set_estop(False)
    assert len(arm.sent) == 2 and arm.last.arm == held
    arm.motion.set_estop(False)
    assert len(arm.sent) == 2


def test_estop_holds_the_arm_once_its_pose_is_known() -> None:
    arm = Arm()
    arm.motion.move((1.0, 0.0, 0.0, 0.0), 30.0)
    arm.now_ns += 5 * S
    arm.motion.set_estop(True)
    arm.motion.set_estop(False)
    assert len(arm.sent) == 1
    arm.set_pose((0.6, 0.0, 0.0, 0.0))
    arm.motion.set_estop(False)
    assert arm.last.arm == (0.6, 0.0, 0.0, 0.0)


def test_estop_does_not_command_a_limp_arm() -> None:
    arm = Arm()
    arm.motion.torque = False
    arm.motion.set_estop(True)
    assert arm.sent == []


def test_command_that_waited_through_an_estop_is_refused() -> None:
    arm = Arm()
    since = arm.motion.estop_count
    arm.motion.require_released(since)
    arm.motion.set_estop(True)
    arm.motion.set_estop(False)
    arm.now_ns += int(DRAIN_S * S)
    arm.motion.require_released()
    with pytest.raises(Refused, match="e-stop engaged"):
        arm.motion.require_released(since)


@given(st.lists(st.one_of(st.booleans(), ARM), max_size=30))
def test_after_a_release_only_newer_commands_move_the_arm(events: list[Any]) -> None:
    """Booleans are messages of the e-stop, tuples are moves; the arm goes half of the way to every commanded pose."""
    arm = Arm()
    engaged = False
    held = None
    for event in events:
        sent = len(arm.sent)
        if isinstance(event, bool):
            edge, engaged = event != engaged, event
            arm.motion.set_estop(event)
            assert len(arm.sent) == sent + edge
            arm.now_ns += int(DRAIN_S * S)
            arm.set_pose(present(arm.state).arm)
            if edge and engaged:
                held = present(arm.state).arm
            assert not edge or present(arm.last).arm == held
        elif engaged:
            with pytest.raises(Refused):
                arm.motion.move(event, 1.0)
            assert len(arm.sent) == sent
        else:
            arm.motion.move(event, 1.0)
            arm.set_pose([(at + to) / 2 for at, to in zip(present(arm.state).arm, present(arm.last).arm)])


@given(st.lists(ARM, max_size=3), st.booleans())
def test_trajectory_of_others_is_replaced_by_the_held_pose(
    path: list[tuple[float, float, float, float]], engaged: bool
) -> None:
    arm = Arm((0.1, 0.2, 0.3, -0.4))
    arm.motion.set_estop(True)
    held = arm.last.arm
    arm.motion.set_estop(engaged)
    arm.set_pose((0.1, 0.15, 0.3, -0.4))  # moved by the other trajectory, or by its weight
    sent = len(arm.sent)
    arm.motion.counter(path)
    assert len(arm.sent) == sent + (engaged and path != [held])
    assert arm.last.arm == held
    sent = len(arm.sent)
    arm.motion.counter([held])  # its own message
    assert len(arm.sent) == sent


def test_target_from_before_the_estop_is_not_held() -> None:
    arm = Arm()
    arm.motion.move((1.0, 0.0, 0.0, 0.0), 30.0)
    arm.now_ns += 5 * S
    arm.motion.set_estop(True)  # without fresh feedback
    arm.motion.counter([(0.5, 0.0, 0.0, 0.0)])
    assert len(arm.sent) == 1
