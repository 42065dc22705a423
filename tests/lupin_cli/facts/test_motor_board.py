"""The probe of the motor board, run by a shell against a simulated board on a pseudo-terminal."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from lupin_cli.facts.motor_board import MOTOR_BOARD, AskedPort
from lupin_runtime.board_protocol import ENCODER, Answer, encode
from lupin_sim.motor_board import ENCODER_NEW, MOVING, BoardFault, Firmware, SimulatedBoard
from tests.support.board_probe import LATE_S, held_port, run_board_probe

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="only root sees the open files of all processes")


def ask(tmp_path: Path, board: SimulatedBoard) -> AskedPort:
    """Run the probe while nothing else may use the board."""
    (asked,) = run_board_probe(tmp_path, board).asked
    return asked


@pytest.mark.parametrize(
    ("fault", "version", "answer"),
    [
        (BoardFault.NONE, (1, 3), Answer.HEALTHY),
        (BoardFault.SILENT, (1, 3), Answer.SILENT),
        (BoardFault.LATE, (1, 3), Answer.LATE),
        (BoardFault.GARBAGE, (1, 3), Answer.FOREIGN),
        (BoardFault.FOREIGN, (1, 3), Answer.FOREIGN),
        (BoardFault.NONE, (1, 2), Answer.OLD),
    ],
)
def test_state_of_a_board_is_what_it_answers(
    tmp_path: Path, fault: BoardFault, version: tuple[int, int], answer: Answer
) -> None:
    with SimulatedBoard(Firmware(version, fault), LATE_S) as board:
        asked = ask(tmp_path, board)
    assert asked.examination is not None and asked.examination.answer is answer
    assert not set(board.firmware.requests) & MOVING and not board.firmware.stuck


def test_reports_of_a_configured_board_are_no_answers(tmp_path: Path) -> None:
    firmware = Firmware(fault=BoardFault.NONE)
    firmware.receive(encode(ENCODER_NEW, bytes((2, 18, 19))))
    with SimulatedBoard(firmware) as board:
        port = os.open(board.port, os.O_RDWR | os.O_NOCTTY)  # what is sent while nobody has the port open is lost
        firmware.fault = BoardFault.SILENT
        board.send(encode(ENCODER, b"\x12\x01") * 3)
        os.close(port)
        asked = ask(tmp_path, board)
    assert asked.examination is not None and asked.examination.answer is Answer.SILENT


@pytest.mark.parametrize("fault", [BoardFault.NONE, BoardFault.SILENT])
def test_nothing_is_sent_to_a_port_of_another_process(tmp_path: Path, fault: BoardFault) -> None:
    with SimulatedBoard(Firmware(fault=fault)) as board, held_port(board.port) as pid:
        asked = ask(tmp_path, board)
    assert [line.split()[0] for line in asked.holders] == [str(pid)]
    assert asked.examination is None and board.firmware.requests == []
    assert str(pid) in asked.lines()[0]


@pytest.mark.parametrize(
    ("program", "printed", "reason"),
    [
        ("systemctl", "active", "mirte-ros.service is active"),
        ("systemctl", "activating", "mirte-ros.service is activating"),
        ("systemctl", "deactivating", "mirte-ros.service is deactivating"),
        ("grep", "/proc/802/cmdline", "process 802 runs"),
    ],
)
def test_board_of_a_running_stack_is_not_asked(tmp_path: Path, program: str, printed: str, reason: str) -> None:
    (tmp_path / program).write_text(f"#!/bin/sh\necho {printed}\n")
    (tmp_path / program).chmod(0o755)
    with SimulatedBoard(Firmware()) as board:
        found = run_board_probe(tmp_path, board, str(tmp_path))
    assert (found.not_asked, found.asked, board.firmware.requests) == (reason, (), [])


def test_probe_does_not_look_like_the_vendors_driver() -> None:
    # `devices` finds the driver by this word in the command line of a process, and runs at the same time.
    assert "telemetrix" not in MOTOR_BOARD.probe.replace("[t]elemetrix", "")
