"""Finds joints that do not follow their trajectory: blocked, overloaded, or without a working controller."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from lupin_runtime.arm.limits import Arm
from lupin_runtime.arm.motion import DRIFT_RAD
from lupin_runtime.arm.trajectory import Point
from lupin_runtime.graph import ARM_JOINTS

# A joint that is further than DRIFT_RAD from where its trajectory has it, and moves less than PROGRESS_RAD in PATIENCE_S, is
# blocked. The vendor's servo gives up after 1 s, too; its dead band is 0.05 rad.
PATIENCE_S = 1.0
PROGRESS_RAD = 0.05
# A trajectory that arrives within this time after the end of the one before continues its motion.
CONTINUES_S = 0.5


class BlockedJoint(NamedTuple):
    """A joint that does not follow, and where it is and should be, in rad."""

    joint: str
    at_rad: float
    due_rad: float

    def sentence(self) -> str:
        """Return what is wrong, and what to do; the same text as long as it lasts."""
        name = self.joint.removesuffix("_joint")
        return f"the arm's {name} does not follow its commands; free it, or activate its controller: lupin home"

    def places(self) -> str:
        """Return where it is and should be."""
        return f"{self.at_rad:.2f} rad instead of {self.due_rad:.2f} rad"


class StallWatch:
    """Compares the newest trajectory with feedback. Times are nanoseconds of one clock, angles rad."""

    def __init__(self) -> None:
        self._path: tuple[Point, ...] = ()  # begins with the pose at its start
        self._began_ns = 0
        self._anchors: dict[str, tuple[float, int]] = {}  # joints that are late: where they were, and when

    def expect(self, path: Sequence[Point], at: Arm, now_ns: int) -> None:
        """Follow a new trajectory from now on; `at` is the arm's present pose. A path without points ends nothing."""
        if not path:
            return
        continues = bool(self._path) and self._elapsed_s(now_ns) < self._path[-1].t_s + CONTINUES_S
        start = self._due(now_ns) if continues else at
        self._path, self._began_ns = (Point(0.0, start), *path), now_ns

    def forget(self) -> None:
        """Expect nothing until the next trajectory: the arm is limp."""
        self._path = ()
        self._anchors.clear()

    def is_moving(self, now_ns: int) -> bool:
        """Return whether the newest trajectory has not ended."""
        return bool(self._path) and self._elapsed_s(now_ns) < self._path[-1].t_s

    def check(self, at: Arm, now_ns: int) -> tuple[BlockedJoint, ...]:
        """Return the joints that are blocked, with the arm at `at`; call it at least ten times a second."""
        if not self._path:
            return ()
        blocked = []
        for joint, at_rad, due_rad in zip(ARM_JOINTS, at, self._due(now_ns)):
            if abs(due_rad - at_rad) <= DRIFT_RAD:
                self._anchors.pop(joint, None)
                continue
            was_rad, since_ns = self._anchors.setdefault(joint, (at_rad, now_ns))
            if abs(at_rad - was_rad) >= PROGRESS_RAD:
                self._anchors[joint] = at_rad, now_ns
            elif now_ns - since_ns >= PATIENCE_S * 1e9:
                blocked.append(BlockedJoint(joint, at_rad, due_rad))
        return tuple(blocked)

    def _elapsed_s(self, now_ns: int) -> float:
        return max(0.0, (now_ns - self._began_ns) / 1e9)

    def _due(self, now_ns: int) -> Arm:
        elapsed_s = self._elapsed_s(now_ns)
        for before, after in zip(self._path, self._path[1:]):
            if elapsed_s < after.t_s:
                share = (elapsed_s - before.t_s) / max(1e-9, after.t_s - before.t_s)
                pan, lift, elbow, wrist = (a + share * (b - a) for a, b in zip(before.arm, after.arm))
                return pan, lift, elbow, wrist
        return self._path[-1].arm
