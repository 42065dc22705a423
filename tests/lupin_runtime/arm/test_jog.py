"""Rates become poses within the windows, without a jump; a jog has one owner, and each of its ends holds the arm."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.arm import ArmMotion, ArmState, window
from lupin_runtime.arm.jog import (
    AHEAD_S,
    FIRST_STEP_S,
    FORGET_S,
    HOLDER,
    MAX_LEAD_RAD,
    MAX_RATE_RADPS,
    MAX_STEP_S,
    RELEASE_FIRST,
    SILENT_S,
    STOP_LEAD_RAD,
    ArmJog,
    JogIntegrator,
    JogRates,
)
from lupin_runtime.arm.motion import Refused
from lupin_runtime.graph import ARM_JOINTS

MS, S = 10**6, 10**9
PAD = "a pad"
PAN = (1.0, 0.0, 0.0, 0.0)
ANGLE, RATE = st.floats(-2, 2), st.floats(-3, 3)
ARM, RATES = st.tuples(ANGLE, ANGLE, ANGLE, ANGLE), st.tuples(RATE, RATE, RATE, RATE)


class Rig:
    """An arm that stays where the test puts it, and its jog."""

    def __init__(self, at: tuple[float, float, float, float] = (0.1, 0.2, 0.3, -0.4)) -> None:
        self.now_ns = 100 * S
        self.at, self.gripper_at = at, 0.0
        self.feedback = True
        self.listeners = 1
        self.sent: list[Any] = []
        self.gripper: list[float] = []
        self.motion = ArmMotion(self._state, self.sent.append, lambda: self.now_ns, lambda: self.listeners, lambda: self.now_ns)
        self.motion.set_estop(False)
        self.motion.pin()
        self.jog = ArmJog(self.motion, self.gripper.append)

    def _state(self) -> ArmState | None:
        return ArmState(self.at, self.gripper_at, self.now_ns) if self.feedback else None

    def send(self, *arm: float, gripper: float = 0.0, source: str = PAD, after_ms: int = 50) -> None:
        self.now_ns += after_ms * MS
        pan, lift, elbow, wrist = arm or (0.0, 0.0, 0.0, 0.0)
        self.jog.handle(JogRates(source, (pan, lift, elbow, wrist), gripper), self.now_ns)

    def begin(self) -> None:
        """Jog the pan for half a second, with an arm that follows."""
        self.send()
        for _ in range(10):
            self.send(*PAN)
            self.at = (self.last[0] - 0.2, *self.at[1:])
        assert self.jog.source == PAD

    @property
    def last(self) -> tuple[float, ...]:
        return tuple(self.sent[-1][-1].arm)


@given(ARM, ARM, st.lists(st.tuples(RATES, ARM, st.integers(0, 300)), min_size=1, max_size=20))
def test_jogged_pose_is_bounded_and_never_jumps(held: Any, at: Any, steps: list[Any]) -> None:
    integrator, now_ns = JogIntegrator(held), 0
    lowest, highest = list(at), list(at)
    for rates, feedback, after_ms in [(steps[0][0], at, 0), *steps]:
        now_ns += after_ms * MS
        before, moved = integrator.arm, integrator.moving
        integrator.step(JogRates(PAD, rates).bounded(), ArmState(feedback, None, now_ns), now_ns)
        for index, (joint, rate) in enumerate(zip(ARM_JOINTS, rates)):
            target, is_at = integrator.arm[index], feedback[index]
            lowest[index], highest[index] = min(lowest[index], is_at), max(highest[index], is_at)
            lower, upper = window(joint)
            if rate == 0.0 and joint not in moved:
                assert target == before[index]
            elif rate == 0.0:
                assert abs(target - is_at) <= STOP_LEAD_RAD + 1e-9
            else:
                assert min(lower, lowest[index]) - 1e-9 <= target <= max(upper, highest[index]) + 1e-9
                start = before[index] if joint in moved else is_at
                stays_near = abs(target - start) <= MAX_RATE_RADPS * MAX_STEP_S + 1e-9
                assert stays_near or abs(start - is_at) > MAX_LEAD_RAD - MAX_RATE_RADPS * MAX_STEP_S


def test_integrator_follows_the_rate_from_feedback() -> None:
    integrator = JogIntegrator((0.0, 0.5, 0.0, 0.0))
    for index in range(4):
        state = ArmState((0.02, 0.4, 0.0, 0.0), None, 0)
        integrator.step(JogRates(PAD, PAN), state, index * 50 * MS)
    assert integrator.arm == pytest.approx((0.02 + FIRST_STEP_S + 3 * 0.05, 0.5, 0.0, 0.0))


def test_joint_outside_its_window_only_moves_back() -> None:
    outside = window("elbow_joint")[1] + 0.2
    integrator, state = JogIntegrator((0.0, 0.0, outside, 0.0)), ArmState((0.0, 0.0, outside, 0.0), None, 0)
    integrator.step(JogRates(PAD, (0.0, 0.0, 1.0, 0.0)), state, 0)
    assert integrator.arm[2] == outside
    integrator.step(JogRates(PAD, (0.0, 0.0, -1.0, 0.0)), state, 50 * MS)
    assert integrator.arm[2] == pytest.approx(outside - 0.05)


def test_command_leads_a_blocked_joint_by_a_bounded_angle() -> None:
    integrator, state = JogIntegrator((0.0,) * 4), ArmState((0.0,) * 4, None, 0)
    for index in range(100):
        integrator.step(JogRates(PAD, PAN), state, index * 50 * MS)
    assert integrator.arm[0] == MAX_LEAD_RAD


def test_jog_reserves_the_arm_until_its_release() -> None:
    rig = Rig()
    rig.begin()
    assert rig.motion.holder == HOLDER
    rig.send()
    assert rig.motion.holder is None
    assert abs(rig.last[0] - rig.at[0]) <= STOP_LEAD_RAD
    assert rig.jog.refusal == ""
    rig.send(*PAN)
    assert rig.jog.source == PAD


def test_jog_does_not_begin_without_rest_before_it() -> None:
    rig, sent = Rig(), 1
    rig.send(*PAN)
    assert len(rig.sent) == sent
    assert rig.jog.refusal == RELEASE_FIRST
    rig.send()
    rig.send(*PAN)
    assert rig.motion.holder == HOLDER


def test_silent_source_ends_the_jog_and_the_arm_holds() -> None:
    rig = Rig()
    rig.begin()
    rig.now_ns += int(SILENT_S * 1e9) + MS
    rig.jog.tick(rig.now_ns)
    assert rig.motion.holder is None
    assert "nothing was heard of a pad" in rig.jog.refusal
    assert abs(rig.last[0] - rig.at[0]) <= STOP_LEAD_RAD
    sent = len(rig.sent)
    rig.send(*PAN)
    assert len(rig.sent) == sent


def test_message_after_a_gap_does_not_continue_the_jog() -> None:
    rig = Rig()
    rig.begin()
    rig.send(*PAN, after_ms=300)
    assert rig.jog.source == ""
    assert abs(rig.last[0] - rig.at[0]) <= STOP_LEAD_RAD


def test_second_source_waits_until_the_first_is_at_rest() -> None:
    rig = Rig()
    rig.begin()
    rig.send(source="another", after_ms=10)
    rig.send(-1.0, 0.0, 0.0, 0.0, source="another", after_ms=10)
    assert rig.jog.source == PAD
    rig.send()
    rig.send(-1.0, 0.0, 0.0, 0.0, source="another", after_ms=10)
    assert rig.jog.source == ""
    rig.send(source="another", after_ms=10)
    rig.send(-1.0, 0.0, 0.0, 0.0, source="another", after_ms=10)
    assert rig.jog.source == "another"


def test_estop_ends_the_jog_and_its_release_resumes_nothing() -> None:
    rig = Rig()
    rig.begin()
    rig.motion.set_estop(True)
    held = rig.last
    rig.jog.tick(rig.now_ns)
    assert rig.motion.holder is None
    assert rig.jog.refusal.startswith("e-stop engaged")
    rig.motion.set_estop(False)
    rig.now_ns += S
    rig.send(*PAN)
    assert rig.last == held


@pytest.mark.parametrize("ending", ["limp", "stopped", "blocked", "no controller", "no feedback", "not finite"])
def test_jog_ends_and_names_its_reason(ending: str) -> None:
    rig = Rig()
    rig.begin()
    expected = {
        "limp": "limp",
        "stopped": "was stopped",
        "blocked": "shoulder_pan_joint does not follow",
        "no controller": "no arm controller is subscribed",
        "no feedback": "pose is unknown",
        "not finite": "finite",
    }
    if ending == "limp":
        rig.motion.torque = False
    elif ending == "stopped":
        rig.motion.stop(0.3)
    elif ending == "blocked":
        rig.motion.blocked = ("shoulder_pan_joint",)
    elif ending == "no controller":
        rig.listeners = 0
    elif ending == "no feedback":
        rig.feedback = False
    if ending == "not finite":
        with pytest.raises(ValueError, match="finite"):
            rig.send(math.nan, 0.0, 0.0, 0.0)
    else:
        rig.send(*PAN)
    assert rig.jog.source == ""
    assert rig.motion.holder is None
    assert expected[ending] in rig.jog.refusal
    sent = len(rig.sent)
    rig.motion.torque, rig.motion.blocked, rig.feedback, rig.listeners = None, (), True, 1
    rig.send(*PAN)
    assert len(rig.sent) == sent


def test_another_joint_that_is_blocked_ends_no_jog() -> None:
    rig = Rig()
    rig.begin()
    rig.motion.blocked = ("wrist_joint",)
    rig.send(*PAN)
    assert rig.jog.source == PAD


def test_joint_blocked_before_may_be_jogged_free() -> None:
    rig = Rig()
    rig.motion.blocked = ("shoulder_pan_joint",)
    rig.begin()
    rig.motion.blocked = ()
    rig.send(*PAN)
    rig.motion.blocked = ("shoulder_pan_joint",)
    rig.send(*PAN)
    assert "shoulder_pan_joint does not follow" in rig.jog.refusal


def test_refusal_lasts_as_long_as_its_source_is_heard() -> None:
    rig = Rig()
    rig.send(*PAN)
    for _ in range(200):
        rig.send(*PAN)
        rig.jog.tick(rig.now_ns)
    assert rig.jog.refusal == RELEASE_FIRST
    rig.now_ns += int(FORGET_S * 1e9) + MS
    rig.jog.tick(rig.now_ns)
    assert rig.jog.refusal == ""


def test_jog_is_refused_while_a_replay_has_the_arm() -> None:
    rig = Rig()
    rig.motion.hold("playing wave")
    rig.send()
    rig.send(*PAN)
    assert rig.jog.source == ""
    assert "reserved: playing wave" in rig.jog.refusal
    assert rig.motion.holder == "playing wave"


def test_jog_moves_no_joint_whose_control_is_at_rest() -> None:
    rig = Rig()
    rig.at = (0.1, 0.15, 0.3, -0.4)  # sags a little
    rig.send()
    rig.send(*PAN)
    assert rig.last[1:] == (0.2, 0.3, -0.4)


def test_gripper_jog_ends_a_motion_and_no_joint_jumps_after_it() -> None:
    rig = Rig()
    rig.motion.move((0.1, 1.2, -1.2, -0.4), 3.0)
    rig.now_ns += S
    rig.send()
    rig.send(gripper=0.4)
    assert rig.sent[-1][-1].t_s == AHEAD_S
    held = rig.last
    assert held[1] < 0.9 and held[2] > -0.9  # on the way
    rig.at = held  # type: ignore[assignment]
    rig.send(*PAN, gripper=0.4, after_ms=3000 // 20)
    assert rig.last[1:] == pytest.approx(held[1:])


def test_stop_of_the_arm_refuses_the_next_pose_of_a_stream() -> None:
    rig = Rig()
    counts = rig.motion.estop_count, rig.motion.stop_count
    rig.motion.hold("jogging")
    rig.motion.follow(rig.at, 0.2, "jogging", *counts)
    rig.motion.stop(0.2)
    with pytest.raises(Refused, match="the arm was stopped"):
        rig.motion.follow(rig.at, 0.2, "jogging", *counts)


def test_gripper_moves_alone_and_keeps_its_grip_afterwards() -> None:
    rig, sent = Rig(), 1
    rig.send()
    for _ in range(3):
        rig.send(gripper=0.4)
    assert rig.gripper == pytest.approx([0.02, 0.04, 0.06])
    rig.send()
    assert rig.gripper == pytest.approx([0.02, 0.04, 0.06])
    assert len(rig.sent) == sent + 1 and rig.sent[-1][-1].arm == rig.sent[0][-1].arm  # the arm holds


def test_close_ends_the_jog() -> None:
    rig = Rig()
    rig.begin()
    rig.jog.close()
    assert rig.motion.holder is None
    assert abs(rig.last[0] - rig.at[0]) <= STOP_LEAD_RAD
