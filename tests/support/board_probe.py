"""Runs the probe of the motor board against a simulated board, as a robot would."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from lupin_cli.connection.base import Output
from lupin_cli.facts.motor_board import MotorBoard, parse, probe_script
from lupin_sim.motor_board import SimulatedBoard

SHELL = shutil.which("dash") or "/bin/sh"
LATE_S = 2.2  # the delay of a board that answers later than the vendor's driver waits
_HOLD = "import os, sys; os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print('open', flush=True); sys.stdin.read()"


@contextlib.contextmanager
def held_port(path: str) -> Iterator[int]:
    """Let another process hold a port open during the block; yield its PID."""
    command = [sys.executable, "-c", _HOLD, path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdin is not None and holder.stdout is not None and holder.stdout.readline() == "open\n"
        try:
            yield holder.pid
        finally:
            holder.stdin.close()


def name_port(folder: Path, board: SimulatedBoard) -> str:
    """Name the port of a board as udev does, below `folder`. Return the probe that finds it there."""
    by_id = folder / "by-id"
    by_id.mkdir()
    (by_id / "usb-Raspberry_Pi_Pico_E66164084385-if00").symlink_to(board.port)
    return probe_script(str(by_id))


def run_board_probe(folder: Path, board: SimulatedBoard, path: str = "") -> MotorBoard:
    """Run the probe for the port of a board, which udev has named. Programs in the folder `path` replace others."""
    environment = {**os.environ, "PATH": f"{path}:{os.environ['PATH']}"}
    command = [SHELL, "-c", name_port(folder, board)]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60, env=environment)
    assert done.stderr == ""
    found = parse(Output(done.returncode, done.stdout))
    assert found.serial_ports == (board.port,)
    return found
