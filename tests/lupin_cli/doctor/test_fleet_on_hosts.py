"""Several booted robots under one `lupin doctor --all`: a fault of one appears in its report only and delays no other."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.checks.discovery import STARTING_S
from lupin_sim.host.checkout import keep_shared_memory
from lupin_sim.host.fixtures import wait_for_discovery_server
from lupin_sim.host.host import PROJECT
from tests.support.laptop import Laptop, killed_after, vendor_age_s
from tests.support.waiting import wait_until

if TYPE_CHECKING:
    from lupin_sim.host import Host

pytestmark = pytest.mark.host

TIMEOUT_S = 60.0
DOCTOR = [sys.executable, "-m", "lupin_cli.app", "doctor", "--all", "--json", "--only", "link.*", "--only", "discovery.*"]


@pytest.fixture
def fleet(boot_host: Callable[..., Host], tmp_path: Path) -> Laptop:
    """Return a laptop whose inventory has four robots with running discovery servers, pot-1 to pot-4."""
    laptop = Laptop(boot_host(robots=4), tmp_path / "home")
    laptop.configure()
    rows = [f'[robots.pot-{n}]\nuser = "mirte"\naddresses.wired = "{r.eth0}"' for n, r in enumerate(laptop.host.robots, 1)]
    (laptop.config_dir / "lupin.toml").write_text("\n".join(rows))
    for robot in laptop.host.robots:
        wait_for_discovery_server(robot)
        keep_shared_memory(robot)
        wait_until(
            lambda robot=robot: vendor_age_s(laptop.host, robot) > STARTING_S,  # type: ignore[misc]
            "a vendor stack that is past its start",
            30.0,
        )
    return laptop


def results(stdout: str) -> dict[str, tuple[int, str | None, list[str]]]:
    """Return each robot's status, its kind of connection failure and its root causes, by the robot's name."""
    return {
        report["robot"]["name"]: (
            report["status"],
            report["robot"]["unreachable"],
            [finding["id"] for finding in report["findings"]],
        )
        for report in json.loads(stdout)["robots"]
    }


def test_fleet_robots_are_diagnosed_independently(fleet: Laptop) -> None:
    _, killed, hung, slow = fleet.host.robots
    killed.inject_fault("server-killed")
    hung.inject_fault("sshd-hung")
    slow.inject_fault("slow-link", delay_ms=150.0, jitter_ms=20.0)
    done = fleet.host.run(DOCTOR, env=fleet.sourced_env, cwd=str(PROJECT), timeout_s=TIMEOUT_S)
    report = results(done.stdout)
    assert report == {
        "pot-1": (0, None, []),
        "pot-2": (1, None, ["discovery-server-missing"]),
        "pot-3": (3, "silent", ["robot-unreachable"]),
        "pot-4": (0, None, []),
    }
    assert done.returncode == 3


def test_cable_cut_after_login_affects_only_that_robot(fleet: Laptop) -> None:
    cut = fleet.host.robots[1]
    cut.inject_fault("slow-link", delay_ms=300.0, jitter_ms=0.0)  # leaves time to cut the cable between login and answers
    doctor_process: subprocess.Popen[Any] = fleet.host.popen(
        DOCTOR, env=fleet.sourced_env, cwd=str(PROJECT), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with killed_after(doctor_process, TIMEOUT_S):
        wait_until(
            lambda: "Accepted publickey" in cut.run_as_root("journalctl", "-q", "-o", "cat", "-u", "ssh").stdout,
            "the login",
        )
        cut.inject_fault("cable-cut", link="eth0")
        stdout, stderr = doctor_process.communicate()
    report = results(stdout)
    status, _, named = report.pop("pot-2")
    assert status in (3, 4), stderr
    assert "discovery-server-missing" not in named  # it was not examined, so it must not be called missing
    assert report == {name: (0, None, []) for name in ("pot-1", "pot-3", "pot-4")}
    assert doctor_process.returncode == status
