"""Quantities over the time of a run: localization error, real-time factor and clearance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lupin_runtime.report.run_log import ClockSample, RunLog, TimedPosition
from lupin_runtime.report.trajectory import Trajectory

MAX_POINTS = 1200
# Without a value for this long, a line is interrupted.
GAP_S = 3.0

_ERROR_PERIOD_S = 0.2
_MAX_TRUTH_GAP_S = 1.0
_RATE_WINDOW_S = 5.0
# ROS time of a simulation starts at 0; elsewhere it is the wall clock, and a recorder reads both within this.
_SAME_CLOCK_S = 3600.0

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class TimeSeries:
    """A quantity over time: `points` are (seconds of the recording, value). If there are none, `missing` says why."""

    points: Points = ()
    missing: str = ""

    @property
    def low(self) -> tuple[float, float] | None:
        """The time and the value of the lowest point."""
        return min(self.points, key=lambda point: point[1], default=None)

    @property
    def high(self) -> tuple[float, float] | None:
        """The time and the value of the highest point."""
        return max(self.points, key=lambda point: point[1], default=None)


@dataclass(frozen=True)
class RunSeries:
    """The computed quantities of a run."""

    localization_error_m: TimeSeries
    real_time_factor: TimeSeries
    clearance_m: TimeSeries


def run_series(log: RunLog, true_path: Sequence[TimedPosition]) -> RunSeries:
    """Compute the quantities of a run. `true_path` is the simulator's truth in the map frame; empty if it is unknown."""
    return RunSeries(localization_error(log.trajectory, true_path), real_time_factor(log.clocks), _clearance(log))


def localization_error(trajectory: Trajectory, true_path: Sequence[TimedPosition]) -> TimeSeries:
    """Return the distance between the estimated and the true position in meters, at most five a second."""
    if not len(trajectory):
        return TimeSeries(missing="the recording has no transforms of the robot")
    if trajectory.frame != "map":
        return TimeSeries(missing="the recording has no map, so the robot was not localized")
    if len(true_path) < 2:
        return TimeSeries(missing="there is no ground truth of this run; only the simulator writes one")
    truth = np.array(sorted(true_path), dtype=np.float64)
    stamps = trajectory.stamps_s
    after = np.clip(np.searchsorted(truth[:, 0], stamps), 1, len(truth) - 1)
    covered = (stamps >= truth[0, 0]) & (stamps <= truth[-1, 0])
    covered &= truth[after, 0] - truth[after - 1, 0] <= _MAX_TRUTH_GAP_S
    true_x, true_y = (np.interp(stamps, truth[:, 0], truth[:, axis]) for axis in (1, 2))
    errors = np.hypot(trajectory.x - true_x, trajectory.y - true_y)
    points = [(float(t), float(e)) for t, e in zip(trajectory.t_s[covered], errors[covered]) if math.isfinite(e)]
    if not points:
        return TimeSeries(missing="the ground truth does not cover the time of the recording")
    return TimeSeries(_at_most_every(points, _ERROR_PERIOD_S))


def real_time_factor(clocks: Sequence[ClockSample]) -> TimeSeries:
    """Return the simulated seconds per second of the wall clock, over windows of five seconds of the wall clock."""
    if not clocks:
        return TimeSeries(missing="the recording has no messages")
    if abs(clocks[0].ros_s - clocks[0].wall_s) < _SAME_CLOCK_S:
        return TimeSeries(missing="ROS time is the wall clock in this recording: nothing is simulated")
    points: list[tuple[float, float]] = []
    first = 0
    for sample in clocks:
        while sample.wall_s - clocks[first].wall_s > _RATE_WINDOW_S and clocks[first + 1].wall_s < sample.wall_s:
            first += 1
        elapsed_s, simulated_s = sample.wall_s - clocks[first].wall_s, sample.ros_s - clocks[first].ros_s
        if elapsed_s >= _RATE_WINDOW_S / 2.0 and simulated_s >= 0.0:
            points.append((sample.t_s, simulated_s / elapsed_s))
    return TimeSeries(points) if points else TimeSeries(missing="the recording is too short")


def _clearance(log: RunLog) -> TimeSeries:
    if log.clearance:
        return TimeSeries(log.clearance)
    if not log.scans:
        return TimeSeries(missing="the recording has no lidar scans")
    if log.base_from_laser is None:
        return TimeSeries(missing="the recording has no transform from base_link to laser")
    return TimeSeries(missing="no lidar scan has an echo")


def _at_most_every(points: Points, period_s: float) -> Points:
    kept: list[tuple[float, float]] = []
    for point in points:
        if not kept or point[0] - kept[-1][0] >= period_s - 1e-6:
            kept.append(point)
    return kept


def keep_extremes(points: Points, count: int = MAX_POINTS) -> Points:
    """Return at most about `count` points: the lowest and the highest of each of equally long stretches, so that peaks stay."""
    if len(points) <= count:
        return points
    stretch = math.ceil(2 * len(points) / count)
    kept: list[tuple[float, float]] = []
    for first in range(0, len(points), stretch):
        part = range(first, min(first + stretch, len(points)))
        low, high = min(part, key=lambda i: points[i][1]), max(part, key=lambda i: points[i][1])
        kept += [points[i] for i in sorted({low, high})]
    return kept
