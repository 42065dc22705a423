"""Plane and quaternion geometry shared by the cores: radians, meters, REP-103 axes, quaternions as (x, y, z, w)."""

from __future__ import annotations

import math
from dataclasses import dataclass


def wrap_angle(angle_rad: float) -> float:
    """Return the same direction within [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def quaternion_from_yaw(yaw_rad: float) -> tuple[float, float, float, float]:
    """Return (x, y, z, w) of a rotation about +z."""
    return 0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0)


def yaw_from_quaternion(x: float, y: float, z: float, w: float) -> float:
    """Return the heading of the rotated x axis in the xy plane."""
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@dataclass(frozen=True)
class Pose2:
    """A pose, or a rigid motion, in the plane: meters and radians."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def __matmul__(self, other: Pose2) -> Pose2:
        """Compose two poses: `a_from_b @ b_from_c` is `a_from_c`."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2(
            self.x + c * other.x - s * other.y,
            self.y + s * other.x + c * other.y,
            wrap_angle(self.yaw + other.yaw),
        )

    def inverse(self) -> Pose2:
        """Return `b_from_a` for `a_from_b`."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2(-c * self.x - s * self.y, s * self.x - c * self.y, wrap_angle(-self.yaw))

    def apply(self, x: float, y: float) -> tuple[float, float]:
        """Transform a point from the child frame to the parent frame."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return self.x + c * x - s * y, self.y + s * x + c * y

    def distance_to(self, other: Pose2) -> float:
        """Return the distance between the two origins in meters."""
        return math.hypot(self.x - other.x, self.y - other.y)
