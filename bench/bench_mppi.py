"""The CPU time of an MPPI cycle (2000 trajectories of 56 steps), compared with the same in numpy. Limit: 30 Hz on one core."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import numpy as np

from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import BeamPoses, LocalCostmap, RangeScan
from lupin_runtime.navigation.mppi import LocalPath, MppiController
from tests.support.numpy_mppi import iterate

LIMIT_HZ = 30.0
CYCLES, PEER_CYCLES = 200, 10


def aisle() -> LocalCostmap:
    """Return the local costmap of a 0.9 m wide aisle along x, seen by a lidar in its middle."""
    angles = 2.0 * np.pi * np.arange(360) / 360
    with np.errstate(divide="ignore"):
        ranges = np.minimum(0.45 / np.abs(np.sin(angles)), 20.0).astype(np.float32)
    costmap = LocalCostmap()
    costmap.roll_to(0.0, 0.0)
    costmap.observe(RangeScan(ranges, 0.0, 2.0 * np.pi / 360), BeamPoses(Pose2(), Pose2()))
    return costmap


def cpu_ms(work: Callable[[], object], count: int) -> list[float]:
    """Return this thread's CPU time for each of `count` runs, ms; wall time would include other processes."""
    times_ms = []
    for _ in range(count):
        began = time.thread_time()
        work()
        times_ms.append((time.thread_time() - began) * 1e3)
    return times_ms


def main() -> int:
    """Time the controller in an aisle, and its numpy reference; return 1 if the controller is slower than the limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON line instead of a table")
    as_json = parser.parse_args().json
    controller = MppiController()
    p = controller.parameters
    costmap = aisle().snapshot(Pose2())
    x = np.arange(0.0, p.prune_distance, 0.05)
    path = LocalPath(x, np.zeros_like(x), np.ones(len(x), bool), 0.05, 4.0)
    goal, velocity = Pose2(4.0, 0.0, 0.0), (0.4, 0.0, 0.0)
    began = time.perf_counter()
    ours = cpu_ms(lambda: controller.compute(Pose2(), velocity, path, goal, costmap), CYCLES)
    wall_ms = (time.perf_counter() - began) * 1e3 / CYCLES
    noise = np.random.default_rng(1).normal(size=(p.batch_size, p.time_steps, 3))
    controls = np.zeros((3, p.time_steps))
    peer = cpu_ms(lambda: iterate(p, controls, noise, velocity, Pose2(), path, goal, costmap), PEER_CYCLES)
    median_ms, peer_ms = float(np.median(ours)), float(np.median(peer))
    result = {
        "batch": p.batch_size,
        "steps": p.time_steps,
        "cycle_ms": round(median_ms, 3),
        "cycle_p99_ms": round(float(np.percentile(ours, 99)), 3),
        "cycle_wall_ms": round(wall_ms, 3),
        "rate_hz": round(1e3 / median_ms, 1),
        "limit_hz": LIMIT_HZ,
        "numpy_ms": round(peer_ms, 1),
        "times_faster_than_numpy": round(peer_ms / median_ms, 1),
    }
    if as_json:
        print(json.dumps(result))
    else:
        for name, value in result.items():
            print(f"{name:26} {value}")
    return 0 if result["rate_hz"] >= LIMIT_HZ else 1


if __name__ == "__main__":
    raise SystemExit(main())
