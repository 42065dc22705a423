"""Holds the arm in place of the process `body`, which sends all of Lupin's arm commands and holds the arm under the e-stop.

A preset or a replay is one trajectory, which the vendor's controller follows to its end even if `body` hangs or has exited.
"""

from __future__ import annotations

from collections.abc import Sequence

from lupin_runtime.arm.limits import Arm
from lupin_runtime.arm.motion import DRIFT_RAD

# `body` holds the arm within milliseconds of an e-stop; on a busy machine it gets this long.
ANSWER_S = 0.5


class BackupHold:
    """Decides which pose to command. Times are nanoseconds of one monotonic clock, poses are in rad.

    It acts while the supervisor says that `body` does not respond, and while the e-stop is engaged but nobody has held the arm
    within ANSWER_S. It sends the arm's present pose once; while the e-stop is engaged, it sends the same pose again whenever
    the arm has left it or another trajectory was published, and once more with the release. As soon as `body` holds the arm, it
    sends nothing more, so that the two do not replace each other's commands.
    """

    def __init__(self) -> None:
        self._engaged_ns: int | None = None  # when the e-stop engaged; None while it is released
        self._answered = False  # whether somebody has held the arm since the e-stop engaged
        self._held: Arm | None = None
        self._resend = False

    def estop(self, engaged: bool, now_ns: int) -> None:
        """Handle a message of the e-stop's state."""
        if engaged == (self._engaged_ns is not None):
            return
        if engaged:
            self._engaged_ns, self._answered = now_ns, False
            self._held = None  # another trajectory may have moved the arm since
        else:
            self._engaged_ns = None
            self._resend = self._held is not None

    def trajectory(self, path: Sequence[tuple[float, ...]], pose: Arm | None) -> None:
        """Handle a trajectory of any publisher, and the arm's pose at that time."""
        if self._held is not None and list(path) == [self._held]:
            return  # its own
        reference = pose if pose is not None else self._held
        if len(path) == 1 and reference is not None and not _differ(path[0], reference):
            self._answered = True
        elif self._engaged_ns is not None:
            self._resend = True

    def is_needed(self, body_responds: bool, now_ns: int) -> bool:
        """Return whether `body` fails to hold the arm. `body_responds`: as far as the supervisor knows."""
        if not body_responds:
            return True
        unanswered = self._engaged_ns is not None and not self._answered
        return unanswered and now_ns - (self._engaged_ns or 0) > ANSWER_S * 1e9

    def tick(self, body_responds: bool, pose: Arm | None, now_ns: int) -> Arm | None:
        """Return the pose to command now, or None. `pose` is the arm's present pose if it is known."""
        released_hold = self._resend and self._engaged_ns is None
        if not (released_hold or self.is_needed(body_responds, now_ns)):
            self._held, self._resend = None, False
            return None
        if self._held is None:
            self._held, self._resend = pose, False
            return pose
        left = self._engaged_ns is not None and pose is not None and _differ(pose, self._held)
        if left or self._resend:
            self._resend = False
            return self._held
        return None


def _differ(one: Sequence[float], other: Arm) -> bool:
    return len(one) != len(other) or not all(abs(a - b) <= DRIFT_RAD for a, b in zip(one, other))
