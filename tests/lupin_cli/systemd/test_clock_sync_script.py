"""The boot-time clock script, with stand-ins for chrony, ping and systemctl: each of its outcomes."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from lupin_cli.systemd.units import clock_sync_script

# The stand-ins, as shell scripts. `chronyc` logs its arguments to a file for the test.
PROGRAMS = {
    "systemctl": "echo inactive",
    "pgrep": "exit 1",
    "ping": "exit 0",
    "chronyc": """echo "$*" >> "$0.log"
case $* in
  *sources*) echo "^,*,10.42.0.2,10,6,17,1,0.1,0.1,0.1" ;;
  *tracking*) echo "0A2A0002,10.42.0.2,11,1,0.25,0.1" ;;
esac""",
}


class Robot:
    """Runs the script in a folder of stand-ins for the programs that it calls, which come first in its PATH."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name, text in PROGRAMS.items():
            self.install(name, text)
        script = (
            clock_sync_script().replace("PATH=/usr/sbin", f"PATH={folder}:/usr/sbin", 1).replace("budget_s=25", "budget_s=2")
        )
        (folder / "script").write_text(script)

    def install(self, name: str, text: str) -> None:
        (self.folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (self.folder / name).chmod(0o755)

    def run(self, *arguments: str) -> tuple[int, str]:
        command = ["/bin/sh", str(self.folder / "script"), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=dict(os.environ))
        assert done.stderr == ""
        return done.returncode, done.stdout.strip()

    @property
    def chrony_commands(self) -> list[str]:
        """The arguments of all chronyc calls, in order, without the queries."""
        path = self.folder / "chronyc.log"
        lines = path.read_text().splitlines() if path.exists() else []
        return [line for line in lines if "sources" not in line and "tracking" not in line]


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path)


def test_clock_is_stepped_once_after_three_samples_and_selection(robot: Robot) -> None:
    status, output = robot.run("10.42.0.2")
    assert status == 0 and output == "stepped to 10.42.0.2's time: 0.25 s off before, 0.25 s now"
    words = [line.split()[1 if line.startswith("-") else 0] for line in robot.chrony_commands]
    assert words == ["add", "online", "burst", "waitsync", "makestep", "waitsync"]
    assert robot.chrony_commands[-1].split()[2] == "0.1" and int(robot.chrony_commands[-1].split()[1]) <= 15


@pytest.mark.parametrize(
    ("program", "text", "message"),
    [
        ("systemctl", "echo active", "mirte-ros is active; the clock is left as it is"),
        ("systemctl", "echo activating", "mirte-ros is activating; the clock is left as it is"),
        ("pgrep", "exit 0", "ros2_control_node runs; the clock is left as it is"),
        ("ping", "exit 1", "10.42.0.2 did not answer within 2 s; the clock is left as it is"),
    ],
)
def test_live_stack_or_absent_laptop_leaves_the_clock_unchanged(robot: Robot, program: str, text: str, message: str) -> None:
    robot.install(program, text)
    assert robot.run("10.42.0.2") == (0, message)
    assert robot.chrony_commands == []


def test_stack_started_during_the_wait_prevents_the_step(robot: Robot) -> None:
    robot.install("systemctl", '[ -e "$0.second" ] && echo activating || { : > "$0.second"; echo inactive; }')
    status, output = robot.run("10.42.0.2")
    assert (status, output) == (0, "mirte-ros is activating; the clock is left as it is")
    assert not any("makestep" in line for line in robot.chrony_commands)


def test_laptop_that_answers_without_serving_time_is_reported(robot: Robot) -> None:
    robot.install("chronyc", PROGRAMS["chronyc"].replace(",17,", ",0,"))
    status, output = robot.run("10.42.0.2")
    assert status == 0 and output.startswith("10.42.0.2 answers, but its chrony doesn't")
    assert not any("makestep" in line for line in robot.chrony_commands)


@pytest.mark.parametrize(
    ("stratum", "behind", "steps"), [(10, "-300.5", False), (3, "-300.5", True), (10, "16440.0", True), (10, "-2.5", True)]
)
def test_robot_that_is_ahead_is_set_from_a_synchronized_laptop(robot: Robot, stratum: int, behind: str, steps: bool) -> None:
    chronyc = PROGRAMS["chronyc"].replace("10.42.0.2,10,6", f"10.42.0.2,{stratum},6").replace(",0.25,0.1", f",{behind},0.1")
    robot.install("chronyc", chronyc)
    status, output = robot.run("10.42.0.2")
    assert status == 0 and any("makestep" in line for line in robot.chrony_commands) is steps
    if not steps:
        assert output.startswith("300.5 s ahead of 10.42.0.2, which follows no time source")
        assert output.endswith("the clock is left as it is") and "-n offline 10.42.0.2" in robot.chrony_commands


def test_one_sample_is_not_enough(robot: Robot) -> None:
    robot.install("chronyc", PROGRAMS["chronyc"].replace(",17,", ",1,"))
    status, output = robot.run("10.42.0.2")
    assert status == 0 and output.endswith("the clock is left as it is")
    assert not any("makestep" in line for line in robot.chrony_commands)


def test_no_step_if_chrony_selects_no_source(robot: Robot) -> None:
    robot.install("chronyc", PROGRAMS["chronyc"].replace("esac", "  waitsync*) exit 1 ;;\nesac"))
    status, output = robot.run("10.42.0.2")
    assert (status, output) == (0, "chrony did not select 10.42.0.2; the clock is left as it is")
    assert not any("makestep" in line for line in robot.chrony_commands)


@pytest.mark.parametrize("behind_s", [-1.8e9, 1.8e9])
def test_impossible_time_of_the_laptop_is_refused(robot: Robot, behind_s: float) -> None:
    robot.install("chronyc", PROGRAMS["chronyc"].replace(",0.25,", f",{behind_s:f},"))
    status, output = robot.run("10.42.0.2")
    assert status == 0 and output.startswith("the time of 10.42.0.2 is certainly wrong (")
    assert output.endswith("; the clock is left as it is")
    assert not any("makestep" in line for line in robot.chrony_commands)


def test_missing_laptop_address_does_not_stop_the_boot(robot: Robot) -> None:
    assert robot.run() == (0, "no laptop was named; the clock is left as it is")
