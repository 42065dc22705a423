"""Runs the mapper over a simulated log, scan by scan."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lupin_runtime.geometry import Pose2
from lupin_runtime.slam.mapper import Mapper, MapperSettings, ScanResult
from lupin_runtime.slam.scan import Beams
from tests.support.slam_worlds import Log

Ranges = NDArray[np.float64]
# From a scan's number, stamp (s), odometry pose and ranges (m) to the stamp, pose and ranges that the mapper receives instead.
CorruptScan = Callable[[int, float, Pose2, Ranges], tuple[float, Pose2, Ranges]]


def pose2(row: NDArray[np.float64]) -> Pose2:
    """Convert a row (3,) of x, y and yaw to a pose."""
    return Pose2(float(row[0]), float(row[1]), float(row[2]))


def beams_of(log: Log) -> Beams:
    """Return the directions of the beams of a log's scans."""
    return Beams(float(log.angles[0]), float(log.angles[1] - log.angles[0]), len(log.angles))


class MappingRun:
    """A mapper, and its results for the scans of a log that it has processed."""

    def __init__(self, log: Log, settings: MapperSettings | None = None) -> None:
        self.log = log
        self.mapper = Mapper(settings)
        self.results: list[ScanResult] = []

    def process(self, first: int, last: int, corrupt_scan: CorruptScan | None = None) -> MappingRun:
        """Process the scans [first, last) of the log, changed by `corrupt_scan` if it is given; return this object."""
        beams = beams_of(self.log)
        for k in range(first, last):
            stamp, odom, ranges = float(self.log.stamps[k]), pose2(self.log.odom[k]), self.log.ranges[k]
            if corrupt_scan is not None:
                stamp, odom, ranges = corrupt_scan(k, stamp, odom, ranges)
            self.results.append(self.mapper.process(stamp, odom, ranges, beams))
        return self

    def errors(self, first: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the position (m) and yaw (rad) errors of the results' poses from scan `first` on, relative to the start.

        The first processed scan must be the log's first one.
        """
        estimate = np.array([result.pose for result in self.results])
        start = pose2(self.log.truth[0]).inverse()
        truth = np.array([[p.x, p.y, p.yaw] for p in (start @ pose2(row) for row in self.log.truth[: len(estimate)])])
        error = (estimate - truth)[first:]
        return np.hypot(error[:, 0], error[:, 1]), (error[:, 2] + np.pi) % (2 * np.pi) - np.pi
