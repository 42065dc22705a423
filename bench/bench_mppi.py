"""The CPU time of an MPPI cycle (2000 trajectories of 56 steps), compared with the same in numpy."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from bench.runner import Figures, benchmark
from lupin_runtime.geometry import Pose2
from lupin_runtime.navigation.costmap import BeamPoses, LocalCostmap, RangeScan
from lupin_runtime.navigation.mppi import LocalPath, MppiController
from tests.support.numpy_mppi import iterate

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


@benchmark(at_least={"rate_hz": 30.0})
def main() -> Figures:
    """Time the controller in an aisle on one core, and its numpy reference."""
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
    return {
        "batch": p.batch_size,
        "steps": p.time_steps,
        "cycle_ms": median_ms,
        "cycle_p99_ms": float(np.percentile(ours, 99)),
        "cycle_wall_ms": wall_ms,
        "rate_hz": 1e3 / median_ms,
        "numpy_ms": peer_ms,
        "times_faster_than_numpy": peer_ms / median_ms,
    }


if __name__ == "__main__":
    sys.exit(main())
