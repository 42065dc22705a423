"""Findings about the motor board: a simulated board is broken, asked by the probe, and examined with all checks."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.checks.base import Finding
from lupin_cli.checks.table import built_in
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.devices import Devices, Holder, TelemetrixProcess
from lupin_cli.facts.graph import Graph, Graphs
from lupin_sim.motor_board import BoardFault, Firmware, SimulatedBoard
from tests.support.board_probe import LATE_S, held_port, run_board_probe
from tests.support.findings import assert_findings_match_rows
from tests.support.snapshots import HEALTHY_LAPTOP, HEALTHY_ROBOT, captured, snapshot_of

needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root sees the open files of all processes")
PORT = "/dev/ttyACM0"
DRIVER = TelemetrixProcess(802, "S", "mirte_telemetrix_cpp_node --ros-args")


def root_findings(robot: Mapping[str, Any], laptop: Mapping[str, Any] | None = None) -> list[Finding]:
    diagnosis = diagnose(built_in(), snapshot_of({**HEALTHY_LAPTOP, **(laptop or {})}, {**HEALTHY_ROBOT, **robot}))
    assert_findings_match_rows(diagnosis)
    return [root.finding for root in diagnosis.roots]


def robot_graph() -> Graph:
    seen: Graph = captured("graph", "simulator").graphs[0]
    return dataclasses.replace(seen, name="robot", kind="robot")


def examine_board(folder: Path, fault: BoardFault, version: tuple[int, int] = (1, 3)) -> list[Finding]:
    with SimulatedBoard(Firmware(version, fault), LATE_S) as board:
        return root_findings({"motor-board": run_board_probe(folder, board)})


@needs_root
@pytest.mark.parametrize(
    ("fault", "cause"), [(BoardFault.SILENT, "the board answers nothing"), (BoardFault.LATE, "the board answers after 2.2 s")]
)
def test_board_without_timely_answers_is_wedged(tmp_path: Path, fault: BoardFault, cause: str) -> None:
    (finding,) = examine_board(tmp_path, fault)
    assert finding.id == "board-wedged" and cause in finding.cause


@needs_root
@pytest.mark.parametrize(
    ("fault", "version", "cause"),
    [
        (BoardFault.FOREIGN, (1, 3), "another program runs on it"),
        (BoardFault.GARBAGE, (1, 3), "its cable is damaged"),
        (BoardFault.NONE, (1, 2), "the firmware 1.2; the vendor's driver of MIRTE OS 0.2 needs 1.3"),
    ],
)
def test_board_with_another_program_is_named(tmp_path: Path, fault: BoardFault, version: tuple[int, int], cause: str) -> None:
    (finding,) = examine_board(tmp_path, fault, version)
    assert finding.id == "board-firmware-wrong" and cause in finding.cause
    assert "picotool load" in finding.fix.command


@needs_root
def test_healthy_board_has_no_finding(tmp_path: Path) -> None:
    assert examine_board(tmp_path, BoardFault.NONE) == []


@needs_root
def test_process_that_holds_the_port_is_named(tmp_path: Path) -> None:
    with SimulatedBoard(Firmware()) as board, held_port(board.port) as pid:
        (finding,) = root_findings({"motor-board": run_board_probe(tmp_path, board)})
    assert finding.id == "board-held" and f"(pid {pid})" in finding.cause
    assert f"sudo kill {pid}" in finding.fix.command


@pytest.mark.parametrize(
    ("holder", "command"),
    [
        (Holder(950, PORT, "ModemManager.service", "ModemManager", "/usr/sbin/ModemManager"), "stop ModemManager.service"),
        (Holder(951, PORT, "-", "minicom", "minicom -D /dev/ttyACM0"), "sudo kill 951"),
        (Holder(802, PORT, "mirte-ros.service", "main_thread", DRIVER.command), ""),
        (Holder(803, PORT, "-", "python3", "python3 telemetrix_aio.py"), ""),
        (Holder(952, "/dev/ttyUSB0", "-", "rplidar", "rplidar_composition"), ""),
    ],
)
def test_only_another_program_beside_the_driver_holds_it(holder: Holder, command: str) -> None:
    devices = Devices((), (), (f"{PORT} root:dialout 660",), (), (holder,), (DRIVER,))
    found = root_findings({"devices": devices, "motor-board": "stack-runs"})
    assert [finding.id for finding in found] == (["board-held"] if command else [])
    assert all(command in finding.fix.command and "restart mirte-ros" in finding.fix.command for finding in found)


@pytest.mark.parametrize(
    ("devices", "ids"),
    [
        (Devices(("usb1 1d6b:0002 xHCI",), (), (), (), (), (DRIVER,)), ["board-absent"]),
        (Devices(("usb1 1d6b:0002 xHCI",), (), ("/dev/ttyUSB0 root:dialout 660",), (), (), (DRIVER,)), ["board-absent"]),
        (Devices((), (), (f"{PORT} root:dialout 660",), (), (), (DRIVER,)), []),  # another kind of board
        (Devices((), (), (), (), (), ()), []),  # no driver looks for one, as on a simulated robot
    ],
)
def test_board_is_absent_only_if_its_driver_looks_for_it(devices: Devices, ids: list[str]) -> None:
    assert [finding.id for finding in root_findings({"devices": devices, "motor-board": "absent"})] == ids


@pytest.mark.parametrize("state", ["boot-loader", "not-authorized", "over-current"])
def test_usb_of_a_robot_without_a_driver_is_not_judged(state: str) -> None:
    assert root_findings({"motor-board": state}) == []


def test_board_that_left_the_bus_is_wedged_not_absent() -> None:
    devices = Devices((), (), ("/dev/ttyUSB0 root:dialout 660",), (), (), (DRIVER,))
    (finding,) = root_findings({"devices": devices, "journal": "board-gone", "motor-board": "absent"})
    assert finding.id == "board-wedged" and "left the USB bus" in finding.cause


def test_wedged_board_is_no_consequence_of_a_stopped_stack() -> None:
    found = root_findings({"units": "stopped-and-stale", "motor-board": "silent"})
    assert {"board-wedged", "vendor-service-down"} <= {finding.id for finding in found}


@pytest.mark.parametrize(("volts", "ids"), [(0.4, ["board-unpowered"]), (11.4, []), (None, [])])
def test_motors_without_supply_are_named(volts: float | None, ids: list[str]) -> None:
    graph = robot_graph()
    seen = Graphs((dataclasses.replace(graph, battery=(0.5, volts)),))
    found = [finding for finding in root_findings({}, {"graph": seen}) if finding.id.startswith(("board", "battery"))]
    assert [finding.id for finding in found] == ids


def test_driver_that_gives_up_the_board_shows_it_is_wedged() -> None:
    graph = robot_graph()
    of_board = {topic.name for topic in graph.topics if topic.name.startswith("/io/")}
    topics = tuple(dataclasses.replace(t, publishers=()) if t.name in of_board else t for t in graph.topics)
    seen = dataclasses.replace(graph, topics=topics, samples=tuple(s for s in graph.samples if s[0] not in of_board))
    robot = {"motor-board": "stack-runs", "journal": "board-given-up"}
    lost = {finding.id: finding for finding in root_findings(robot, {"graph": Graphs((seen,))})}
    assert "gets no answer" in lost["board-wedged"].cause and "part-missing" not in lost
    assert "board-wedged" not in {finding.id for finding in root_findings(robot, {"graph": Graphs((graph,))})}
