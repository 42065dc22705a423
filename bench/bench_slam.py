"""SLAM on one core: 360 beams at 10 Hz in a greenhouse, with drifting odometry.

Limits: 50 times as fast as real time, CPU time per scan that grows by at most a quarter over an hour, RMSE of 5 cm and 0.5
degrees. It is compared with dead reckoning (odometry alone), and with a bare pass over the readings in numpy (finite check and
trigonometry), which is a lower bound for any method that reads them.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.slam.mapper import Mapper
from lupin_runtime.slam.scan import Beams
from tests.support.slam_worlds import Log, aligned_errors, greenhouse_log

LIMIT_REAL_TIME, LIMIT_GROWTH, LIMIT_RMSE_M, LIMIT_YAW_DEG = 50.0, 1.25, 0.05, 0.5
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


def main() -> int:
    """Map a simulated drive, and print CPU time and errors; return 1 if a limit is exceeded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0, help="simulate a drive of this length")
    parser.add_argument("--json", action="store_true", help="print only the JSON line")
    options = parser.parse_args()
    log = greenhouse_log(options.minutes, seed=1)
    cpu_ms, poses, mapper = map_log(log)
    bare = bare_pass_ms(log)
    tenth = len(cpu_ms) // 10
    # The first tenth maps the greenhouse; after that, the CPU time must not grow.
    early, late = cpu_ms[tenth : 3 * tenth].mean(), cpu_ms[-2 * tenth :].mean()
    position_error, yaw_error = aligned_errors(poses, log.truth)
    odometry_error, _ = aligned_errors(log.odom, log.truth)
    result = {
        "minutes": round(len(cpu_ms) * SCAN_S / 60.0, 1),
        "scans": len(cpu_ms),
        "cpu_ms_per_scan": round(float(cpu_ms.mean()), 3),
        "cpu_ms_p99": round(float(np.quantile(cpu_ms, 0.99)), 2),
        "cpu_ms_max": round(float(cpu_ms.max()), 1),
        "bare_pass_ms": round(bare, 4),
        "ratio_to_bare_pass": round(float(cpu_ms.mean()) / bare, 1),
        "times_real_time": round(SCAN_S * 1e3 / float(cpu_ms.mean()), 1),
        "limit_times_real_time": LIMIT_REAL_TIME,
        "ratio_to_limit": round(SCAN_S * 1e3 / float(cpu_ms.mean()) / LIMIT_REAL_TIME, 2),
        "growth": round(float(late / early), 3),
        "limit_growth": LIMIT_GROWTH,
        "keyframes": len(mapper.graph),
        "rmse_m": round(float(np.sqrt((position_error**2).mean())), 4),
        "yaw_rmse_deg": round(math.degrees(float(np.sqrt((yaw_error**2).mean()))), 3),
        "odometry_rmse_m": round(float(np.sqrt((odometry_error**2).mean())), 3),
    }
    result["ok"] = bool(
        result["times_real_time"] >= LIMIT_REAL_TIME
        and result["growth"] <= LIMIT_GROWTH
        and result["rmse_m"] <= LIMIT_RMSE_M
        and result["yaw_rmse_deg"] <= LIMIT_YAW_DEG
    )
    if not options.json:
        print(f"{result['scans']} scans of {len(log.angles)} beams, {result['minutes']} min, {result['keyframes']} keyframes")
        print(
            f"CPU time per scan: {result['cpu_ms_per_scan']} ms (p99 {result['cpu_ms_p99']}, max {result['cpu_ms_max']}): "
            f"{result['times_real_time']} x real time, limit {LIMIT_REAL_TIME:.0f}, ratio {result['ratio_to_limit']}; "
            f"{result['ratio_to_bare_pass']} x a bare pass over the readings"
        )
        print(
            "CPU time per scan, by tenths:",
            " ".join(f"{cpu_ms[k * tenth : (k + 1) * tenth].mean():.2f}" for k in range(10)),
            "ms",
        )
        print(f"growth, last fifth compared with the second and third tenth: {result['growth']}, limit {LIMIT_GROWTH}")
        print(
            f"RMSE {result['rmse_m']} m, {result['yaw_rmse_deg']} deg; the odometry alone {result['odometry_rmse_m']} m, "
            f"ratio {result['rmse_m'] / result['odometry_rmse_m']:.4f}"
        )
    print(json.dumps(result))
    return 0 if result["ok"] else 1


if __name__ == "__main__":
    sys.exit(main())
