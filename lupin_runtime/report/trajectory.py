"""The path as the robot knew it while driving: the recorded transforms, combined at the time they were received."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.slam.tum import write_tum

SAMPLE_PERIOD_S = 0.1
# Scan matching constantly changes map -> odom by less than this.
CORRECTION_M = 0.02
CORRECTION_RAD = math.radians(1.0)
# Steps below this are noise while the robot stands.
_STANDING_M = 0.005

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Correction:
    """A step of map -> odom: how far the robot's estimated position jumped."""

    t_s: float
    distance_m: float
    turn_rad: float


@dataclass(frozen=True)
class Trajectory:
    """Poses of the base in the map frame, oldest first. `t_s` counts from the start of the recording.

    `stamps_s` are the transforms' stamps; `length_m` is the odometry's length, without corrections by the map. `frame` is
    `odom` if no map was published.
    """

    t_s: Floats
    stamps_s: Floats
    x: Floats
    y: Floats
    yaw: Floats
    length_m: float = 0.0
    corrections: tuple[Correction, ...] = ()
    frame: str = "map"

    def __len__(self) -> int:
        return len(self.t_s)

    def at(self, t_s: float) -> Pose2 | None:
        """Return the nearest pose within half a second of a time; None if there is none."""
        if not len(self):
            return None
        index = int(np.clip(np.searchsorted(self.t_s, t_s), 0, len(self) - 1))
        if index and t_s - self.t_s[index - 1] < abs(self.t_s[index] - t_s):
            index -= 1
        if abs(self.t_s[index] - t_s) > 0.5:
            return None
        return Pose2(float(self.x[index]), float(self.y[index]), float(self.yaw[index]))


class TrajectoryBuilder:
    """Combines `map -> odom` and `odom -> base_link`; each pose is what a node would have looked up at that time."""

    def __init__(self) -> None:
        self._map_from_odom: Pose2 | None = None
        self._odom_from_base: Pose2 | None = None
        self._due_s = -math.inf
        self._measured_from: Pose2 | None = None
        self._length_m = 0.0
        self._rows: list[tuple[float, float, float, float, float]] = []
        self._odom_rows: list[tuple[float, float, float, float, float]] = []
        self._corrections: list[Correction] = []

    def map_from_odom(self, t_s: float, pose: Pose2) -> None:
        """Add a transform `map -> odom`."""
        before, base = self._map_from_odom, self._odom_from_base
        self._map_from_odom = pose
        if before is None or base is None:
            return
        old, new = before @ base, pose @ base
        distance, turn = old.distance_to(new), abs(wrap_angle(new.yaw - old.yaw))
        if distance >= CORRECTION_M or turn >= CORRECTION_RAD:
            self._corrections.append(Correction(t_s, distance, turn))

    def odom_from_base(self, t_s: float, stamp_s: float, pose: Pose2) -> None:
        """Add a transform `odom -> base_link`; ten a second are kept."""
        self._odom_from_base = pose
        # After a clock jumped back, the old due time would discard everything until it is reached again.
        if self._due_s - SAMPLE_PERIOD_S <= stamp_s < self._due_s - 1e-6:
            return
        self._due_s = (math.floor(stamp_s / SAMPLE_PERIOD_S + 1e-6) + 1) * SAMPLE_PERIOD_S
        if self._measured_from is None or (step_m := pose.distance_to(self._measured_from)) >= _STANDING_M:
            self._length_m += 0.0 if self._measured_from is None else step_m
            self._measured_from = pose
        rows, base = self._odom_rows, pose
        if self._map_from_odom is not None:
            rows, base = self._rows, self._map_from_odom @ pose
        rows.append((t_s, stamp_s, base.x, base.y, base.yaw))

    def build(self) -> Trajectory:
        """Return the complete path."""
        frame, rows = ("map", self._rows) if self._rows else ("odom", self._odom_rows)
        table = np.array(rows, dtype=np.float64).reshape(-1, 5)
        table = table[np.argsort(table[:, 0], kind="stable")]
        t_s, stamps_s, x, y, yaw = np.ascontiguousarray(table.T)
        return Trajectory(t_s, stamps_s, x, y, yaw, length_m=self._length_m, corrections=tuple(self._corrections), frame=frame)


def speeds(trajectory: Trajectory, window_s: float = 0.5) -> Floats:
    """Return the speed in m/s at each sample, averaged over a window to suppress the noise of single poses."""
    if len(trajectory) < 2:
        return np.zeros(len(trajectory))
    steps = np.hypot(np.diff(trajectory.x, prepend=trajectory.x[0]), np.diff(trajectory.y, prepend=trajectory.y[0]))
    reach = max(1, round(window_s / SAMPLE_PERIOD_S / 2.0))
    along = np.cumsum(steps)
    low = np.clip(np.arange(len(along)) - reach, 0, None)
    high = np.clip(np.arange(len(along)) + reach, None, len(along) - 1)
    result: Floats = (along[high] - along[low]) / np.maximum(trajectory.t_s[high] - trajectory.t_s[low], 1e-3)
    return result


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write the poses in the TUM format, which trajectory evaluation tools read."""
    poses = (Pose2(float(x), float(y), float(yaw)) for x, y, yaw in zip(trajectory.x, trajectory.y, trajectory.yaw))
    write_tum(path, (f"{stamp_s:.6f}" for stamp_s in trajectory.stamps_s), poses)
