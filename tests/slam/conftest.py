"""Worlds with a known truth come from the benchmarks' folder; logs are driven once per test run."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from bench import slam_worlds
from lupin_runtime.geometry import Pose2
from lupin_runtime.slam.mapper import Mapper, MapperSettings, Step
from lupin_runtime.slam.scan import Beams


def pose2(row: np.ndarray) -> Pose2:
    """A row (3,) as a pose."""
    return Pose2(float(row[0]), float(row[1]), float(row[2]))


def beams_of(log: slam_worlds.Log) -> Beams:
    """The laser of a log."""
    return Beams(float(log.angles[0]), float(log.angles[1] - log.angles[0]), len(log.angles))


class Drive:
    """A mapper fed with a log, scan by scan; `change` may corrupt what it is given."""

    def __init__(self, log: slam_worlds.Log, settings: MapperSettings | None = None) -> None:
        self.log = log
        self.mapper = Mapper(settings)
        self.steps: list[Step] = []

    def go(self, first: int, last: int, change=None) -> Drive:
        """Feed the scans [first, last)."""
        beams = beams_of(self.log)
        for k in range(first, last):
            stamp, odom, ranges = self.log.stamps[k], pose2(self.log.odom[k]), self.log.ranges[k]
            if change is not None:
                stamp, odom, ranges = change(k, stamp, odom, ranges)
            self.steps.append(self.mapper.process(stamp, odom, ranges, beams))
        return self

    def errors(self, first: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Position and yaw errors of the poses as they were given out, from the scan `first` on, the start as origin."""
        estimate = np.array([step.pose for step in self.steps])
        start = pose2(self.log.truth[0]).inverse()
        truth = np.array([[p.x, p.y, p.yaw] for p in (start @ pose2(row) for row in self.log.truth[: len(estimate)])])
        gap = (estimate - truth)[first:]
        return np.hypot(gap[:, 0], gap[:, 1]), (gap[:, 2] + np.pi) % (2 * np.pi) - np.pi


@pytest.fixture(scope="session")
def worlds():
    return slam_worlds


@pytest.fixture(scope="session")
def greenhouse_log():
    """Two minutes in the greenhouse: an outer loop and half an inner one."""
    return slam_worlds.greenhouse_log(2.0, seed=3)


@pytest.fixture(scope="session")
def mapped(greenhouse_log):
    """That log, mapped: shared by tests that only look."""
    return Drive(greenhouse_log).go(0, len(greenhouse_log.stamps))


@pytest.fixture
def drive():
    return Drive
