"""Several robots that boot, examined by one command: what ails one of them is told of that one, and holds nobody up."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.checks.discovery import STARTING_S
from lupin_sim.host import Host
from lupin_sim.host.checkout import keep_memory
from lupin_sim.host.fixtures import until, until_it_serves
from lupin_sim.host.host import PROJECT

from .laptop import Laptop, bounded, vendor_age_s

pytestmark = pytest.mark.host

BOUND_S = 60.0
DOCTOR = [sys.executable, "-m", "lupin_cli.app", "doctor", "--all", "--json", "--only", "link.*", "--only", "discovery.*"]


@pytest.fixture
def fleet(boot_host: Callable[..., Host], tmp_path: Path) -> Laptop:
    """Four robots whose discovery serves, and a laptop that knows them as pot-1 to pot-4."""
    laptop = Laptop(boot_host(robots=4), tmp_path / "home")
    laptop.set_up()
    rows = [f'[robots.pot-{n}]\nuser = "mirte"\naddresses.wired = "{r.eth0}"' for n, r in enumerate(laptop.host.robots, 1)]
    (laptop.own / "lupin.toml").write_text("\n".join(rows))
    for robot in laptop.host.robots:
        until_it_serves(robot)
        keep_memory(robot)
        until(lambda robot=robot: vendor_age_s(laptop.host, robot) > STARTING_S, "a stack that has been up for a while", 30.0)
    return laptop


def judged(said: str) -> dict[str, tuple[int, str | None, list[str]]]:
    """Of every robot its status, how it could not be reached, and what is named."""
    return {
        told["robot"]["name"]: (
            told["status"],
            told["robot"]["unreachable"],
            [finding["id"] for finding in told["findings"]],
        )
        for told in json.loads(said)["robots"]
    }


def test_each_robot_is_told_by_itself_and_one_that_hangs_holds_nobody_up(fleet: Laptop) -> None:
    _, killed, hung, late = fleet.host.robots
    killed.fault("server-killed")
    hung.fault("sshd-hung")
    late.fault("slow-link", delay_ms=150.0, jitter_ms=20.0)
    done = fleet.host.run(DOCTOR, env=fleet.sourced, cwd=str(PROJECT), timeout_s=BOUND_S)
    told = judged(done.stdout)
    assert told == {
        "pot-1": (0, None, []),
        "pot-2": (1, None, ["discovery-server-missing"]),
        "pot-3": (3, "silent", ["robot-unreachable"]),
        "pot-4": (0, None, []),
    }
    assert done.returncode == 3


def test_a_cable_that_is_pulled_behind_a_login_is_told_of_that_robot_alone(fleet: Laptop) -> None:
    cut = fleet.host.robots[1]
    cut.fault("slow-link", delay_ms=300.0, jitter_ms=0.0)  # so that the pull comes between its login and its answers
    asking: subprocess.Popen[Any] = fleet.host.popen(
        DOCTOR, env=fleet.sourced, cwd=str(PROJECT), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with bounded(asking, BOUND_S):
        until(
            lambda: "Accepted publickey" in cut.inside("journalctl", "-q", "-o", "cat", "-u", "ssh").stdout,
            "the login",
        )
        cut.fault("cable-cut", link="eth0")
        said, complained = asking.communicate()
    told = judged(said)
    status, _, named = told.pop("pot-2")
    assert status in (3, 4), complained
    assert "discovery-server-missing" not in named  # what was not seen is not called missing
    assert told == {name: (0, None, []) for name in ("pot-1", "pot-3", "pot-4")}
    assert asking.returncode == status
