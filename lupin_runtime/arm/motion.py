"""One owner of the arm: everything that moves it goes through here, so that no two inputs command it at once.

Presets, single joints, stored poses and replays share one trajectory topic and one memory of what was commanded. A single
move replaces the single move before it, starting from where the arm is. A replay holds the arm for itself. A limp arm is
not commanded at all: what is sent to it then is what it jumps to when it stiffens.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from typing import NamedTuple

from lupin_runtime.arm.limits import Arm, clamp, clamp_arm
from lupin_runtime.arm.trajectory import SHORTEST_S, Point, timed, to_pose
from lupin_runtime.graph import ARM_CALIBRATE, ARM_JOINTS, ARM_LIBRARY_STOP

DEFAULT_RATE_RADPS = math.radians(60.0)
# What was commanded stands for where a joint is, unless feedback this fresh says otherwise by this much.
FRESH_S = 0.5
DRIFT_RAD = 0.08
CALIBRATING = "calibrating"  # a holder whose torque is nobody else's business
# A replay begins with getting to its first point, no faster than this.
LEAD_IN_RADPS = 0.8


class ArmState(NamedTuple):
    """What `/joint_states` last said; `gripper` is None where it did not speak of it. `heard_ns`: when it arrived."""

    arm: Arm
    gripper: float | None
    heard_ns: int


class Refused(RuntimeError):
    """The arm may not be moved now; the message says why and what to do."""


class ArmMotion:
    """The arm's only way to be moved. Thread-safe: nodes of one process share it.

    `feedback` returns the newest state of the arm or None, `send` publishes a trajectory, `clock_ns` is the clock of
    `ArmState.heard_ns`, `listeners` says how many hear what is sent.
    """

    def __init__(
        self,
        feedback: Callable[[], ArmState | None],
        send: Callable[[tuple[Point, ...]], None],
        clock_ns: Callable[[], int],
        listeners: Callable[[], int] = lambda: 1,
    ) -> None:
        self._feedback, self._send, self._clock_ns, self._listeners = feedback, send, clock_ns, listeners
        self._lock = threading.RLock()
        self._commanded: Arm | None = None
        self._holder: str | None = None
        self.torque: bool | None = None  # None: nobody has switched it yet, and the vendor starts stiff

    # -- reading ------------------------------------------------------------------------------------------------------
    def state(self, fresh: bool = False) -> ArmState | None:
        """The newest feedback; with `fresh` only one that is not older than FRESH_S."""
        state = self._feedback()
        if state is None or (fresh and not 0 <= self._clock_ns() - state.heard_ns <= FRESH_S * 1e9):
            return None
        return state

    @property
    def pinned(self) -> bool:
        """Whether it is known where the arm was sent."""
        return self._commanded is not None

    @property
    def holder(self) -> str | None:
        """Who holds the arm for itself; None while nobody does."""
        return self._holder

    # -- holding ------------------------------------------------------------------------------------------------------
    def hold(self, holder: str) -> None:
        """Take the arm for oneself. Raises Refused where another has it."""
        with self._lock:
            self._need_free(holder)
            self._holder = holder

    def let_go(self, holder: str) -> None:
        """Give the arm back; does nothing where it was not held by `holder`."""
        with self._lock:
            if self._holder == holder:
                self._holder = None

    # -- moving -------------------------------------------------------------------------------------------------------
    def pin(self) -> Arm:
        """Command the arm to stay where it is, however it came there. Raises Refused without fresh feedback."""
        with self._lock:
            self._need_listener()
            state = self.state(fresh=True)
            if state is None:
                raise Refused("no fresh /joint_states with all four arm joints: where the arm is, is not known")
            # Not clamped: an arm moved by hand may be outside its command window, and staying must not be a move.
            return self._go(to_pose(state.arm, SHORTEST_S))

    def stop(self, duration_s: float) -> None:
        """End what runs and stay where the arm is, if that is known."""
        with self._lock:
            state = self.state(fresh=True)
            if state is not None:
                self._go(to_pose(state.arm, duration_s))

    def move(self, arm: Sequence[float], duration_s: float, holder: str | None = None) -> Arm:
        """Send all four joints; returns where to, clamped. Raises Refused, or ValueError for a pose that is none."""
        target = clamp_arm(arm)
        with self._lock:
            self._permit(holder)
            return self._go(to_pose(target, duration_s))

    def move_joint(self, joint: str, angle_rad: float, rate_radps: float) -> Arm:
        """Send one joint at a rate (not positive: 60°/s); the others stay. Raises Refused, also before it is known
        where the arm is, or ValueError for an angle that is none."""
        angle_rad = clamp(joint, angle_rad)
        rate_radps = rate_radps if math.isfinite(rate_radps) and rate_radps > 0.0 else DEFAULT_RATE_RADPS
        with self._lock:
            self._permit(None)
            if self._commanded is None:
                raise Refused("the arm has not been pinned yet: no /joint_states with all four arm joints so far")
            arm = list(self._where())
            index = ARM_JOINTS.index(joint)
            duration_s = abs(angle_rad - arm[index]) / rate_radps
            arm[index] = angle_rad
            return self._go(to_pose(clamp_arm(arm), duration_s))

    def play(self, points: Sequence[Point], speed: float, holder: str) -> tuple[Point, ...]:
        """Replay a motion; returns it as sent, led in from where the arm is. Raises Refused or ValueError."""
        clamped = [Point(point.t_s, clamp_arm(point.arm)) for point in points]
        with self._lock:
            self._permit(holder)
            state = self.state(fresh=True)
            way_rad = 0.0
            if state is not None and clamped:
                way_rad = max(abs(a - b) for a, b in zip(state.arm, clamped[0].arm))
            path = timed(clamped, speed, lead_in_s=max(SHORTEST_S, way_rad / LEAD_IN_RADPS))
            self._go(path)
            return path

    # -- inside -------------------------------------------------------------------------------------------------------
    def _need_listener(self) -> None:
        # A trajectory that nobody hears is not kept for later, and would be taken for what the arm was sent.
        if self._listeners() == 0:
            raise Refused("no arm controller listens: bring it up with python -m lupin_runtime.arm.auto_home")

    def _permit(self, holder: str | None) -> None:
        self._need_listener()
        self._need_free(holder)
        if self.torque is False:
            raise Refused("the arm is limp: switch its torque on with /lupin/arm/set_torque")

    def _need_free(self, holder: str | None) -> None:
        if self._holder not in (None, holder):
            service = ARM_CALIBRATE.name if self._holder == CALIBRATING else ARM_LIBRARY_STOP.name
            raise Refused(f"the arm is taken: {self._holder}; end that with {service}")

    def _where(self) -> Arm:
        """Per joint, what was commanded, or feedback where that differs: the arm was moved by somebody else, or is still
        on its way, and a joint that is not asked to move stays where it is."""
        commanded = self._commanded
        assert commanded is not None
        state = self.state(fresh=True)
        if state is None:
            return commanded
        pan, lift, elbow, wrist = (
            is_at if abs(is_at - sent_to) > DRIFT_RAD else sent_to for is_at, sent_to in zip(state.arm, commanded)
        )
        return pan, lift, elbow, wrist

    def _go(self, path: tuple[Point, ...]) -> Arm:
        self._send(path)
        self._commanded = path[-1].arm
        return self._commanded
