"""A simulated computer that runs Lupin's units and the vendor's stack, and a laptop with an operator's home directory."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_sim.host.checkout import CURRENT_RELEASE, SETUP_LINES
from lupin_sim.host.operator import create_home, environment_without_ros

if TYPE_CHECKING:
    from lupin_sim.host import Host

TIMEOUT_S = 150.0


class Operator:
    """A person at the laptop, who runs `lupin` commands there."""

    def __init__(self, host: Host, home: Path) -> None:
        self.host = host
        self.environment = {**environment_without_ros(), **create_home(host, home, SETUP_LINES)}

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run `lupin WORDS`."""
        return self.host.run([sys.executable, "-m", "lupin_cli.app", *words], env=self.environment, timeout_s=TIMEOUT_S)

    def run_json(self, *words: str) -> tuple[int, dict[str, Any]]:
        """Run `lupin WORDS --json`. Return its exit status and output."""
        done = self.run(*words, "--json")
        assert done.stdout, done.stderr
        return done.returncode, json.loads(done.stdout)

    def run_on_robot(self, program: str) -> None:
        """Run a Python program as the user mirte, in the robot's graph."""
        script = "; ".join(("cd ~", *SETUP_LINES, f"exec {CURRENT_RELEASE}/venv/bin/python3 -"))
        command = ("runuser", "-u", "mirte", "--", "bash", "-c", script)
        done = self.host.robot.run_as_root(*command, stdin=program, timeout_s=60.0)
        assert done.status == 0, done.stderr

    def state(self, unit: str) -> str:
        return self.host.robot.run_as_root("systemctl", "is-active", unit).stdout.strip()

    @property
    def clock_steps(self) -> int:
        """How often the robot's clock was stepped."""
        return int(self.host.robot.state["clock_steps"])


@pytest.fixture(scope="module")
def operator(lupin_host: Host, tmp_path_factory: pytest.TempPathFactory) -> Operator:
    """Return an operator at a laptop, with one robot for all tests of a file."""
    return Operator(lupin_host, tmp_path_factory.mktemp("home"))
