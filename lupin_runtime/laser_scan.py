"""A laser scan in the plane of the robot: the one projection for maps, localization, costmaps and reports."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from lupin_runtime.geometry import Pose2
from lupin_runtime.transforms import Transform

# A scan from 0.15 m height that is tilted by this ends at the floor at 2.9 m; its ranges are 0.1 % too long.
MAX_TILT_RAD = math.radians(3.0)


class TiltedLaser(ValueError):
    """A laser whose axis is not vertical: its scans do not show one level."""


@dataclass(frozen=True)
class ScanGeometry:
    """Beam i looks along `angle_min_rad + i * angle_step_rad`, counterclockwise from above, of `mount`, the laser's pose on the
    robot; a range is a distance from `range_min_m` to `range_max_m`."""

    angle_min_rad: float
    angle_step_rad: float
    range_min_m: float
    range_max_m: float
    mount: Pose2


def scan_geometry(scan: Any, base_from_laser: Transform) -> ScanGeometry:
    """Return the geometry of a sensor_msgs/LaserScan. Raises TiltedLaser.

    The beams of a laser that hangs upside down go round clockwise, seen from above: their angles count the other way. Drivers
    write 0 or infinity, and REP 117 allows both, where a lidar states no limit.
    """
    x, y, z, w = base_from_laser.rotation
    norm = x * x + y * y + z * z + w * w
    up = 1.0 - 2.0 * (x * x + y * y) / norm if norm > 0.0 else 1.0  # the z component of the laser's axis
    if abs(up) < math.cos(MAX_TILT_RAD):
        tilt = math.degrees(math.acos(min(1.0, abs(up))))
        raise TiltedLaser(
            f"the laser {scan.header.frame_id!r} is tilted by {tilt:.0f} degrees, so that its scans do not show one level: "
            "mount it level, upright or upside down, or correct its transform"
        )
    turn = math.copysign(1.0, up)
    return ScanGeometry(
        turn * float(scan.angle_min),
        turn * float(scan.angle_increment),
        *range_limits(scan),
        base_from_laser.to_pose2(),
    )


def range_limits(scan: Any) -> tuple[float, float]:
    """Return the least and the greatest range of a scan, 0 and infinity where it states none."""
    low, high = float(scan.range_min), float(scan.range_max)
    return low if low > 0.0 else 0.0, high if high > 0.0 else math.inf
