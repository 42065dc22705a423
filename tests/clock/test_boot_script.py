"""The boot-time script with programs of the test's own in place of chrony, ping and systemd: every way it may end."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import pytest

from lupin_cli.units import clock_sync_script

# What a program says when it is called; `chronyc` gets its last words from a file so that a test can read what was asked.
PROGRAMS = {
    "systemctl": "echo inactive",
    "pgrep": "exit 1",
    "ping": "exit 0",
    "chronyc": """echo "$*" >> "$0.asked"
case $* in
  *sources*) echo "^,*,10.42.0.2,10,6,17,1,0.1,0.1,0.1" ;;
  *tracking*) echo "0A2A0002,10.42.0.2,11,1,0.25,0.1" ;;
esac""",
}


class Robot:
    """A folder of programs, and the script with that folder as its whole PATH before the system's."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name, text in PROGRAMS.items():
            self.has(name, text)
        script = (
            clock_sync_script().replace("PATH=/usr/sbin", f"PATH={folder}:/usr/sbin", 1).replace("budget_s=25", "budget_s=2")
        )
        (folder / "script").write_text(script)

    def has(self, name: str, text: str) -> None:
        (self.folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (self.folder / name).chmod(0o755)

    def run(self, *arguments: str) -> tuple[int, str]:
        command = ["/bin/sh", str(self.folder / "script"), *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=dict(os.environ))
        assert done.stderr == ""
        return done.returncode, done.stdout.strip()

    @property
    def asked(self) -> list[str]:
        """What chrony was asked, in order; polls left out."""
        path = self.folder / "chronyc.asked"
        lines = path.read_text().splitlines() if path.exists() else []
        return [line for line in lines if "sources" not in line and "tracking" not in line]


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return Robot(tmp_path)


def test_three_good_samples_and_a_selected_source_come_before_the_one_step(robot: Robot) -> None:
    status, said = robot.run("10.42.0.2")
    assert status == 0 and said == "stepped to 10.42.0.2's time: 0.25 s off before, 0.25 s now"
    words = [line.split()[1 if line.startswith("-") else 0] for line in robot.asked]
    assert words == ["add", "online", "burst", "waitsync", "makestep", "waitsync"]
    assert robot.asked[-1].split()[2] == "0.1" and int(robot.asked[-1].split()[1]) <= 15


@pytest.mark.parametrize(
    ("program", "text", "said"),
    [
        ("systemctl", "echo active", "mirte-ros is active; the clock is left as it is"),
        ("systemctl", "echo activating", "mirte-ros is activating; the clock is left as it is"),
        ("pgrep", "exit 0", "ros2_control_node runs; the clock is left as it is"),
        ("ping", "exit 1", "10.42.0.2 did not answer within 2 s; the clock is left as it is"),
    ],
)
def test_a_live_stack_or_an_absent_laptop_leaves_the_clock_alone(robot: Robot, program: str, text: str, said: str) -> None:
    robot.has(program, text)
    assert robot.run("10.42.0.2") == (0, said)
    assert robot.asked == []


def test_a_stack_that_came_up_while_it_waited_is_not_stepped_either(robot: Robot) -> None:
    robot.has("systemctl", '[ -e "$0.second" ] && echo activating || { : > "$0.second"; echo inactive; }')
    status, said = robot.run("10.42.0.2")
    assert (status, said) == (0, "mirte-ros is activating; the clock is left as it is")
    assert not any("makestep" in line for line in robot.asked)


def test_a_laptop_that_answers_but_does_not_serve_its_time_is_said_to(robot: Robot) -> None:
    robot.has("chronyc", PROGRAMS["chronyc"].replace(",17,", ",0,"))
    began = time.monotonic()
    status, said = robot.run("10.42.0.2")
    assert status == 0 and said.startswith("10.42.0.2 answers, but its chrony doesn't") and time.monotonic() - began < 30
    assert not any("makestep" in line for line in robot.asked)


def test_one_sample_is_not_enough(robot: Robot) -> None:
    robot.has("chronyc", PROGRAMS["chronyc"].replace(",17,", ",1,"))
    status, said = robot.run("10.42.0.2")
    assert status == 0 and said.endswith("the clock is left as it is")
    assert not any("makestep" in line for line in robot.asked)


def test_a_chrony_that_selects_no_source_is_not_told_to_step_since_it_would_say_ok_and_do_nothing(robot: Robot) -> None:
    robot.has("chronyc", PROGRAMS["chronyc"].replace("esac", "  waitsync*) exit 1 ;;\nesac"))
    status, said = robot.run("10.42.0.2")
    assert (status, said) == (0, "chrony did not select 10.42.0.2; the clock is left as it is")
    assert not any("makestep" in line for line in robot.asked)


def test_without_a_laptops_address_it_boots_on(robot: Robot) -> None:
    assert robot.run() == (0, "no laptop was named; the clock is left as it is")
