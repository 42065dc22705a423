"""Command limits of each joint, and the gripper's two scales.

The servo limit is what the vendor's firmware allows. The command window is narrower, and every command is clamped to it. Each
joint has its own window, because symmetric ±90° limits would drive two of the joints into their stops.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from lupin_runtime.graph import ARM_JOINTS

Arm = tuple[float, float, float, float]  # rad, in the order of ARM_JOINTS


class JointLimits(NamedTuple):
    """Limits in degrees. `servo_*` are the firmware's limits; `lower` and `upper` are the command window."""

    servo_lower: float
    servo_upper: float
    lower: float
    upper: float


LIMITS = {
    "shoulder_pan_joint": JointLimits(-86.0, 90.0, -86.0, 90.0),
    "shoulder_lift_joint": JointLimits(-86.2, 85.5, -86.0, 85.0),
    "elbow_joint": JointLimits(-116.3, 92.5, -90.0, 90.0),
    "wrist_joint": JointLimits(-110.7, 88.0, -90.0, 88.0),
    "gripper_joint": JointLimits(-43.6, 37.0, -30.0, 30.0),
}

# The console's gripper scale in degrees, and the joint's in rad: -30 degrees is open, +30 is closed. The window has not
# been verified on the robot.
GRIPPER_OPEN_DEG, GRIPPER_CLOSED_DEG = -30.0, 30.0
GRIPPER_OPEN_RAD, GRIPPER_CLOSED_RAD = -0.20, 0.25
GRIPPER_MAX_EFFORT = 2.0


def window(joint: str) -> tuple[float, float]:
    """Return the command window of a joint in rad; ±90° for an unknown joint."""
    limits = LIMITS.get(joint)
    if limits is None:
        return -math.pi / 2, math.pi / 2
    return math.radians(limits.lower), math.radians(limits.upper)


def clamp(joint: str, angle_rad: float) -> float:
    """Clamp `angle_rad` to the joint's window. Raises ValueError if it is not finite."""
    if not math.isfinite(angle_rad):
        raise ValueError(f"{joint}: expected a finite angle, found {angle_rad}")
    lower, upper = window(joint)
    return min(upper, max(lower, angle_rad))


def clamp_arm(angles_rad: Sequence[float]) -> Arm:
    """Clamp four angles to their windows. Raises ValueError unless there are four finite angles."""
    if len(angles_rad) != len(ARM_JOINTS):
        raise ValueError(f"expected {len(ARM_JOINTS)} angles ({', '.join(ARM_JOINTS)}), found {len(angles_rad)}")
    pan, lift, elbow, wrist = (clamp(joint, angle) for joint, angle in zip(ARM_JOINTS, angles_rad))
    return pan, lift, elbow, wrist


def gripper_rad(degrees: float) -> float:
    """Return the joint's angle for a value of the console's scale, clamped. Raises ValueError if it is not finite."""
    return _rescale(degrees, (GRIPPER_OPEN_DEG, GRIPPER_CLOSED_DEG), (GRIPPER_OPEN_RAD, GRIPPER_CLOSED_RAD))


def gripper_deg(angle_rad: float) -> float:
    """Return the value of the console's scale for a joint angle, clamped. Raises ValueError if it is not finite."""
    return _rescale(angle_rad, (GRIPPER_OPEN_RAD, GRIPPER_CLOSED_RAD), (GRIPPER_OPEN_DEG, GRIPPER_CLOSED_DEG))


def _rescale(value: float, source: tuple[float, float], target: tuple[float, float]) -> float:
    if not math.isfinite(value):
        raise ValueError(f"gripper: expected a finite value, found {value}")
    share = (value - source[0]) / (source[1] - source[0])
    return target[0] + min(1.0, max(0.0, share)) * (target[1] - target[0])
