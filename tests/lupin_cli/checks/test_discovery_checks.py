"""Checks of the discovery server; healthy machines have no findings. Captured facts: each fault is the only root cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.facts.sockets import Sockets
from tests.support.changed_facts import changed, own_profile, with_socket, without_port

if TYPE_CHECKING:
    from tests.lupin_cli.checks.conftest import Machines


def test_healthy_machines_have_no_findings(healthy: Machines) -> None:
    assert healthy.root_findings() == []


def test_laptop_without_robot_has_no_findings(healthy: Machines) -> None:
    assert replace(healthy, robot=None, link=None).root_findings() == []


@pytest.mark.parametrize(
    ("log", "word"),
    [
        ("lost-the-race", "wlan0 came up late"),
        ("tool-not-found", "PATH was incomplete"),
        ("server-came-up", "has exited, or was never started"),
    ],
)
def test_missing_discovery_server_shows_the_journals_reason(healthy: Machines, log: str, word: str) -> None:
    (finding,) = healthy.with_robot("sockets", without_port(11811)).with_robot("discovery-log", log).root_findings()
    assert finding.id == "discovery-server-missing"
    assert word in finding.cause
    assert finding.fix.playbook == "recover-discovery"
    assert finding.fix.safe
    assert any("ROS_DISCOVERY_SERVER=127.0.0.1:11811" in line for line in finding.evidence)
    # It finds the server's program in /opt/ros, which is not in the PATH of a shell that ssh starts.
    assert finding.fix.command == "lupin play recover-discovery --robot mirte"


def test_starting_discovery_server_is_not_missing(healthy: Machines) -> None:
    faulty = healthy.with_robot("sockets", without_port(11811))
    assert faulty.with_robot("discovery-log", lambda log: replace(log, vendor_age_s=1.2)).root_ids() == []
    assert faulty.with_robot("ros-processes", changed(0, age_s=0.4)).root_ids() == []
    lost = faulty.with_robot("discovery-log", "lost-the-race")
    assert lost.with_robot("discovery-log", lambda log: replace(log, vendor_age_s=1.2)).root_ids() == [
        "discovery-server-missing"
    ]


def test_lost_start_race_has_journal_lines_as_evidence(healthy: Machines) -> None:
    (finding,) = healthy.with_robot("sockets", without_port(11811)).with_robot("discovery-log", "lost-the-race").root_findings()
    assert "wasn't able to allocate the specified listening port" in finding.evidence[0]


def test_incomplete_path_explains_only_the_robots_profile(healthy: Machines) -> None:
    lost = healthy.with_robot("sockets", without_port(11811)).with_robot("discovery-log", "tool-not-found")
    error = "the file is missing or not readable"
    unread = lost.with_robot("dds-profiles", lambda profiles: tuple(replace(each, error=error) for each in profiles))
    assert unread.root_ids() == ["discovery-server-missing"]
    assert unread.with_robot("discovery-log", "lost-the-race").root_ids() == [
        "discovery-server-missing",
        "profile-unreadable",
    ]
    both = unread.with_laptop("dds-profiles", own_profile(error=error))
    assert both.root_ids() == ["discovery-server-missing", "profile-unreadable"]


def test_old_journal_lines_are_no_fault(healthy: Machines) -> None:
    assert healthy.with_robot("discovery-log", "lost-the-race").root_ids() == []


def test_stopped_vendor_service_needs_no_discovery_server(healthy: Machines) -> None:
    faulty = healthy.with_robot("sockets", without_port(11811)).with_robot("ros-processes", ())
    assert faulty.with_robot("discovery-log", "no-vendor").root_ids() == []


def test_pinned_server_is_named_by_socket_or_arguments(healthy: Machines) -> None:
    def pinned(**fields: Any) -> Callable[[Sockets], Sockets]:
        return lambda sockets: Sockets(
            tuple(replace(each, **fields) if each.port == 11811 else each for each in sockets.entries)
        )

    server = "fast-discovery-server -i 0 -l 192.168.42.1 -p 11811"
    for fields in ({"address": "192.168.42.1"}, {"command": server}):
        (finding,) = healthy.with_robot("sockets", pinned(**fields)).root_findings()
        assert finding.id == "discovery-server-pinned"
        assert "192.168.42.1" in finding.cause
        assert not finding.fix.safe


def test_missing_server_explains_units_that_find_nobody(healthy: Machines) -> None:
    def failing(units: Any) -> Any:
        states = {
            "lupin-onboard.service": {"active": "activating", "sub": "auto-restart"},
            "lupin-auto-home.service": {"active": "failed", "result": "start-limit-hit"},
        }
        return replace(units, units=tuple(replace(unit, **states.get(unit.name, {})) for unit in units.units))

    faulty = healthy.with_robot("units", failing)
    assert sorted(faulty.root_ids()) == ["oneshot-failed", "unit-restarting"]
    assert faulty.with_robot("sockets", without_port(11811)).root_ids() == ["discovery-server-missing"]


@pytest.mark.parametrize(
    "fields", [{"address": "192.168.42.1"}, {"command": "fast-discovery-server -i 3 -p 11811", "process": "fast-discovery-"}]
)
@pytest.mark.parametrize(
    ("pid", "uid", "script"),
    [
        (0, 1000, "sudo ss -lunp sport = :11811"),  # only root sees its owner
        (5, 1000, "sudo kill 5"),
        (5, 0, "kill 5"),
        (99, 0, "sudo kill 99"),
    ],
)
def test_owner_of_the_server_port_is_ended(healthy: Machines, fields: dict[str, str], pid: int, uid: int, script: str) -> None:
    def owned(sockets: Sockets) -> Sockets:
        return Sockets(
            tuple(replace(each, pid=pid, **fields) if each.port == 11811 else each for each in sockets.entries)  # type: ignore[arg-type]
        )

    faulty = healthy.with_robot("sockets", owned).with_robot("account", lambda account: replace(account, uid=uid))
    (finding,) = faulty.root_findings()
    recover = "lupin play recover-discovery --robot mirte"
    login = f"ssh{' -t' if 'sudo' in script else ''} 10.42.0.1 '{script}'"
    assert finding.fix.command == (f"{login} && {recover}" if pid else login)
    assert bool(pid) or finding.fix.instruction.endswith(recover)


def test_server_with_another_id_is_named(healthy: Machines) -> None:
    def numbered(command: str) -> Callable[[Sockets], Sockets]:
        return lambda sockets: Sockets(
            tuple(
                replace(each, command=command, process="fast-discovery-") if each.port == 11811 else each
                for each in sockets.entries
            )
        )

    (finding,) = healthy.with_robot("sockets", numbered("fast-discovery-server -i 3 -l 0.0.0.0 -p 11811")).root_findings()
    assert (finding.id, finding.layer, finding.where) == ("discovery-server-other-id", "discovery", "robot")
    assert "the id 3" in finding.cause
    assert healthy.with_robot("sockets", numbered("fast-discovery-server -i 0 -p 11811")).root_ids() == []


@pytest.mark.parametrize("value", ["True", "yes", "1", "false", ""])
def test_every_value_but_true_disables_the_server(healthy: Machines, value: str) -> None:
    faulty = healthy.with_robot("sockets", without_port(11811)).with_robot(
        "discovery-log", lambda log: replace(log, switch=value)
    )
    (finding,) = faulty.root_findings()
    assert finding.id == "discovery-server-switched-off"


def test_disabled_server_is_named_though_somebody_started_one(healthy: Machines) -> None:
    off = healthy.with_robot("discovery-log", "switched-off")
    assert off.root_ids() == []  # the robot's programs ask it
    silent = off.with_robot("ros-processes", lambda ps: tuple(p if p.is_server else replace(p, environment={}) for p in ps))
    assert silent.root_ids() == ["discovery-server-switched-off"]


def test_server_that_the_setting_names_is_no_cause_of_its_own(healthy: Machines) -> None:
    def asks(server: str) -> Machines:
        environment = {"ROS_DISCOVERY_SERVER": server}
        return (
            healthy.with_robot("sockets", without_port(11811))
            .with_robot("discovery-log", lambda log: replace(log, switch="1"))
            .with_robot("ros-processes", lambda ps: tuple(replace(p, environment=environment) for p in ps if not p.is_server))
        )

    assert asks("1").root_ids() == ["discovery-server-switched-off"]
    assert sorted(set(asks("10.9.9.9:11811").root_ids())) == ["discovery-server-switched-off", "process-wrong-server"]


def test_other_program_on_server_port_is_named(healthy: Machines) -> None:
    faulty = healthy.with_robot("sockets", without_port(11811)).with_robot(
        "sockets",
        with_socket(
            protocol="udp", address="0.0.0.0", port=11811, process="socat", pid=77, command="socat -u UDP-RECV:11811 -"
        ),
    )
    (finding,) = faulty.root_findings()
    assert finding.id == "discovery-port-taken"
    assert "socat" in finding.cause


def test_stopped_server_process_is_named(healthy: Machines) -> None:
    (finding,) = healthy.with_robot("ros-processes", changed(0, state="T")).root_findings()
    assert finding.id == "discovery-server-stopped"
    assert finding.fix.command.endswith("kill -CONT 5'")


def test_disabled_discovery_server_is_named(healthy: Machines) -> None:
    faulty = healthy.with_robot("sockets", without_port(11811)).with_robot("discovery-log", "switched-off")
    faulty = faulty.with_robot("ros-processes", lambda ps: tuple(replace(p, environment={}) for p in ps if not p.is_server))
    faulty = faulty.with_robot("sockets", with_socket(protocol="udp", address="0.0.0.0", port=7400, process="python", pid=8))
    assert faulty.root_ids() == ["discovery-server-switched-off"]
