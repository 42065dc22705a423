"""The replay that `bench_arm` measures, and how its timing is read from the pan's angle."""

from __future__ import annotations

import numpy as np
import pytest

from bench.arm_client import END_RAD, STEP_S, WAYPOINTS, lateness_ms, sequence


def test_replay_has_800_waypoints_that_a_recorder_could_make() -> None:
    waypoints = sequence().waypoints
    assert len(waypoints) == WAYPOINTS == 800
    assert waypoints[-1].t == pytest.approx(799 * STEP_S)
    assert (waypoints[0].arm[0], waypoints[-1].arm[0]) == pytest.approx((-END_RAD, END_RAD))


def test_lag_and_a_late_stretch_are_read_from_the_pan() -> None:
    points = np.array([(waypoint.t, waypoint.arm[0]) for waypoint in sequence().waypoints])
    times_s = np.arange(0.0, 42.0, 0.02)
    lag_s = np.where((times_s > 10.0) & (times_s < 12.0), 0.15, 0.10)
    pans = np.stack([times_s, np.interp(times_s - lag_s, points[:, 0], points[:, 1])], axis=1)
    late_ms = lateness_ms(pans, points)
    assert np.median(late_ms) == pytest.approx(100.0, abs=0.5)
    assert late_ms[220] == pytest.approx(150.0, abs=0.5)
