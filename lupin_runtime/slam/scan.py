"""A laser scan as points in the robot's frame, finite, with normals and uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.laser_scan import scan_geometry
from lupin_runtime.slam.kernels import scan_normals
from lupin_runtime.transforms import Transform

Array = NDArray[np.floating]

# Standard deviation of a range: floor and share. The floor also covers the errors of a two-dimensional map.
SIGMA_FLOOR_M, SIGMA_SHARE = 0.01, 0.004
MIN_POINTS = 15  # a scan with fewer is blind


@dataclass(frozen=True)
class ScanPoints:
    """Points of one scan in the robot's frame: `xy` and `normal` (n, 2), `sigma` (n,) m, and the position of the sensor."""

    xy: Array
    normal: Array
    sigma: Array
    sensor: tuple[float, float]

    def __len__(self) -> int:
        return len(self.xy)

    def thinned(self, cell_m: float) -> Array:
        """At most one point per cell, so that a near wall does not outvote the room."""
        keys = np.floor(self.xy / cell_m).astype(np.int64)
        _, first = np.unique(keys[:, 0] * 1_000_003 + keys[:, 1], return_index=True)
        return np.ascontiguousarray(self.xy[np.sort(first)])


@dataclass(frozen=True)
class Beams:
    """The geometry of a laser: angle of the first beam, angle between two, number of beams, pose of the sensor on the robot."""

    angle_min: float
    angle_step: float
    count: int
    mount: Pose2 = field(default_factory=Pose2)
    range_min_m: float = 0.25
    range_max_m: float = 12.0

    def __post_init__(self) -> None:
        if not (
            math.isfinite(self.angle_min) and math.isfinite(self.angle_step) and self.angle_step != 0.0 and self.count >= 2
        ):
            raise ValueError(
                f"{self.count} beams from {self.angle_min} rad every {self.angle_step} rad make no scan: "
                "expected at least 2 beams, and finite angles"
            )

    @property
    def field_of_view(self) -> float:
        """Radians that the beams cover."""
        return min(abs(self.angle_step) * self.count, 2.0 * math.pi)


def beams_of(scan: Any, base_from_laser: Transform, range_min_m: float, range_max_m: float) -> Beams:
    """Return the beams of a LaserScan within these limits. Raises ValueError for a tilted laser or invalid angles."""
    seen = scan_geometry(scan, base_from_laser)
    limits = max(range_min_m, seen.range_min_m), min(range_max_m, seen.range_max_m)
    return Beams(seen.angle_min_rad, seen.angle_step_rad, len(scan.ranges), seen.mount, *limits)


class ScanReader:
    """Turns ranges into ScanPoints; keeps the trigonometry of the last geometry."""

    def __init__(self) -> None:
        self._beams: Beams | None = None
        self._cos = self._sin = np.empty(0)

    def read(
        self, beams: Beams, ranges: Array, twist: tuple[float, float, float] | None = None, beam_s: float = 0.0
    ) -> ScanPoints:
        """Convert ranges within the laser's limits to points; NaN, inf and zeros are dropped.

        `twist` (m/s, m/s, rad/s in the robot's frame) and `beam_s` undo the motion during the scan, so that all points are
        in the robot's frame at the time of the first beam. Raises ValueError for another number of ranges.
        """
        if len(ranges) != beams.count:
            raise ValueError(f"expected {beams.count} ranges, found {len(ranges)}")
        if beams != self._beams:
            angles = beams.mount.yaw + beams.angle_min + beams.angle_step * np.arange(beams.count)
            self._beams, self._cos, self._sin = beams, np.cos(angles), np.sin(angles)
        with np.errstate(invalid="ignore"):
            good = np.flatnonzero((ranges >= beams.range_min_m) & (ranges <= beams.range_max_m))
        r = ranges[good]
        xy: Array = np.empty((len(good), 2))
        xy[:, 0] = beams.mount.x + r * self._cos[good]
        xy[:, 1] = beams.mount.y + r * self._sin[good]
        if twist is not None and beam_s > 0.0:
            xy = _compensate_motion(xy, twist, beam_s * good)
        sensor = (beams.mount.x, beams.mount.y)
        return ScanPoints(xy, scan_normals(xy, sensor, abs(beams.angle_step)), np.hypot(SIGMA_FLOOR_M, SIGMA_SHARE * r), sensor)


def _compensate_motion(xy: Array, twist: tuple[float, float, float], after_s: NDArray[np.floating]) -> Array:
    """Transform points seen `after_s` (n,) later into the frame of the start, at constant velocity."""
    vx, vy, turn = twist
    yaw = turn * after_s
    c, s = np.cos(yaw), np.sin(yaw)
    result = np.empty_like(xy)
    result[:, 0] = vx * after_s + c * xy[:, 0] - s * xy[:, 1]
    result[:, 1] = vy * after_s + s * xy[:, 0] + c * xy[:, 1]
    return result
