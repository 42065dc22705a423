"""The commands that findings print: they act on the right machine, change no more than they must, and are no prose."""

from __future__ import annotations

import shlex
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lupin_cli.checks.remote_command import command_on, remove_assignments, restart_processes, service_of
from lupin_cli.facts.dds_profiles import SERVER_PREFIX, Server
from lupin_cli.facts.units import Unit
from tests.lupin_cli.checks.conftest import Machines
from tests.support.findings import mistake_in_line
from tests.support.snapshots import captured

VENDOR_GROUP = "0::/system.slice/mirte-ros.service"


@pytest.mark.parametrize(
    ("line", "mistake"),
    [
        ("lupin transport --robot x", "needs a command"),
        ("lupin doctor --nope", "No such option"),
        ("ssh mirte@robot 'sudo kill 5'", "needs a terminal"),
        ("charge the battery", "no known program"),
        ("lupin dds setup 10.42.0.1; then start it again", "syntax error"),
        ("echo 'a", "unexpected EOF"),
        ("lupin sweep --local && ssh -t mirte@robot 'sudo kill 5 && sudo systemctl daemon-reload'", ""),
    ],
)
def test_prose_and_unknown_options_are_no_command(line: str, mistake: str) -> None:
    found = mistake_in_line(line)
    assert mistake in found and bool(mistake) == bool(found)


def test_robot_command_gets_a_terminal_only_for_sudo(healthy: Machines) -> None:
    snapshot = healthy.snapshot
    assert command_on(snapshot, "robot", "kill 5") == "ssh 10.42.0.1 'kill 5'"
    assert command_on(snapshot, "robot", "sudo kill 5") == "ssh -t 10.42.0.1 'sudo kill 5'"
    assert command_on(snapshot, "laptop", "sudo kill 5") == "sudo kill 5"


@pytest.mark.parametrize(
    ("line", "left"),
    [
        ("Environment=ROS_DOMAIN_ID=7", ""),
        ('Environment="ROS_DOMAIN_ID=7"', ""),
        ("Environment=A=1 ROS_DOMAIN_ID=7 B=2", "Environment=A=1  B=2\n"),
        ("Environment='ROS_DOMAIN_ID=7' \"B=two words\"", 'Environment= "B=two words"\n'),
        ("Environment=OLD_ROS_DOMAIN_ID=7", "Environment=OLD_ROS_DOMAIN_ID=7\n"),
        ("ExecStart=/bin/env ROS_DOMAIN_ID=7 true", "ExecStart=/bin/env ROS_DOMAIN_ID=7 true\n"),
    ],
)
def test_only_the_assignment_is_removed(healthy: Machines, tmp_path: Path, line: str, left: str) -> None:
    file = tmp_path / "90-local.conf"
    file.write_text(f"[Service]\n{line}\n")
    unit: Unit = captured("units", "healthy").get("mirte-ros.service")
    setting = replace(unit, environment={"ROS_DOMAIN_ID": "7"}, assignments={str(file): {"ROS_DOMAIN_ID": "7"}})
    words = shlex.split(remove_assignments(healthy.snapshot, setting, ["ROS_DOMAIN_ID"])["command"])
    edit = words[-1].split(" && ")[0].removeprefix("sudo ")
    subprocess.run(["bash", "-c", edit], check=True)
    assert file.read_text() == f"[Service]\n{left}"


def test_service_is_restarted_and_program_of_a_person_ended(healthy: Machines) -> None:
    processes = captured("ros-processes", "healthy-robot")
    of_vendor = replace(processes[0], group=VENDOR_GROUP)
    by_hand = replace(processes[0], pid=77, user_id=0, group="0::/user.slice/user-1000.slice/session-3.scope")
    assert [service_of(each) for each in (of_vendor, by_hand)] == ["mirte-ros.service", ""]
    fix = restart_processes(healthy.snapshot, "robot", [of_vendor])
    assert fix == {"command": "ssh -t 10.42.0.1 'sudo systemctl restart mirte-ros.service'"}
    fix = restart_processes(healthy.snapshot, "robot", [of_vendor, by_hand])
    assert fix["command"] == "ssh -t 10.42.0.1 'sudo kill 77 && sudo systemctl restart mirte-ros.service'"
    assert "then start it again in a new terminal" in fix["instruction"]
    assert restart_processes(healthy.snapshot, "laptop", [by_hand])["command"] == "kill 77"


@pytest.mark.parametrize("in_unit_file", [True, False])
def test_robot_unit_with_wrong_server_is_one_finding(healthy: Machines, in_unit_file: bool) -> None:
    server = "10.42.0.77:11811"

    def asking(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        environment = {"ROS_DISCOVERY_SERVER": server}
        return tuple(replace(each, group=VENDOR_GROUP, environment={**each.environment, **environment}) for each in processes)

    def setting(units: Any) -> Any:
        variables = {"ROS_DISCOVERY_SERVER": server}
        changed = {"environment": variables, "assignments": {"/etc/systemd/system/mirte-ros.service": variables}}
        return replace(units, units=tuple(replace(u, **changed) if u.name == "mirte-ros.service" else u for u in units.units))

    faulty = healthy.with_robot("ros-processes", asking)
    if in_unit_file:
        faulty = faulty.with_robot("units", setting)
    found = [finding for finding in faulty.root_findings() if finding.id == "process-wrong-server"]
    assert [finding.where for finding in found] == ["robot"]
    command = found[0].fix.command
    assert command.startswith("ssh -t 10.42.0.1 ") and "systemctl restart mirte-ros.service" in command
    assert ("sed -i" in command) == in_unit_file and "lupin dds setup" not in command


@pytest.mark.parametrize("server", ["10.42.0.77:11811", "10.42.0.1:11812"])
def test_wrong_server_of_the_shell_does_not_blame_the_profile(healthy: Machines, server: str) -> None:
    def asking(shell: Any) -> Any:
        variables = {**shell.exports, "ROS_DISCOVERY_SERVER": server}
        return replace(shell, exports=variables, environment={**shell.environment, "ROS_DISCOVERY_SERVER": server})

    (finding,) = healthy.with_laptop("shell", asking).root_findings()
    assert finding.id == "shell-wrong-server"
    assert finding.fix.command.startswith("lupin dds setup 10.42.0.1 && source ")


def test_wrong_profile_is_set_up_for_the_robot_address(healthy: Machines) -> None:
    def elsewhere(profiles: Any) -> Any:
        return tuple(replace(each, servers=(Server(SERVER_PREFIX, "10.42.0.77", 11811),)) for each in profiles)

    (finding,) = healthy.with_laptop("dds-profiles", elsewhere).root_findings()
    assert (finding.id, finding.fix.command) == ("profile-wrong-address", "lupin dds setup 10.42.0.1")
