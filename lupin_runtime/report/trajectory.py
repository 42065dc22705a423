"""The path as the robot knew it while it drove: the transforms of the recording, joined at the time they were heard."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2, wrap_angle
from lupin_runtime.slam.tum import write_tum

SAMPLE_PERIOD_S = 0.1
# Smaller changes of map -> odom are the everyday business of scan matching.
CORRECTION_M = 0.02
CORRECTION_RAD = math.radians(1.0)
# Steps below this are the noise of a standing robot.
_STANDING_M = 0.005

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Correction:
    """A step of map -> odom: how far it moved the robot on the map, without the robot moving."""

    t_s: float
    distance_m: float
    turn_rad: float


@dataclass(frozen=True)
class Trajectory:
    """Poses of the base in the map frame, oldest first. `t_s` counts from the start of the recording.

    `stamps_s` are the transforms' own stamps; `length_m` is what the wheels drove, free of the map's corrections. `frame`
    is `odom` where nobody published a map.
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
        """The pose at a time of the recording, by the nearest sample within half a second."""
        if not len(self):
            return None
        index = int(np.clip(np.searchsorted(self.t_s, t_s), 0, len(self) - 1))
        if index and t_s - self.t_s[index - 1] < abs(self.t_s[index] - t_s):
            index -= 1
        if abs(self.t_s[index] - t_s) > 0.5:
            return None
        return Pose2(float(self.x[index]), float(self.y[index]), float(self.yaw[index]))


class TrajectoryBuilder:
    """Joins `map -> odom` and `odom -> base_link` as they come; a pose is what a node would have looked up at that time."""

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
        """A new correction of the odometry."""
        before, base = self._map_from_odom, self._odom_from_base
        self._map_from_odom = pose
        if before is None or base is None:
            return
        was, now = before @ base, pose @ base
        distance, turn = was.distance_to(now), abs(wrap_angle(now.yaw - was.yaw))
        if distance >= CORRECTION_M or turn >= CORRECTION_RAD:
            self._corrections.append(Correction(t_s, distance, turn))

    def odom_from_base(self, t_s: float, stamp_s: float, pose: Pose2) -> None:
        """A new pose of the odometry; kept ten times a second."""
        self._odom_from_base = pose
        # A clock that jumped back starts a new count: the old bound would swallow everything until it is reached again.
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
        """The whole path."""
        frame, rows = ("map", self._rows) if self._rows else ("odom", self._odom_rows)
        table = np.array(rows, dtype=np.float64).reshape(-1, 5)
        table = table[np.argsort(table[:, 0], kind="stable")]
        t_s, stamps_s, x, y, yaw = np.ascontiguousarray(table.T)
        return Trajectory(t_s, stamps_s, x, y, yaw, length_m=self._length_m, corrections=tuple(self._corrections), frame=frame)


def speeds(trajectory: Trajectory, window_s: float = 0.5) -> Floats:
    """Metres per second along the path at each sample, over a window that hides the noise of single poses."""
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
    """Write the poses as TUM text, which trajectory evaluators read."""
    poses = (Pose2(float(x), float(y), float(yaw)) for x, y, yaw in zip(trajectory.x, trajectory.y, trajectory.yaw))
    write_tum(path, (f"{stamp_s:.6f}" for stamp_s in trajectory.stamps_s), poses)
