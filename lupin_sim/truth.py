"""Writes the ground truth of a run to files, for scoring. It is never published on the graph, where the robot could read it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lupin_runtime.atomic_file import write_atomically
from lupin_runtime.geometry import Pose2, quaternion_from_yaw
from lupin_sim.engine import Simulation
from lupin_sim.reachability import reachable_tags
from lupin_sim.world import Box, World

TRUTH_FILE = "truth.json"
TRAJECTORY_FILE = "truth_trajectory.tum"
STATE_FILE = "sim_state.json"
_TRAJECTORY_TICKS = 10
_STATE_PERIOD_S = 1.0


def _pose(pose: Pose2) -> dict[str, float]:
    return {"x": pose.x, "y": pose.y, "yaw": pose.yaw}


def _box(box: Box) -> dict[str, Any]:
    return {
        "id": box.name,
        "kind": box.kind,
        "x": box.x,
        "y": box.y,
        "yaw": box.yaw,
        "width": box.width,
        "depth": box.depth,
        "height": box.height,
    }


def truth(world: World) -> dict[str, Any]:
    """Return the world as JSON values: meters and radians in the world frame.

    Keys: `world`, `seed`, `start` {x, y, yaw}, `bounds` [x0, y0, x1, y1], `tags` [{id, x, y, z, yaw_normal, reachable, box,
    flowers [{species, bug, x, y, z}]}], `boxes` and `walls` [{id, kind, x, y, yaw, width, depth, height}; yaw is the front's
    outward normal, depth is along it], `pillars` [{id, x, y, radius, height}].
    """
    reachable = reachable_tags(world)
    return {
        "world": world.name,
        "seed": world.seed,
        "start": _pose(world.start),
        "bounds": list(world.bounds),
        "tags": [
            {
                "id": tag.id,
                "x": tag.x,
                "y": tag.y,
                "z": tag.z,
                "yaw_normal": tag.yaw,
                "reachable": tag.id in reachable,
                "box": tag.box,
                "flowers": [
                    {"species": f.species, "bug": f.bug, "x": f.x, "y": f.y, "z": f.z}
                    for f in world.flowers
                    if f.tag_id == tag.id
                ],
            }
            for tag in world.tags
        ],
        "boxes": [_box(box) for box in world.boxes],
        "walls": [_box(wall) for wall in world.walls],
        "pillars": [{"id": p.name, "x": p.x, "y": p.y, "radius": p.radius, "height": p.height} for p in world.pillars],
    }


class TruthRecorder:
    """Writes truth.json at once, then the true trajectory (TUM, 10 Hz, world frame) and sim_state.json (about 1 Hz).

    `stamp_s` returns the trajectory's stamps, which are on the clock of the robot's messages; by default simulated time.
    """

    def __init__(self, simulation: Simulation, directory: Path, stamp_s: Callable[[], float] | None = None) -> None:
        self._simulation, self._directory = simulation, directory
        self._stamp_s = stamp_s or (lambda: simulation.time_s)
        directory.mkdir(parents=True, exist_ok=True)
        write_atomically(directory / TRUTH_FILE, json.dumps(truth(simulation.world), indent=1))
        self._trajectory = (directory / TRAJECTORY_FILE).open("w", encoding="ascii")
        self._start_s = self._written_s = time.monotonic()
        self._factor = 0.0

    def update(self, real_time_factor: float) -> None:
        """Record the present state; call it after every tick."""
        simulation = self._simulation
        self._factor = real_time_factor
        if simulation.tick % _TRAJECTORY_TICKS == 0:
            pose = simulation.true_pose
            _, _, qz, qw = quaternion_from_yaw(pose.yaw)
            self._trajectory.write(f"{self._stamp_s():.3f} {pose.x:.5f} {pose.y:.5f} 0 0 0 {qz:.7f} {qw:.7f}\n")
        now_s = time.monotonic()
        if now_s - self._written_s >= _STATE_PERIOD_S:
            self._written_s = now_s
            self._write_state(now_s)

    def close(self) -> None:
        """Write the last state and close the files."""
        self._write_state(time.monotonic())
        self._trajectory.close()

    def _write_state(self, now_s: float) -> None:
        simulation = self._simulation
        collisions = simulation.collisions
        last = None
        if collisions.last_object is not None:
            last = {"what": collisions.last_object, "sim_time_s": collisions.last_time_s}
        pose = simulation.true_pose
        state = {
            "sim_time_s": simulation.time_s,
            "wall_time_s": now_s - self._start_s,
            "real_time_factor": self._factor,
            "collisions": collisions.count,
            "last_collision": last,
            "distance_m": simulation.distance_m,
            "pose": _pose(pose),
            "twist": list(simulation.true_twist),
            "battery": simulation.battery,
            "estop_pressed": simulation.estop_pressed,
            "servos_rad": list(simulation.servos.angles),
            "led_color": list(simulation.led_color),
        }
        self._trajectory.flush()
        write_atomically(self._directory / STATE_FILE, json.dumps(state))
