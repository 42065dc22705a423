"""Extracts the arm's state from a JointState."""

from __future__ import annotations

import math
from collections.abc import Sequence

from lupin_runtime.arm.motion import ArmState
from lupin_runtime.graph import ARM_JOINTS, GRIPPER_JOINT


def arm_state(names: Sequence[str], positions: Sequence[float], received_ns: int) -> ArmState | None:
    """Return the arm's state from a JointState's names and positions (rad); None if an arm joint is missing or not finite."""
    at = {name: float(position) for name, position in zip(names, positions) if math.isfinite(position)}
    if any(joint not in at for joint in ARM_JOINTS):
        return None
    pan, lift, elbow, wrist = (at[joint] for joint in ARM_JOINTS)
    return ArmState((pan, lift, elbow, wrist), at.get(GRIPPER_JOINT), received_ns)
