"""The simulated robot: its speed compared with real time, and the CPU time and memory of its process compared with limits.

    python -m bench.bench_sim [--seconds 20] [--world demo] [--json]

First the engine alone at full speed: physics and lidar, then with both cameras at 10 fps. Next a lidar revolution with one call
for all rays, compared with one call for each ray. Then the process in real time, with subscriptions to all topics and both
cameras raw and as JPEG: its CPU time, memory and real-time factor, compared with the limits (45 % of a core, 300 MB, factor 1).
"""

from __future__ import annotations

import argparse
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

from lupin_runtime import graph
from lupin_runtime.stack.dds import claim_domain, loopback_environment
from lupin_sim.cameras import CameraRig, GraphicsUnavailable, new_image
from lupin_sim.engine import TICK_S, Simulation
from lupin_sim.worlds import load_world

MAX_CPU_PERCENT, MAX_MEMORY_MB, MIN_REAL_TIME_FACTOR = 45.0, 300.0, 1.0
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
    return {"one_call_us": one_call_us, "ray_by_ray_us": ray_by_ray_us}


def measure_simulator_process(world: str, seconds: float) -> dict[str, Any]:
    """Run `python -m lupin_sim`; return its CPU time, memory, real-time factor and rates, with subscriptions to all topics."""
    claim = claim_domain()
    directory = Path(tempfile.mkdtemp(prefix="lupin-bench-"))
    environment = loopback_environment(claim.domain, directory / "dds")
    os.environ.update(environment)
    robot = subprocess.Popen(
        [sys.executable, "-m", "lupin_sim", "--world", world, "--run-dir", str(directory)], env=environment
    )
    try:
        return _subscribe_and_measure(psutil.Process(robot.pid), directory, seconds)
    finally:
        robot.terminate()
        try:
            robot.wait(10)
        except subprocess.TimeoutExpired:
            robot.kill()
            robot.wait()
        claim.release()


def _subscribe_and_measure(robot: psutil.Process, directory: Path, seconds: float) -> dict[str, Any]:
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from lupin_runtime.ros import LupinNode

    cameras = (graph.BODY_IMAGE_SIM, graph.GRIPPER_IMAGE)
    topics = [graph.CLOCK, graph.ODOM, graph.ODOM_SIM, graph.SCAN, graph.IMU, graph.BATTERY, graph.JOINT_STATES, graph.TF]
    topics += [graph.ESTOP_BUTTON, *(graph.servo_position(servo) for servo in graph.SERVOS)]
    topics += [topic for image in cameras for topic in (image, graph.compressed(image), graph.camera_info(image))]
    rclpy.init(args=[])
    node, counts = LupinNode("bench"), dict.fromkeys((topic.name for topic in topics), 0)

    def counter(name: str) -> Any:
        def count(_: bytes) -> None:
            counts[name] += 1

        return count

    for topic in topics:
        node.subscription(topic, counter(topic.name), raw=True)
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    def spin(for_s: float) -> None:
        end = time.monotonic() + for_s
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)

    deadline = time.monotonic() + 20.0
    while not counts[graph.BODY_IMAGE_SIM.name] and not counts[graph.SCAN.name]:
        if time.monotonic() > deadline:
            raise SystemExit("bench_sim: no picture and no scan within 20 s")
        spin(0.2)
    spin(SETTLE_S)
    before, wall_start = robot.cpu_times(), time.monotonic()
    counts.update(dict.fromkeys(counts, 0))
    spin(seconds)
    wall_s = time.monotonic() - wall_start
    after = robot.cpu_times()
    used_s = after.user + after.system - before.user - before.system
    memory = robot.memory_info().rss / 1e6
    state = json.loads((directory / "sim_state.json").read_text())
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    return {
        "cpu_percent": 100.0 * used_s / wall_s,
        "memory_mb": memory,
        "real_time_factor": state["real_time_factor"],
        "rates_hz": {name: round(count / wall_s, 1) for name, count in counts.items()},
    }


def main() -> int:
    """Measure the engine with and without cameras, the lidar and the process; return 1 if the process does not meet a limit."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="measure each part for this long")
    parser.add_argument("--world", default="demo", help="world to simulate; takes the values of `lupin up --world`")
    parser.add_argument("--json", action="store_true", help="print one JSON line instead of a table")
    arguments = parser.parse_args()
    result: dict[str, Any] = {"world": arguments.world, "engine": measure_engine(arguments.world, arguments.seconds, False)}
    try:
        result["engine_with_cameras"] = measure_engine(arguments.world, arguments.seconds, True)
    except GraphicsUnavailable as missing:
        print(f"bench_sim: {missing}", file=sys.stderr)
    result["lidar"] = measure_lidar(arguments.world)
    result["process"] = measure_simulator_process(arguments.world, arguments.seconds)
    process = result["process"]
    is_met = {
        "cpu": process["cpu_percent"] <= MAX_CPU_PERCENT,
        "memory": process["memory_mb"] <= MAX_MEMORY_MB,
        "speed": round(process["real_time_factor"], 2) >= MIN_REAL_TIME_FACTOR,
    }
    status = 0 if all(is_met.values()) else 1
    if arguments.json:
        print(json.dumps(result))
        return status
    print(f"world {arguments.world}, {arguments.seconds:.0f} s, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for name in ("engine", "engine_with_cameras"):
        if name in result:
            engine = result[name]
            cpu_percent = engine["cpu_percent_at_real_time"]
            print(f"{name:22} {engine['real_time_factor']:7.1f} x real time, {cpu_percent:5.1f} % of a core at real time")
    rays = result["lidar"]
    ratio = rays["ray_by_ray_us"] / rays["one_call_us"]
    print(f"{'lidar, 360 rays':22} {rays['one_call_us']:7.0f} us; ray by ray {rays['ray_by_ray_us']:.0f} us: ratio {ratio:.1f}")
    verdict = {name: "ok" if met else "MISSED" for name, met in is_met.items()}
    cpu_percent, memory_mb, factor = process["cpu_percent"], process["memory_mb"], process["real_time_factor"]
    cpu_ratio, memory_ratio = cpu_percent / MAX_CPU_PERCENT, memory_mb / MAX_MEMORY_MB
    print(f"{'process, all topics':22} {cpu_percent:7.1f} % of a core: {cpu_ratio:.2f} of the limit  {verdict['cpu']}")
    print(f"{'':22} {memory_mb:7.0f} MB: {memory_ratio:.2f} of the limit  {verdict['memory']}")
    print(f"{'':22} {factor:7.3f} x real time: limit {MIN_REAL_TIME_FACTOR:g}  {verdict['speed']}")
    return status


if __name__ == "__main__":
    sys.exit(main())
