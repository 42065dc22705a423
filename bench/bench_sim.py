"""The simulated robot: its speed compared with real time, and the CPU time and memory of its process compared with limits.

First the engine alone at full speed: physics and lidar, then with both cameras at 10 fps. Next a lidar revolution with one call
for all rays, compared with one call for each ray. Then the process in real time, with subscriptions to all topics and both
cameras raw and as JPEG: its CPU time, memory and real-time factor.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from bench.processes import private_graph, spinning_node, terminate
from bench.runner import Figures, Seconds, World, benchmark, note
from lupin_runtime import graph
from lupin_runtime.ros import LupinNode
from lupin_sim.cameras import CameraRig, GraphicsUnavailable, new_image
from lupin_sim.engine import TICK_S, Simulation
from lupin_sim.worlds import load_world

SETTLE_S = 3.0
TICKS_PER_SCAN = 10


def measure_engine(world: str, seconds: float, cameras: bool) -> dict[str, float]:
    """Run the engine at full speed; return its real-time factor, and the share of a core that it would use in real time."""
    simulation = Simulation(load_world(world))
    rig, image = (CameraRig(simulation.model) if cameras else None), new_image()
    simulation.step()
    wall_start, cpu_start = time.perf_counter(), time.process_time()
    for tick in range(round(seconds / TICK_S)):
        simulation.command_twist(0.2, 0.0, 0.3)
        simulation.step()
        if tick % TICKS_PER_SCAN == 0:
            simulation.scan()
            if rig is not None:
                rig.render(simulation.data, "body_camera", image)
                rig.render(simulation.data, "gripper_camera", image)
    wall_s, cpu_s = time.perf_counter() - wall_start, time.process_time() - cpu_start
    if rig is not None:
        rig.close()
    return {"real_time_factor": seconds / wall_s, "cpu_percent_at_real_time": 100.0 * cpu_s / seconds}


def measure_lidar(world: str, rounds: int = 100) -> dict[str, float]:
    """Time a revolution of 360 rays in one call and in one call for each ray (microseconds). Exits if the ranges differ."""
    import mujoco

    simulation = Simulation(load_world(world))
    started = time.perf_counter()
    for _ in range(rounds):
        all_ranges = simulation.true_ranges()
    one_call_us = (time.perf_counter() - started) / rounds * 1e6
    model, data = simulation.model, simulation.data
    site = model.site("lidar").id
    angles = -np.pi + 2 * np.pi / 360 * np.arange(360)
    rays = np.stack([np.cos(angles), np.sin(angles), np.zeros(360)], 1) @ data.site_xmat[site].reshape(3, 3).T
    groups, hit = np.array([1, 1, 0, 0, 0, 0], np.uint8), np.zeros(1, np.int32)
    started = time.perf_counter()
    for _ in range(rounds):
        each_range = [mujoco.mj_ray(model, data, data.site_xpos[site], ray, groups, 1, -1, hit) for ray in rays]
    ray_by_ray_us = (time.perf_counter() - started) / rounds * 1e6
    each_range = [np.inf if r < 0 or r > 12.0 else r for r in each_range]
    if not np.allclose(all_ranges, each_range, atol=1e-9):
        raise SystemExit("bench_sim: one call and one call per ray give different ranges")
    return {"one_call_us": one_call_us, "ray_by_ray_us": ray_by_ray_us, "ratio": ray_by_ray_us / one_call_us}


def measure_simulator_process(world: str, seconds: float) -> dict[str, Any]:
    """Run `python -m lupin_sim`; return its CPU time, memory, real-time factor and rates, with subscriptions to all topics."""
    with private_graph() as environment, tempfile.TemporaryDirectory() as folder:
        os.environ.update(environment)
        command = [sys.executable, "-m", "lupin_sim", "--world", world, "--run-dir", folder]
        robot = subprocess.Popen(command, env=environment)
        try:
            with spinning_node("bench") as node:
                return _subscribe_and_measure(node, psutil.Process(robot.pid), Path(folder), seconds)
        finally:
            terminate(robot)


def _subscribe_and_measure(node: LupinNode, robot: psutil.Process, directory: Path, seconds: float) -> dict[str, Any]:
    cameras = (graph.BODY_IMAGE_SIM, graph.GRIPPER_IMAGE)
    topics = [graph.CLOCK, graph.ODOM, graph.ODOM_SIM, graph.SCAN, graph.IMU, graph.BATTERY, graph.JOINT_STATES, graph.TF]
    topics += [graph.ESTOP_BUTTON, *(graph.servo_position(servo) for servo in graph.SERVOS)]
    topics += [topic for image in cameras for topic in (image, graph.compressed(image), graph.camera_info(image))]
    counts = dict.fromkeys((topic.name for topic in topics), 0)

    def counter(name: str) -> Any:
        def count(_: bytes) -> None:
            counts[name] += 1

        return count

    for topic in topics:
        node.subscription(topic, counter(topic.name), raw=True)
    deadline = time.monotonic() + 20.0
    while not counts[graph.BODY_IMAGE_SIM.name] and not counts[graph.SCAN.name]:
        if time.monotonic() > deadline:
            raise SystemExit("bench_sim: no picture and no scan within 20 s")
        time.sleep(0.2)
    time.sleep(SETTLE_S)
    before, wall_start = robot.cpu_times(), time.monotonic()
    counts.update(dict.fromkeys(counts, 0))
    time.sleep(seconds)
    wall_s = time.monotonic() - wall_start
    after = robot.cpu_times()
    used_s = after.user + after.system - before.user - before.system
    memory = robot.memory_info().rss / 1e6
    state = json.loads((directory / "sim_state.json").read_text())
    return {
        "cpu_percent": 100.0 * used_s / wall_s,
        "memory_mb": memory,
        "real_time_factor": state["real_time_factor"],
        "rates_hz": {name: count / wall_s for name, count in counts.items()},
    }


# A real-time factor of 1, to two places.
@benchmark(at_most={"process.cpu_percent": 45.0, "process.memory_mb": 300.0}, at_least={"process.real_time_factor": 0.995})
def main(seconds: Seconds = 20.0, world: World = "demo") -> Figures:
    """Measure the engine with and without cameras, the lidar and the process."""
    figures: dict[str, Any] = {"world": world, "engine": measure_engine(world, seconds, False)}
    try:
        figures["engine_with_cameras"] = measure_engine(world, seconds, True)
    except GraphicsUnavailable as missing:
        note(f"not measured: {missing}")
    figures["lidar"] = measure_lidar(world)
    figures["process"] = measure_simulator_process(world, seconds)
    figures["load_average"] = os.getloadavg()[0]
    return figures


if __name__ == "__main__":
    sys.exit(main())
