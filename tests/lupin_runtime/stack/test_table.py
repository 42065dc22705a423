"""The rows and nodes of the stack for each target."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lupin_runtime import graph
from lupin_runtime.stack import options as targets
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.table import TABLE, NodeRow, rows

SIMULATED = Options(mission=True, rviz=True)
LAPTOP = Options(target="robot", mission=True, rviz=True)
ONBOARD = Options(target=targets.ONBOARD)


def nodes(options: Options) -> dict[str, NodeRow]:
    """Return every node of a run by its class; fails for a duplicate class."""
    found: dict[str, NodeRow] = {}
    for row in rows(options):
        for node in row.nodes:
            name = node.path.split(":")[1]
            assert name not in found, f"{name} is in the run twice"
            found[name] = node
    return found


@pytest.mark.parametrize("options", [SIMULATED, LAPTOP, ONBOARD], ids=["simulated", "laptop", "onboard"])
def test_no_node_runs_twice(options: Options) -> None:
    assert nodes(options)


def test_laptop_and_robot_share_only_the_node_of_the_gamepads() -> None:
    assert nodes(LAPTOP).keys() & nodes(ONBOARD).keys() == {"PadTeleop"}  # each reads those of its own computer
    assert {"TwistMux", "EstopBridge", "LightStripBridge", "ArmPresetServer"} <= nodes(ONBOARD).keys()
    assert nodes(ONBOARD).keys() <= nodes(SIMULATED).keys() | {"ArmCalibrateServer"}


@pytest.mark.parametrize("options", [SIMULATED, LAPTOP], ids=["simulated", "laptop"])
def test_up_starts_every_node_that_a_mission_needs(options: Options) -> None:
    needed = {
        *("SlamNode", "Navigator", "TagAnnotator", "PerceptionAggregator", "TwinNode"),
        *("GreenhouseBridge", "PoseSeed", "MissionOrchestrator"),
    }
    assert needed <= nodes(options).keys()
    assert {"SimFlowerDetector", "YoloDetector"} & nodes(options).keys()
    assert "MissionOrchestrator" not in nodes(Options(target=options.target))


def test_images_cross_the_wireless_link_as_jpeg_only() -> None:
    assert nodes(LAPTOP)["TagAnnotator"].parameters(LAPTOP)["compressed"] is True
    assert "compressed" not in nodes(SIMULATED)["TagAnnotator"].parameters(SIMULATED)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (Options(), "button witness"),
        (Options(console=True), "button console witness"),
        (ONBOARD, "button witness"),
        (replace(ONBOARD, estop_button=False), "witness"),
        (replace(ONBOARD, console=True), "button witness"),  # consoles run on laptops
    ],
)
def test_estop_expects_the_sources_that_start_with_it(options: Options, expected: str) -> None:
    assert nodes(options)["EstopBridge"].parameters(options)["expected_sources"] == expected


def test_drive_bus_uses_the_sink_of_its_target() -> None:
    assert nodes(SIMULATED)["TwistMux"].parameters(SIMULATED)["sink"] == "sim"
    assert nodes(ONBOARD)["TwistMux"].parameters(ONBOARD)["sink"] == "robot"
    assert (graph.CMD_VEL_SINK_SIM.name, graph.CMD_VEL_SINK_ROBOT.name) == ("/cmd_vel", "/mirte_base_controller/cmd_vel")


def test_saved_map_starts_localization_without_slam_or_seed() -> None:
    names = nodes(Options(mission=True, map_file=Path("house.yaml"))).keys()
    assert {"MapServer", "AmclNode"} <= names
    assert not {"SlamNode", "PoseSeed"} & names


def test_each_target_starts_its_processes_only() -> None:
    kinds = (*targets.LAPTOP_TARGETS, targets.ONBOARD)
    names = {target: [row.name for row in rows(Options(target=target))] for target in kinds}
    laptop = ["slam", "nav", "perception", "twin", "recorder", "joystick"]
    assert names["sim"] == ["sim", "estop", "drive", "slam", "nav", "body", *laptop[2:]]
    assert names["robot"] == ["robot", *laptop]
    assert names["onboard"] == ["estop", "drive", "body", "joystick"]
    assert [row.name for row in rows(Options(target=targets.ROBOT_CAMERAS))] == ["body-camera", "gripper-camera", "video"]
    assert {target for row in TABLE for target in row.targets} == {*names, targets.ROBOT_CAMERAS}


@pytest.mark.parametrize(
    ("target", "needed", "watched"),
    [
        ("sim", {"sim", "estop", "drive"}, {"estop", "drive"}),
        ("robot", {"robot"}, set()),
        ("onboard", {"estop", "drive"}, {"estop", "drive"}),
        ("cameras", set(), {"video"}),
    ],
)
def test_processes_needed_to_drive_and_watched_by_target(target: str, needed: set[str], watched: set[str]) -> None:
    chosen = rows(Options(target=target))
    assert {row.name for row in chosen if row.needed_to_drive} == needed
    assert {row.name for row in chosen if row.watched} == watched


def test_ports_of_a_process_are_those_that_show_that_it_is_up() -> None:
    assert {row.name: row.listens for row in TABLE if row.listens} == {
        "console": (8090,),
        "video": (8091,),
        "foxglove": (8765,),
    }
