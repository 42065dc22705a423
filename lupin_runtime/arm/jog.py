"""Jogging: joint rates, which arrive as a stream, become trajectories of the arm and angles of the gripper.

A jog begins at fresh feedback and reserves the arm. It ends, and the arm holds where it is, with a message of zeros, and also
if the stream falls silent, a joint is blocked, the e-stop engages, the arm becomes limp or is stopped by somebody else. After
each of these, and before a first jog, the source must have sent zeros once: what was held all along moves nothing.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

from lupin_runtime.arm.limits import GRIPPER_CLOSED_RAD, GRIPPER_OPEN_RAD, Arm, window
from lupin_runtime.arm.motion import HOLD_FRESH_S, ArmMotion, ArmState, Refused
from lupin_runtime.graph import ARM_JOINTS, GRIPPER_JOINT

SILENT_S = 0.25  # after which a source that jogs is lost
FORGET_S = 5.0  # after which the refusal of a source that is no longer heard is none any more
AHEAD_S = 0.2  # from a message to the pose of its trajectory: the vendor's controller runs at 10 Hz
FIRST_STEP_S = 0.05  # how long the first message of a motion counts, and each other one at most MAX_STEP_S
MAX_STEP_S = 0.1
MAX_RATE_RADPS = 2.0  # of a joint, by the robot's description
# The command leads the feedback of a blocked joint by no more than this, so that it does not jump once it is free.
MAX_LEAD_RAD = 0.5
# Of a joint that is let go of: it stops here, without going back for what it moved since the feedback was measured.
STOP_LEAD_RAD = 0.05

AXES = (*ARM_JOINTS, GRIPPER_JOINT)
HOLDER = "jogging"
RELEASE_FIRST = "let go of the arm's controls first, then use them again"


@dataclass(frozen=True)
class JogRates:
    """What a source commands: rad/s of the arm's joints and of the gripper, which closes with a positive rate."""

    source: str
    arm: Arm = (0.0, 0.0, 0.0, 0.0)
    gripper: float = 0.0

    @property
    def at_rest(self) -> bool:
        """Whether nothing is to move."""
        return not any(self.arm) and not self.gripper

    def bounded(self) -> JogRates:
        """Return these rates, each at most MAX_RATE_RADPS. Raises ValueError if one is not finite."""
        if not all(math.isfinite(rate) for rate in (*self.arm, self.gripper)):
            raise ValueError(f"expected finite rates, found {(*self.arm, self.gripper)}")
        pan, lift, elbow, wrist, gripper = (
            max(-MAX_RATE_RADPS, min(MAX_RATE_RADPS, rate)) for rate in (*self.arm, self.gripper)
        )
        return replace(self, arm=(pan, lift, elbow, wrist), gripper=gripper)


class _Axis:
    """The integrator of one joint, in rad."""

    def __init__(self, held_rad: float | None, limits: tuple[float, float]) -> None:
        self.target_rad = held_rad
        self.moves = False
        self._limits = self._lower, self._upper = limits

    def step(self, rate: float, at_rad: float, duration_s: float) -> None:
        if not self.moves or self.target_rad is None:
            # A joint that was moved by hand may be outside its window. It may move back, but does not jump there.
            self.target_rad = at_rad
            self._lower, self._upper = min(self._limits[0], at_rad), max(self._limits[1], at_rad)
            self.moves = True
        target = self.target_rad + rate * duration_s
        target = max(at_rad - MAX_LEAD_RAD, min(at_rad + MAX_LEAD_RAD, target))
        self.target_rad = max(self._lower, min(self._upper, target))

    def stop(self, at_rad: float) -> None:
        if self.moves and self.target_rad is not None:
            self.target_rad = max(at_rad - STOP_LEAD_RAD, min(at_rad + STOP_LEAD_RAD, self.target_rad))
        self.moves = False


class JogIntegrator:
    """Integrates rates from the pose `held`, at which the joints stay that are not moved. Times are ns of a monotonic clock."""

    def __init__(self, held: Arm) -> None:
        limits = {GRIPPER_JOINT: (GRIPPER_OPEN_RAD, GRIPPER_CLOSED_RAD)}
        self._axes = [_Axis(rad, limits.get(joint) or window(joint)) for joint, rad in zip(AXES, (*held, None))]
        self._stepped_ns: int | None = None

    def step(self, rates: JogRates, state: ArmState, now_ns: int) -> None:
        """Integrate `rates` since the last step. `state` is fresh feedback; without the gripper's, the gripper stays."""
        since_s = math.inf if self._stepped_ns is None else (now_ns - self._stepped_ns) / 1e9
        self._stepped_ns = now_ns
        for axis, rate, at_rad in zip(self._axes, (*rates.arm, rates.gripper), (*state.arm, state.gripper)):
            if at_rad is None:
                continue
            if rate:
                axis.step(rate, at_rad, max(0.0, min(since_s, MAX_STEP_S)) if axis.moves else FIRST_STEP_S)
            elif axis is not self._axes[-1]:
                axis.stop(at_rad)
            else:
                axis.moves = False  # the gripper keeps its command: what it holds would fall

    @property
    def moving(self) -> tuple[str, ...]:
        """The joints that are being moved."""
        return tuple(joint for joint, axis in zip(AXES, self._axes) if axis.moves)

    @property
    def arm(self) -> Arm:
        """The commanded pose."""
        pan, lift, elbow, wrist = (axis.target_rad or 0.0 for axis in self._axes[:-1])
        return pan, lift, elbow, wrist

    @property
    def gripper(self) -> float | None:
        """The commanded angle of the gripper; None if it was not moved."""
        return self._axes[-1].target_rad


class ArmJog:
    """Follows the streams of rates with the arm `motion`. Times are nanoseconds of the monotonic clock.

    `send_gripper` is called with each angle of the gripper, in rad. Of several sources, the first one jogs until it is at rest.
    """

    def __init__(self, motion: ArmMotion, send_gripper: Callable[[float], None]) -> None:
        self._motion, self._send_gripper = motion, send_gripper
        self._lock = threading.Lock()
        self._integrator: JogIntegrator | None = None
        self._source = ""
        self._at_rest = ""  # the source that has sent zeros last, and may begin
        self._heard_ns = 0
        self._counts = (0, 0)  # of e-stops and of stops when the jog began
        self._were_blocked: set[str] = set()  # joints that did not follow before the jog, and have not since
        self.refusal = ""  # why the rates that arrive move nothing

    @property
    def source(self) -> str:
        """The source that jogs; empty if none does."""
        return self._source

    def handle(self, rates: JogRates, now_ns: int) -> None:
        """Follow a message of rates. Raises ValueError if it has a rate that is not finite; then the jog has ended."""
        with self._lock:
            self._end_if_silent(now_ns)
            if self._source not in ("", rates.source):
                return
            try:
                self._follow(rates.bounded(), now_ns)
            except (Refused, ValueError) as refusal:
                self._end(str(refusal))
                if isinstance(refusal, ValueError):
                    raise

    def tick(self, now_ns: int) -> None:
        """End a jog whose source is silent, or that must not go on; call it several times in SILENT_S."""
        with self._lock:
            self._end_if_silent(now_ns)
            if now_ns - self._heard_ns > FORGET_S * 1e9:
                self.refusal = ""
            if self._source:
                try:
                    self._require_permission()
                except Refused as refusal:
                    self._end(str(refusal))

    def close(self) -> None:
        """End the jog; the arm holds."""
        with self._lock:
            if self._source:
                self._end("")

    def _follow(self, rates: JogRates, now_ns: int) -> None:
        self._heard_ns = now_ns
        if rates.at_rest:
            if self._source:
                self._end("")
            self._at_rest, self.refusal = rates.source, ""
            return
        if not self._source:
            if self._at_rest != rates.source:
                self.refusal = self.refusal or RELEASE_FIRST
                return
            self._begin(rates)
        self._fresh_state()
        integrator = self._integrator
        assert integrator is not None
        self._require_permission()
        state = self._motion.state(fresh=True, max_age_s=HOLD_FRESH_S)
        if state is None:
            return  # commands near an older pose would throw a moving arm back
        before = integrator.arm, integrator.gripper
        integrator.step(rates, state, now_ns)
        if any(rates.arm) or integrator.arm != before[0]:
            self._motion.follow(integrator.arm, AHEAD_S, HOLDER, *self._counts)
        if integrator.gripper is not None and integrator.gripper != before[1]:
            self._send_gripper(integrator.gripper)

    def _begin(self, rates: JogRates) -> None:
        self._motion.hold(HOLDER)
        self._source, self._counts = rates.source, (self._motion.estop_count, self._motion.stop_count)
        self.refusal, self._were_blocked = "", set(self._motion.blocked)
        self._integrator = JogIntegrator(self._motion.held_pose(self._fresh_state()))
        if not any(rates.arm):
            # The arm is the jog's from here on: a motion that is going on ends, although only the gripper is jogged.
            self._require_permission()
            self._motion.follow(self._integrator.arm, AHEAD_S, HOLDER, *self._counts)

    def _end(self, refusal: str) -> None:
        """End the jog. The arm stops where it is, unless somebody else has stopped it already."""
        integrator, self._integrator = self._integrator, None
        was_source, self._source, self._at_rest, self.refusal = self._source, "", "", refusal
        state = self._motion.state(fresh=True, max_age_s=HOLD_FRESH_S)
        is_ours = was_source and integrator is not None and self._counts[1] == self._motion.stop_count
        try:
            if is_ours and state is None:
                self._motion.stop(0.0)
            elif is_ours and integrator is not None and state is not None:
                before = integrator.arm
                integrator.step(JogRates(was_source), state, 0)
                if integrator.arm != before:
                    self._motion.follow(integrator.arm, 0.0, HOLDER, *self._counts)
        except Refused:
            pass  # the e-stop holds the arm, or it is limp
        finally:
            if was_source:
                self._motion.release(HOLDER)

    def _end_if_silent(self, now_ns: int) -> None:
        if self._source and now_ns - self._heard_ns > SILENT_S * 1e9:
            self._end(f"nothing was heard of {self._source} for {SILENT_S:g} s; {RELEASE_FIRST}")

    def _require_permission(self) -> None:
        self._motion.require_released(since=self._counts[0])
        if self._motion.stop_count != self._counts[1]:
            raise Refused(f"the arm was stopped; {RELEASE_FIRST}")
        if self._motion.torque is False:
            raise Refused("the arm is limp; switch its torque on with /lupin/arm/set_torque")
        moving = self._integrator.moving if self._integrator is not None else ()
        self._were_blocked &= set(self._motion.blocked)
        blocked = [joint for joint in self._motion.blocked if joint in moving and joint not in self._were_blocked]
        if blocked:
            raise Refused(f"{', '.join(blocked)} does not follow; {RELEASE_FIRST}")

    def _fresh_state(self) -> ArmState:
        state = self._motion.state(fresh=True)
        if state is None:
            raise Refused("the arm's pose is unknown: no fresh /joint_states with all four arm joints")
        return state
