"""The recorded truth describes the world and what the robot did in it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lupin_sim.engine import Simulation
from lupin_sim.mirte import ARM_START_RAD
from lupin_sim.scoring import read_tum
from lupin_sim.truth import STATE_FILE, TRAJECTORY_FILE, TRUTH_FILE, TruthRecorder, truth
from lupin_sim.worlds import load_world


def test_truth_describes_the_world() -> None:
    world = load_world("walled")
    document = json.loads(json.dumps(truth(world)))
    assert document["world"] == "walled"
    assert document["start"] == {"x": 0.8, "y": 0.8, "yaw": 0.0}
    assert {tag["id"]: tag["reachable"] for tag in document["tags"]} == {1: True, 2: True, 5: False}
    assert sum(len(tag["flowers"]) for tag in document["tags"]) == len(world.flowers)
    assert set(document["tags"][0]) == {"id", "x", "y", "z", "yaw_normal", "reachable", "box", "flowers"}
    assert {"id", "kind", "x", "y", "yaw", "width", "depth", "height"} == set(document["boxes"][0])
    assert len(document["walls"]) == 4


def test_recorder_writes_the_true_trajectory_and_state(tmp_path: Path) -> None:
    simulation = Simulation(load_world("demo"))
    recorder = TruthRecorder(simulation, tmp_path / "run")
    simulation.set_leds(1, 2, 3)
    for _ in range(200):
        simulation.command_twist(0.3, 0.0, 0.2)
        simulation.step()
        recorder.update(real_time_factor=0.9)
    recorder.close()
    run = tmp_path / "run"
    assert json.loads((run / TRUTH_FILE).read_text())["world"] == "demo"
    rows = read_tum(run / TRAJECTORY_FILE)
    assert len(rows) == 20
    assert rows[:, 0] == pytest.approx([1.1 + 0.1 * i for i in range(20)])
    pose = simulation.true_pose
    assert rows[-1, 1:3] == pytest.approx((pose.x, pose.y), abs=1e-4)
    state = json.loads((run / STATE_FILE).read_text())
    assert state["sim_time_s"] == pytest.approx(3.0)
    assert state["real_time_factor"] == 0.9
    assert state["collisions"] == 0
    assert state["last_collision"] is None
    assert state["servos_rad"] == pytest.approx([*ARM_START_RAD, 0.0], abs=0.05)
    assert state["led_color"] == list(simulation.led_color) != [0, 0, 0]
    assert state["distance_m"] == pytest.approx(0.58, abs=0.05)
    assert not list(run.glob(".*"))


def test_trajectory_has_the_stamps_of_the_robots_clock(tmp_path: Path) -> None:
    simulation = Simulation(load_world("walled"))
    recorder = TruthRecorder(simulation, tmp_path, lambda: 1e9 + simulation.time_s)
    for _ in range(20):
        simulation.step()
        recorder.update(real_time_factor=1.0)
    recorder.close()
    assert read_tum(tmp_path / TRAJECTORY_FILE)[:, 0] == pytest.approx([1e9 + 1.1, 1e9 + 1.2])
