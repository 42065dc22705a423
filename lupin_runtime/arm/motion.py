"""The single path of every arm command, so that no two sources command the arm at the same time.

Presets, single joints, stored poses and replays share one trajectory topic and one record of the last command. A move replaces
the move before it, starting from the arm's present pose. A replay reserves the arm. A limp arm is not commanded, because it
would jump to the last command when its torque is switched on. An engaged e-stop holds the arm where it is; its release resumes
nothing. Until the e-stop's state is known, the arm is not moved.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

from lupin_runtime.arm.limits import Arm, clamp, clamp_arm
from lupin_runtime.arm.trajectory import MIN_DURATION_S, Point, retime, to_pose
from lupin_runtime.graph import ARM_CALIBRATE, ARM_JOINTS, ARM_LIBRARY_STOP
from lupin_runtime.safety.estop_monitor import DRAIN_S, ESTOP_ENGAGED, ESTOP_NOT_RECEIVED

DEFAULT_RATE_RADPS = math.radians(60.0)
# A joint is assumed to be at its last command, unless feedback of at most this age differs by more than this angle.
FRESH_S = 0.5
# To hold the arm, feedback must be newer: a moving arm would jump back to a pose of half a second ago. A stop waits for such
# feedback for HOLD_WAIT_S; then what there is must do.
HOLD_FRESH_S = 0.1
HOLD_WAIT_S = 0.2
DRIFT_RAD = 0.08
RESERVED = "the arm is reserved"  # by which the refusals begin that say so
CALIBRATING = "calibrating"  # the holder during which only the calibration switches the torque
# The largest speed of the move to the first point of a replay.
LEAD_IN_RADPS = 0.8


class ArmState(NamedTuple):
    """The last state from `/joint_states`, in rad; `gripper` is None if it was missing. It arrived at `received_ns`."""

    arm: Arm
    gripper: float | None
    received_ns: int


class Refused(RuntimeError):
    """The arm may not be moved now; the message gives the reason and the action."""


class ArmMotion:
    """Commands the arm. It is thread-safe, because the nodes of a process share it.

    `feedback` returns the newest state of the arm or None, `send` publishes a trajectory, `clock_ns` is the clock of
    `ArmState.received_ns`, `listeners` returns the number of subscribers of the trajectory topic, and `real_ns` is real time,
    which the e-stop follows.
    """

    def __init__(
        self,
        feedback: Callable[[], ArmState | None],
        send: Callable[[tuple[Point, ...]], None],
        clock_ns: Callable[[], int],
        listeners: Callable[[], int] = lambda: 1,
        real_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._feedback, self._send, self._clock_ns, self._listeners = feedback, send, clock_ns, listeners
        self._real_ns = real_ns
        self._lock = threading.RLock()
        self._commanded: Arm | None = None
        self._ends_ns = 0  # when the last trajectory ends
        self._holder: str | None = None
        self._estop_known = self._estop_engaged = False
        self._released_ns: int | None = None
        self._hold_due = False
        self._hold_due_ns = self._hold_from_ns = 0  # since when, and from when on the feedback is to be
        self.estop_count = 0  # how often the e-stop was engaged
        self.stop_count = 0  # how often the arm was stopped or pinned
        self.blocked: tuple[str, ...] = ()  # joints that do not follow their commands, as far as `arm_monitor` knows
        self.jogged_by = self.jog_refusal = ""  # the source that jogs the arm, and why another one does not, for the status
        self.torque: bool | None = None  # None: not switched yet; the vendor starts with torque on

    # -- reading ------------------------------------------------------------------------------------------------------
    def state(self, fresh: bool = False, max_age_s: float = FRESH_S) -> ArmState | None:
        """Return the newest feedback; with `fresh`, None if it is older than `max_age_s`."""
        state = self._feedback()
        if state is None or (fresh and not 0 <= self._clock_ns() - state.received_ns <= max_age_s * 1e9):
            return None
        return state

    @property
    def pinned(self) -> bool:
        """Whether a command has been sent, so that the arm's target is known."""
        return self._commanded is not None

    @property
    def holder(self) -> str | None:
        """The activity that has reserved the arm, or None."""
        return self._holder

    # -- holding ------------------------------------------------------------------------------------------------------
    def hold(self, holder: str) -> None:
        """Reserve the arm for `holder`. Raises Refused if another activity has reserved it."""
        with self._lock:
            self._require_free(holder)
            self._holder = holder

    def release(self, holder: str) -> None:
        """Release the arm; do nothing if `holder` has not reserved it."""
        with self._lock:
            if self._holder == holder:
                self._holder = None

    # -- e-stop -------------------------------------------------------------------------------------------------------
    def set_estop(self, engaged: bool) -> None:
        """Handle a message of the e-stop state.

        The arm is held when the e-stop engages or, if its pose is unknown then, with the first message after the pose is known.
        The held pose is sent again if the arm has left it, and with the release. So no earlier trajectory, which `counter` may
        have missed or received in another order than the controller, continues after the release.
        """
        with self._lock:
            self._estop_known = True
            was_engaged, self._estop_engaged = self._estop_engaged, engaged
            is_press = engaged and not was_engaged
            if is_press:
                self.estop_count += 1
                self._hold_due = False
                if self.torque is not False:
                    self._hold_soon()
            elif was_engaged and (not engaged or self._has_left_held_pose()):
                self._send_held_pose()
            if was_engaged and not engaged:
                self._released_ns = self._real_ns()
            self.hold_if_due()

    def hold_if_due(self) -> None:
        """Hold the present pose if a stop waits for feedback; call it a few times per second."""
        with self._lock:
            state, waited_s = self.state(fresh=True, max_age_s=HOLD_FRESH_S), (self._clock_ns() - self._hold_due_ns) / 1e9
            is_of_now = state is not None and state.received_ns > self._hold_from_ns
            if self._hold_due and self.torque is not False and (is_of_now or not 0 <= waited_s < HOLD_WAIT_S):
                with suppress(Refused):
                    self.pin(FRESH_S)

    def _hold_soon(self, max_age_s: float = HOLD_FRESH_S) -> None:
        """Hold the arm as soon as there is feedback of now, which is less than `max_age_s` older than this call."""
        now_ns = self._clock_ns()
        self._hold_due_ns = self._hold_due_ns if self._hold_due else now_ns
        self._hold_due, self._hold_from_ns = True, now_ns - int(max_age_s * 1e9)

    def stop_soon(self) -> None:
        """Stop as `stop` does, but with later feedback: what there is may have waited while this process was held up."""
        with self._lock:
            self.stop_count += 1
            self._hold_soon(max_age_s=0.0)

    def counter(self, path: Sequence[tuple[float, ...]]) -> None:
        """Replace another publisher's trajectory by the held pose while the e-stop is engaged. `path` are its points."""
        with self._lock:
            if self._estop_engaged and list(path) != [self._commanded]:
                self._send_held_pose()

    def _send_held_pose(self) -> None:
        # The held pose, not the present one, which if repeated would let the arm sink under its weight.
        if self._commanded is not None and not self._hold_due and self.torque is not False:
            self._send_path(to_pose(self._commanded, MIN_DURATION_S))

    def _has_left_held_pose(self) -> bool:
        state = self.state(fresh=True)
        held = self._commanded
        if state is None or held is None:
            return False
        return max(abs(is_at - held_at) for is_at, held_at in zip(state.arm, held)) > DRIFT_RAD

    def require_released(self, since: int | None = None) -> None:
        """Raise Refused before the e-stop's first message, while it is engaged and for DRAIN_S after that, or if `estop_count`
        is no longer `since`.
        """
        if not self._estop_known:
            raise Refused(f"{ESTOP_NOT_RECEIVED}: the arm is not moved; repeat the command, or see lupin status")
        released_ns = self._released_ns
        drains = released_ns is not None and self._real_ns() - released_ns < DRAIN_S * 1e9
        if self._estop_engaged or drains or since not in (None, self.estop_count):
            raise Refused(f"{ESTOP_ENGAGED}: the arm is not moved; after its release, repeat the command")

    # -- moving -------------------------------------------------------------------------------------------------------
    def pin(self, max_age_s: float = HOLD_FRESH_S) -> Arm:
        """Command the arm to hold its present pose. Raises Refused without fresh feedback."""
        with self._lock:
            self._require_listener()
            state = self.state(fresh=True, max_age_s=max_age_s)
            if state is None:
                raise Refused("the arm's pose is unknown: no fresh /joint_states with all four arm joints")
            self.stop_count += 1
            # Not clamped: an arm that was moved by hand may be outside its command window, and holding must not move it.
            return self._send_path(to_pose(state.arm, MIN_DURATION_S))

    def stop(self, duration_s: float) -> None:
        """Replace the current motion by holding the present pose; if that is not known, as soon as it is."""
        with self._lock:
            self.stop_count += 1
            state = self.state(fresh=True, max_age_s=HOLD_FRESH_S)
            if state is not None:
                self._send_path(to_pose(state.arm, duration_s))
            else:
                self._hold_soon()

    def stop_unfinished(self) -> bool:
        """Hold the present pose if a trajectory has not ended yet, because this process exits; return whether it was sent.

        The controller would follow a replay to its end although no process is left that could stop it.
        """
        with self._lock:
            state = self.state(fresh=True)
            if self.torque is False or self._clock_ns() >= self._ends_ns or state is None:
                return False
            self.stop_count += 1
            self._send_path(to_pose(state.arm, MIN_DURATION_S))
            self._ends_ns = 0  # several nodes share the arm
            return True

    def move(self, arm: Sequence[float], duration_s: float, holder: str | None = None) -> Arm:
        """Move all four joints; return the clamped target. Raises Refused, or ValueError for an invalid pose."""
        target = clamp_arm(arm)
        with self._lock:
            self._require_permission(holder)
            return self._send_path(to_pose(target, duration_s))

    def move_joint(self, joint: str, angle_rad: float, rate_radps: float) -> Arm:
        """Move one joint at a rate; a rate that is not positive means 60°/s. The other joints stay.

        Raises Refused, also before the first command to the arm, and ValueError for an invalid angle.
        """
        angle_rad = clamp(joint, angle_rad)
        rate_radps = rate_radps if math.isfinite(rate_radps) and rate_radps > 0.0 else DEFAULT_RATE_RADPS
        with self._lock:
            self._require_permission(None)
            if self._commanded is None:
                raise Refused("the arm's pose is not known yet: no /joint_states with all four arm joints so far")
            arm = list(self._assumed_pose())
            index = ARM_JOINTS.index(joint)
            duration_s = abs(angle_rad - arm[index]) / rate_radps
            arm[index] = angle_rad
            return self._send_path(to_pose(clamp_arm(arm), duration_s))

    def held_pose(self, state: ArmState) -> Arm:
        """Return the pose in which the joints stay that a jog does not move, with the fresh feedback `state`."""
        with self._lock:
            return state.arm if self._commanded is None else self._assumed_pose()

    def follow(self, arm: Arm, duration_s: float, holder: str, estop_count: int, stop_count: int) -> Arm:
        """Move to the next pose of a stream, which is within the windows of the joints that it moves.

        Raises Refused, also if the e-stop was engaged or the arm stopped since the holder began, with these counts.
        """
        with self._lock:
            self._require_permission(holder)
            self.require_released(since=estop_count)
            if self.stop_count != stop_count:
                raise Refused("the arm was stopped")
            return self._send_path(to_pose(arm, duration_s))

    def play(self, points: Sequence[Point], speed: float, holder: str) -> tuple[Point, ...]:
        """Replay a motion after moving to its first point; return the path as sent. Raises Refused or ValueError."""
        clamped = [Point(point.t_s, clamp_arm(point.arm)) for point in points]
        with self._lock:
            self._require_permission(holder)
            state = self.state(fresh=True)
            distance_rad = 0.0
            if state is not None and clamped:
                distance_rad = max(abs(a - b) for a, b in zip(state.arm, clamped[0].arm))
            path = retime(clamped, speed, lead_in_s=max(MIN_DURATION_S, distance_rad / LEAD_IN_RADPS))
            self._send_path(path)
            return path

    # -- inside -------------------------------------------------------------------------------------------------------
    def _require_listener(self) -> None:
        # A trajectory without a subscriber is lost, and must not be recorded as the arm's last command.
        if self._listeners() == 0:
            raise Refused("no arm controller is subscribed; activate it with: lupin home")

    def _require_permission(self, holder: str | None) -> None:
        self.require_released()
        self._require_listener()
        self._require_free(holder)
        if self.torque is False:
            raise Refused("the arm is limp; switch its torque on with /lupin/arm/set_torque")

    def _require_free(self, holder: str | None) -> None:
        if self._holder not in (None, holder):
            service = ARM_CALIBRATE.name if self._holder == CALIBRATING else ARM_LIBRARY_STOP.name
            raise Refused(f"{RESERVED}: {self._holder}; stop that with {service}")

    def _assumed_pose(self) -> Arm:
        """Return the pose in which the joints stay that are not moved: each joint's last command, or feedback if it differs.

        Feedback differs if the arm was moved by hand or is still moving; a joint that is not to be moved stays there.
        """
        commanded = self._commanded
        assert commanded is not None
        state = self.state(fresh=True)
        if state is None:
            return commanded
        pan, lift, elbow, wrist = (
            is_at if abs(is_at - sent_to) > DRIFT_RAD else sent_to for is_at, sent_to in zip(state.arm, commanded)
        )
        return pan, lift, elbow, wrist

    def _send_path(self, path: tuple[Point, ...]) -> Arm:
        self._send(path)
        self._commanded = path[-1].arm
        self._ends_ns = self._clock_ns() + int(path[-1].t_s * 1e9)
        self._hold_due = False
        return self._commanded
