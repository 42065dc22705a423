"""A robot computer with Lupin's units, a vendor's stack that is up, and a laptop with an operator's home."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_sim.host.checkout import RELEASE, SET_UP
from lupin_sim.host.operator import furnish, off_graph

if TYPE_CHECKING:
    from lupin_sim.host import Host

BOUND_S = 150.0


class Operator:
    """Types commands on the laptop."""

    def __init__(self, host: Host, home: Path) -> None:
        self.host = host
        self.environment = {**off_graph(), **furnish(host, home, SET_UP)}

    def types(self, *words: str) -> subprocess.CompletedProcess[str]:
        """`lupin WORDS`."""
        return self.host.run([sys.executable, "-m", "lupin_cli.app", *words], env=self.environment, timeout_s=BOUND_S)

    def asks(self, *words: str) -> tuple[int, dict[str, Any]]:
        """`lupin WORDS --json`: its status and what it said."""
        done = self.types(*words, "--json")
        assert done.stdout, done.stderr
        return done.returncode, json.loads(done.stdout)

    def runs_there(self, program: str) -> None:
        """Run a Python program as mirte, on the robot's own graph."""
        script = "; ".join(("cd ~", *SET_UP, f"exec {RELEASE}/venv/bin/python3 -"))
        command = ("runuser", "-u", "mirte", "--", "bash", "-c", script)
        done = self.host.robot.inside(*command, stdin=program, timeout_s=60.0)
        assert done.status == 0, done.stderr

    def state(self, unit: str) -> str:
        return self.host.robot.inside("systemctl", "is-active", unit).stdout.strip()

    @property
    def steps(self) -> int:
        """How often a program on the robot has set its clock."""
        return int(self.host.robot.state["clock_steps"])


@pytest.fixture(scope="module")
def operator(lupin_robot: Host, tmp_path_factory: pytest.TempPathFactory) -> Operator:
    """An operator at a laptop, and one robot for a whole file's tests."""
    return Operator(lupin_robot, tmp_path_factory.mktemp("home"))
