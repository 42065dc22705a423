from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.arm import ArmMotion, ArmState, Point, Refused, timed, window
from lupin_runtime.graph import ARM_JOINTS

S = 10**9
ANGLE = st.floats(-2, 2)
ARM = st.tuples(ANGLE, ANGLE, ANGLE, ANGLE)
POINTS = st.lists(st.tuples(st.floats(0, 60), ARM), min_size=1, max_size=40).map(
    lambda rows: [Point(*row) for row in sorted(rows)]
)


class Arm:
    """An arm on the other end of an ArmMotion: it is where the test says, and remembers what it was sent."""

    def __init__(self, at=(0.0, 0.0, 0.0, 0.0)) -> None:
        self.now_ns, self.state, self.sent = 100 * S, None, []
        self.motion = ArmMotion(lambda: self.state, self.sent.append, lambda: self.now_ns)
        if at is not None:
            self.be(at)

    def be(self, arm) -> None:
        self.state = ArmState(tuple(arm), 0.0, self.now_ns)

    @property
    def last(self):
        return self.sent[-1][-1]


@given(POINTS, st.floats(0, 5), st.floats(0, 3))
def test_times_of_a_replay_strictly_increase_and_it_ends_where_it_should(points, speed, lead_in_s):
    path = timed(points, speed, lead_in_s)
    assert path[0].t_s >= 0.1
    assert all(a.t_s < b.t_s for a, b in pairwise(path))
    assert path[-1].arm == points[-1].arm


@pytest.mark.parametrize(("speed", "scale"), [(0.0, 1.0), (math.nan, 1.0), (0.1, 4.0), (9.0, 0.5), (2.0, 0.5)])
def test_the_speed_of_a_replay_is_clamped_and_zero_means_as_recorded(speed, scale):
    path = timed([Point(0.0, (0.0,) * 4), Point(10.0, (1.0,) * 4)], speed, lead_in_s=1.0)
    assert path[-1].t_s == pytest.approx(1.0 + 10.0 * scale)


def test_a_replay_of_nothing_is_refused():
    with pytest.raises(ValueError, match="at least one"):
        timed([])


@given(ARM)
def test_a_move_sends_all_four_joints_within_their_windows(target):
    arm = Arm()
    arm.motion.move(target, 3.0)
    for joint, angle in zip(ARM_JOINTS, arm.last.arm):
        lower, upper = window(joint)
        assert lower <= angle <= upper


@given(ARM)
def test_a_pin_keeps_the_arm_where_it_is_even_outside_its_windows(at):
    arm = Arm(at)
    arm.motion.pin()
    assert arm.last.arm == at


def test_a_pin_needs_feedback_that_is_fresh():
    arm = Arm()
    arm.now_ns += 2 * S
    with pytest.raises(Refused, match="joint_states"):
        arm.motion.pin()


def test_a_single_joint_is_refused_until_it_is_known_where_the_arm_is():
    arm = Arm()
    with pytest.raises(Refused, match="pinned"):
        arm.motion.move_joint("wrist_joint", 0.1, 1.0)
    arm.motion.pin()
    arm.motion.move_joint("wrist_joint", 0.1, 1.0)
    assert arm.last.arm == (0.0, 0.0, 0.0, 0.1)


def test_a_single_joint_takes_as_long_as_its_way_at_its_rate():
    arm = Arm()
    arm.motion.pin()
    arm.motion.move_joint("elbow_joint", 1.0, 0.5)
    assert arm.last.t_s == pytest.approx(2.0)
    arm.motion.pin()
    arm.motion.move_joint("elbow_joint", 1.0, 0.0)
    assert arm.last.t_s == pytest.approx(1.0 / math.radians(60))
    arm.motion.move_joint("elbow_joint", 1.0, 1.0)
    assert arm.last.t_s >= 0.1


def test_the_other_joints_stay_as_commanded_through_sag_but_follow_a_hand():
    arm = Arm()
    arm.motion.move((0.5, 0.5, 0.5, 0.5), 3.0)
    arm.be((0.5, 0.45, 0.5, 0.5))
    arm.motion.move_joint("wrist_joint", 0.1, 1.0)
    assert arm.last.arm == (0.5, 0.5, 0.5, 0.1)
    arm.be((0.5, 0.2, 0.5, 0.1))
    arm.motion.move_joint("wrist_joint", 0.2, 1.0)
    assert arm.last.arm == (0.5, 0.2, 0.5, 0.2)


def test_stale_feedback_does_not_move_the_other_joints():
    arm = Arm()
    arm.motion.move((0.5, 0.5, 0.5, 0.5), 3.0)
    arm.be((0.0, 0.0, 0.0, 0.0))
    arm.now_ns += S
    arm.motion.move_joint("wrist_joint", 0.1, 1.0)
    assert arm.last.arm == (0.5, 0.5, 0.5, 0.1)


def test_a_limp_arm_is_not_commanded():
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


def test_a_replay_has_the_arm_for_itself():
    arm = Arm()
    arm.motion.pin()
    arm.motion.hold("playing wave")
    with pytest.raises(Refused, match="playing wave"):
        arm.motion.move((0.0,) * 4, 1.0)
    with pytest.raises(Refused, match="playing wave"):
        arm.motion.hold("playing nod")
    arm.motion.let_go("playing nod")
    assert arm.motion.holder == "playing wave"
    arm.motion.play([Point(0.0, (0.0,) * 4)], 1.0, "playing wave")
    arm.motion.let_go("playing wave")
    arm.motion.move((0.0,) * 4, 1.0)


def test_a_replay_that_begins_elsewhere_is_led_in_slowly():
    arm = Arm((0.0, 0.0, 0.0, 0.0))
    path = arm.motion.play([Point(0.0, (0.8, 0.0, 0.0, 0.0)), Point(1.0, (1.0, 0.0, 0.0, 0.0))], 1.0, "p")
    assert path[0].t_s == pytest.approx(1.0) and path[1].t_s == pytest.approx(2.0)


def test_stopping_holds_the_pose_of_the_moment_and_needs_no_feedback_to_be_safe():
    arm = Arm((0.1, 0.2, 0.3, 0.4))
    arm.motion.stop(0.3)
    assert arm.last == Point(0.3, (0.1, 0.2, 0.3, 0.4))
    blind = Arm(None)
    blind.motion.stop(0.3)
    assert blind.sent == []


def test_a_move_that_nobody_hears_is_refused_and_not_taken_for_sent():
    arm = Arm()
    deaf = ArmMotion(lambda: arm.state, arm.sent.append, lambda: arm.now_ns, listeners=lambda: 0)
    for command in (lambda: deaf.move((0.0,) * 4, 1.0), deaf.pin):
        with pytest.raises(Refused, match="auto_home"):
            command()
    assert arm.sent == [] and not deaf.pinned
