"""`motor-board` against a simulated board, and the script that restarts it."""

from __future__ import annotations

import dataclasses
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.connection.base import Output
from lupin_cli.connection.local import LocalTarget
from lupin_cli.facts.motor_board import MOTOR_BOARD
from lupin_cli.operations import motor_board
from lupin_cli.operations.base import Difference, OperationError
from lupin_cli.operations.motor_board import MotorBoardAnswers
from lupin_cli.operations.shell import observe
from lupin_sim.motor_board import BoardFault, Firmware, SimulatedBoard
from tests.support.board_probe import SHELL, name_port

RESTART = motor_board._RESTART


@pytest.mark.skipif(os.geteuid() != 0, reason="only root sees the open files of all processes")
def test_silent_board_answers_after_its_restart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with SimulatedBoard(Firmware(fault=BoardFault.SILENT)) as board:
        probe = name_port(tmp_path, board)
        monkeypatch.setattr(motor_board, "MOTOR_BOARD", dataclasses.replace(MOTOR_BOARD, probe=probe))

        def restart(*_: Any, **__: Any) -> Output:
            board.firmware.fault = BoardFault.NONE
            return Output(0, "")

        monkeypatch.setattr(motor_board, "change", restart)
        operation, target = MotorBoardAnswers(), LocalTarget("robot")
        difference = operation.judge(observe(operation, target))
        assert difference is not None and "silent after 4 requests" in difference.summary
        operation.change(target, difference)
        assert operation.with_baseline(difference.before).judge(observe(operation, target)) is None


def run_restart(folder: Path, **programs: str) -> subprocess.CompletedProcess[str]:
    """Run the script with these programs, by what they print and do."""
    for name, text in programs.items():
        (folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (folder / name).chmod(0o755)
    environment = {**os.environ, "PATH": f"{folder}:/usr/bin:/bin"}
    return subprocess.run([SHELL, "-c", RESTART], capture_output=True, text=True, timeout=60, env=environment)


@pytest.mark.parametrize("state", ["active", "activating", "deactivating"])
def test_board_of_a_running_stack_is_not_restarted(tmp_path: Path, state: str) -> None:
    done = run_restart(tmp_path, systemctl=f"echo {state}", picotool="echo restarted")
    assert (done.returncode, done.stdout, done.stderr) == (1, "", f"mirte-ros.service is {state}\n")


@pytest.mark.parametrize("state", ["inactive", "failed", ""])
def test_board_of_a_stopped_stack_is_restarted(tmp_path: Path, state: str) -> None:
    done = run_restart(tmp_path, systemctl=f"echo {state}", picotool='echo "$@"')
    assert (done.returncode, done.stdout) == (0, "reboot -f\n")


def test_failed_restart_says_what_to_do_by_hand() -> None:
    class Refusing(LocalTarget):
        def run(self, *_: Any, **__: Any) -> Output:
            return Output(1, "", "No accessible RP2040 devices\n")

    with pytest.raises(OperationError, match=r"No accessible RP2040 devices .*unplug the board's USB cable") as refused:
        MotorBoardAnswers().change(Refusing("robot"), Difference("restart"))
    assert refused.value.next_command == "lupin play recover-board"


def test_board_of_the_laptop_is_refused() -> None:
    with pytest.raises(ValueError, match="belongs to the robot"):
        MotorBoardAnswers(machine="laptop")
