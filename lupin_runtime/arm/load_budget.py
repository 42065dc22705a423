"""How long shoulder_lift has held the arm extended: its servo overheats when it holds against gravity.

The moment of gravity about the shoulder follows from the lengths of the links and the masses of the vendor's description. What
the servo bears for how long was not measured on a robot: LOADED and BUDGET_S are cautious choices.
"""

from __future__ import annotations

import math

from lupin_runtime.arm.limits import Arm

# From the shoulder's axis to the elbow's, to the wrist's, and from there to the middle of gripper and camera, m.
_UPPER_M, _FOREARM_M, _HAND_M = 0.1378, 0.14265, 0.07
# Of what is moved by elbow, wrist and gripper, kg: the servo at the end of each link, and the gripper.
_ELBOW_KG, _WRIST_KG, _HAND_KG = 0.0710, 0.0465, 0.0396
_HORIZONTAL = _UPPER_M * (_ELBOW_KG + _WRIST_KG + _HAND_KG) + _FOREARM_M * (_WRIST_KG + _HAND_KG) + _HAND_M * _HAND_KG

LOADED = 0.6  # share of the largest moment from which the arm counts as extended; the folded pose `tuck` has 0.58
BUDGET_S = 60.0
REMINDER_S = 60.0


def shoulder_load(arm: Arm) -> float:
    """Return the moment of gravity about shoulder_lift, 0..1: as a share of that of an arm stretched out horizontally.

    Zero of each joint is straight up; lift, elbow and wrist lean the same way (docs/motion.md).
    """
    _, lift, elbow, wrist = arm
    upper = _UPPER_M * math.sin(lift)
    forearm = upper + _FOREARM_M * math.sin(lift + elbow)
    hand = forearm + _HAND_M * math.sin(lift + elbow + wrist)
    return abs(_ELBOW_KG * upper + _WRIST_KG * forearm + _HAND_KG * hand) / _HORIZONTAL


class LoadBudget:
    """Counts the time of an extended arm; the same time at rest takes it back. Times are nanoseconds of one clock."""

    def __init__(self) -> None:
        self.held_s = 0.0  # extended, less what the servo had to cool since
        self.total_s = 0.0  # extended, in all
        self._last_ns: int | None = None
        self._due_s = BUDGET_S

    @property
    def is_spent(self) -> bool:
        """Whether the arm was extended for longer than the servo should bear."""
        return self.held_s >= BUDGET_S

    def step(self, arm: Arm | None, now_ns: int) -> bool:
        """Count the time since the last step with the arm's pose, None if it is limp; return whether to warn now.

        A warning is due when the budget is spent, and then every REMINDER_S.
        """
        since_s = 0.0 if self._last_ns is None else max(0.0, (now_ns - self._last_ns) / 1e9)
        self._last_ns = now_ns
        if arm is not None and shoulder_load(arm) >= LOADED:
            self.held_s += since_s
            self.total_s += since_s
        else:
            self.held_s = max(0.0, self.held_s - since_s)
        if not self.is_spent:
            self._due_s = BUDGET_S
        elif self.held_s >= self._due_s:
            self._due_s += REMINDER_S
            return True
        return False

    def sentence(self) -> str:
        """Return what is wrong, and what to do; the same text for a minute."""
        return (
            f"the arm is held extended: shoulder_lift has borne it for {self.held_s // 60.0:.0f} min and overheats;"
            " send it home: lupin home --when-idle"
        )
