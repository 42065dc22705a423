"""Navigation in closed loop: arenas of random boxes with aisles of 0.9 m, a kinematic robot with a lag, drifting odometry.

Passes if every goal is reached without a collision. The driven distance is compared with the straight lines to the goals.
"""

from __future__ import annotations

import math
import sys
import time
from typing import Annotated

import numpy as np

from bench.runner import Figures, benchmark
from lupin_runtime.geometry import Pose2
from tests.support.kinematic_base import HALF_LENGTH_M, HALF_WIDTH_M, Arena, Drive, random_arena

GOALS = 5


def footprint_clearance_m(arena: Arena, track: list[Pose2]) -> float:
    """Return the smallest distance along a track between the outline of the robot's footprint and a wall or box."""
    u = np.linspace(-1.0, 1.0, 9)
    sides = [(HALF_LENGTH_M * s, HALF_WIDTH_M * t) for s in (-1, 1) for t in u]
    outline = np.array(sides + [(HALF_LENGTH_M * t, HALF_WIDTH_M * s) for s in (-1, 1) for t in u])
    poses = np.array([(p.x, p.y, p.yaw) for p in track])
    c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x = poses[:, 0, None] + c * outline[:, 0] - s * outline[:, 1]
    y = poses[:, 1, None] + s * outline[:, 0] + c * outline[:, 1]
    smallest = math.inf
    for x0, y0, x1, y1 in arena.solids():
        dx, dy = np.maximum(np.maximum(x0 - x, x - x1), 0.0), np.maximum(np.maximum(y0 - y, y - y1), 0.0)
        smallest = min(smallest, float(np.hypot(dx, dy).min()))
    return smallest


@benchmark(at_most={"collisions": 0, "not_reached": 0})
def main(worlds: Annotated[int, "drive in this many arenas"] = 20) -> Figures:
    """Drive to random goals in every arena."""
    began = time.process_time()
    collisions = reached = sent = log_lines = 0
    driven_m = simulated_s = straight_m = 0.0
    errors, clearances = [], []
    for seed in range(worlds):
        arena = random_arena(seed)
        drive = Drive(arena, Pose2(0.45, 0.45, 0.0), drift=0.02, seed=seed)
        costmap, random = drive.world.snapshot(None), np.random.default_rng(seed)
        for _ in range(GOALS):
            while True:
                goal = Pose2(*random.uniform((0.3, 0.3, -3.1), (arena.width_m - 0.3, arena.height_m - 0.3, 3.1)))
                if costmap.distance_at(goal.x, goal.y) > 0.3:
                    break
            sent += 1
            straight_m += drive.base.truth.distance_to(goal)
            if drive.go(goal, limit_s=180.0).failure is None:
                reached += 1
                errors.append(drive.error_to(goal))
        collisions += drive.collisions
        log_lines += len(drive.logs)
        driven_m += drive.driven_m()
        simulated_s += drive.now_s
        clearances.append(footprint_clearance_m(arena, drive.track))
    median = np.median(errors, axis=0)
    return {
        "arenas": worlds,
        "goals": sent,
        "reached": reached,
        "not_reached": sent - reached,
        "collisions": collisions,
        "smallest_clearance_m": min(clearances),
        "log_lines": log_lines,
        "driven_m": driven_m,
        "mean_speed_m_s": driven_m / simulated_s,
        "driven_over_straight": driven_m / straight_m,
        "error_median_m": float(median[0]),
        "error_median_rad": float(median[1]),
        "error_worst_m": max(e[0] for e in errors),
        "cpu_s_per_simulated_s": (time.process_time() - began) / simulated_s,
    }


if __name__ == "__main__":
    sys.exit(main())
