"""SLAM on one core: 360 beams at 10 Hz in a greenhouse, with drifting odometry.

The default length shows whether the CPU time per scan grows. SLAM is compared with dead reckoning (odometry alone), and with a
bare pass over the readings in numpy (finite check and trigonometry), which is a lower bound for any method that reads them.
"""

from __future__ import annotations

import math
import sys
import time
from typing import Annotated

import numpy as np

from bench.runner import Figures, benchmark
from lupin_runtime.geometry import Pose2
from lupin_runtime.slam.mapper import Mapper
from lupin_runtime.slam.scan import Beams
from tests.support.slam_worlds import Log, aligned_errors, greenhouse_log

SCAN_S = 0.1


def bare_pass_ms(log: Log) -> float:
    """Return the CPU time per scan of reading each range once, ms."""
    began = time.process_time()
    for ranges in log.ranges:
        good = np.isfinite(ranges)
        np.stack((ranges[good] * np.cos(log.angles[good]), ranges[good] * np.sin(log.angles[good])), axis=1)
    return (time.process_time() - began) * 1e3 / len(log.ranges)


def map_log(log: Log) -> tuple[np.ndarray, np.ndarray, Mapper]:
    """Map a log, and render the map once a second as in the stack; return CPU ms (n,) and poses (n, 3), and the mapper."""
    mapper = Mapper()
    beams = Beams(float(log.angles[0]), float(log.angles[1] - log.angles[0]), len(log.angles))
    cpu_ms, poses = np.empty(len(log.stamps)), np.empty((len(log.stamps), 3))
    for k in range(len(log.stamps)):
        odom = Pose2(*(float(v) for v in log.odom[k]))
        began = time.process_time()
        poses[k] = mapper.process(float(log.stamps[k]), odom, log.ranges[k], beams).pose
        if k % 10 == 0:
            mapper.grid()
        cpu_ms[k] = (time.process_time() - began) * 1e3
    return cpu_ms, poses, mapper


@benchmark(at_most={"growth": 1.25, "rmse_m": 0.05, "yaw_rmse_deg": 0.5}, at_least={"times_real_time": 50.0})
def main(minutes: Annotated[float, "simulate a drive of this length"] = 60.0) -> Figures:
    """Map a simulated drive; return CPU times and errors."""
    log = greenhouse_log(minutes, seed=1)
    cpu_ms, poses, mapper = map_log(log)
    bare = bare_pass_ms(log)
    tenth = len(cpu_ms) // 10
    # The first tenth maps the greenhouse; after that, the CPU time must not grow.
    early, late = cpu_ms[tenth : 3 * tenth].mean(), cpu_ms[-2 * tenth :].mean()
    position_error, yaw_error = aligned_errors(poses, log.truth)
    odometry_error, _ = aligned_errors(log.odom, log.truth)
    rmse_m, odometry_rmse_m = (float(np.sqrt((error**2).mean())) for error in (position_error, odometry_error))
    return {
        "minutes": len(cpu_ms) * SCAN_S / 60.0,
        "scans": len(cpu_ms),
        "beams": len(log.angles),
        "cpu_ms_per_scan": float(cpu_ms.mean()),
        "cpu_ms_p99": float(np.quantile(cpu_ms, 0.99)),
        "cpu_ms_max": float(cpu_ms.max()),
        "cpu_ms_by_tenths": [float(cpu_ms[k * tenth : (k + 1) * tenth].mean()) for k in range(10)],
        "bare_pass_ms": bare,
        "ratio_to_bare_pass": float(cpu_ms.mean()) / bare,
        "times_real_time": SCAN_S * 1e3 / float(cpu_ms.mean()),
        "growth": float(late / early),
        "keyframes": len(mapper.graph),
        "rmse_m": rmse_m,
        "yaw_rmse_deg": math.degrees(float(np.sqrt((yaw_error**2).mean()))),
        "odometry_rmse_m": odometry_rmse_m,
        "ratio_to_odometry": rmse_m / odometry_rmse_m,
    }


if __name__ == "__main__":
    sys.exit(main())
