"""Records a motion of the arm as waypoints, with minimum spacing and a maximum length."""

from __future__ import annotations

import math

from lupin_runtime.arm.library import StoredSequence, Waypoint, now_text
from lupin_runtime.arm.limits import Arm

MIN_GAP_S = 0.05
ROUNDING_S = 1e-6  # so that no sample is dropped from a stream whose period is exactly MIN_GAP_S
MIN_MOVE_RAD = math.radians(0.5)
MAX_WAYPOINTS = 800
MAX_DURATION_S = 60.0
# A smaller change of the gripper is not a gripper event.
GRIPPER_EVENT_RAD = 0.05

MODES = ("kinesthetic", "teleop")


class ArmRecorder:
    """Collects waypoints; call `offer` with every new state of the arm and its time in seconds, from any origin."""

    def __init__(self, mode: str, include_gripper: bool) -> None:
        self.mode, self.include_gripper = mode, include_gripper
        self.truncated = False
        self._start_s: float | None = None
        self._last_s = 0.0
        self._latest: Waypoint | None = None
        self._kept: list[Waypoint] = []

    def offer(self, time_s: float, arm: Arm, gripper: float | None) -> bool:
        """Handle a state; return whether it is kept: the first, and each that is 0.05 s and 0.5° from the last kept one."""
        if self._start_s is None:
            self._start_s = time_s
        t = time_s - self._start_s
        if t > MAX_DURATION_S:
            self.truncated = True
            return False
        self._latest = Waypoint(t, arm, gripper if self.include_gripper else None)
        if self._kept:
            last = self._kept[-1]
            moved = max(abs(a - b) for a, b in zip(arm, last.arm)) >= MIN_MOVE_RAD
            gripped = self.include_gripper and _changed(last.gripper, gripper)
            if t - last.t < MIN_GAP_S - ROUNDING_S or not (moved or gripped):
                return False
            if len(self._kept) >= MAX_WAYPOINTS:
                self.truncated = True
                return False
        self._kept.append(self._latest)
        return True

    @property
    def count(self) -> int:
        """The number of waypoints so far."""
        return len(self._kept)

    @property
    def duration_s(self) -> float:
        """Time from the first state to the latest."""
        return 0.0 if self._latest is None else self._latest.t

    def finish(self) -> StoredSequence | None:
        """Return the sequence, with a last point that holds the final pose; None if nothing was recorded."""
        if self._latest is None:
            return None
        waypoints = list(self._kept)
        if self._latest.t - waypoints[-1].t >= MIN_GAP_S and len(waypoints) < MAX_WAYPOINTS:
            waypoints.append(self._latest)
        return StoredSequence(self.mode, self.include_gripper, round(waypoints[-1].t, 3), tuple(waypoints), created=now_text())


def gripper_events(sequence: StoredSequence) -> tuple[tuple[float, float], ...]:
    """Return (t, rad) of each gripper command of a replay: the first sample, then each that differs from the last command."""
    events: list[tuple[float, float]] = []
    for waypoint in sequence.waypoints:
        if waypoint.gripper is None or not sequence.include_gripper:
            continue
        if not events or abs(waypoint.gripper - events[-1][1]) > GRIPPER_EVENT_RAD:
            events.append((waypoint.t, waypoint.gripper))
    return tuple(events)


def _changed(before: float | None, after: float | None) -> bool:
    if before is None or after is None:
        return before is not after
    return abs(after - before) > GRIPPER_EVENT_RAD
