"""Checks of what dead and stopped processes leave behind. Captured facts: each fault is the only root cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.checks import Finding, Severity
from lupin_cli.checks.ground_truth import CHECKS as GROUND_TRUTH
from lupin_cli.checks.path import CHECKS as PATH
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.addresses import Addresses
from lupin_cli.facts.graph import Graph, Graphs, ObservedTopic
from lupin_cli.facts.shared_memory import SHARED_MEMORY, SharedFile
from lupin_cli.link.path import End, Path
from tests.lupin_cli.checks.conftest import CHECKS
from tests.lupin_cli.checks.test_ground_truth import received
from tests.support.changed_facts import changed
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.lupin_cli.checks.conftest import Machines


def test_stale_process_is_named_with_its_ports(healthy: Machines) -> None:
    faulty = healthy
    for fact in ("ros-processes", "sockets", "dds-profiles"):
        faulty = faulty.with_robot(fact, "one-left-behind")
    (finding,) = faulty.root_findings()
    assert finding.id == "zombie-process"
    assert "left_behind" in finding.cause
    assert "its parent is gone" in finding.cause


def test_memory_of_killed_process_is_orphaned(healthy: Machines, capture: Callable[..., Any]) -> None:
    (finding,) = healthy.with_robot("shared-memory", "one-of-two-killed").root_findings()
    assert (finding.id, finding.severity) == ("shared-memory-orphans", Severity.WARNING)
    held = [each for each in capture("shared-memory", "one-of-two-killed") if each.held]
    assert held
    assert not any(each.name in line for each in held for line in finding.evidence)
    assert finding.fix.safe


def test_segments_of_live_processes_are_no_orphans(healthy: Machines) -> None:
    assert healthy.with_robot("shared-memory", lambda fs: tuple(replace(f, changed_s=0) for f in fs)).root_ids() == []


def test_files_without_lock_are_ignored(healthy: Machines) -> None:
    def bare(files: tuple[Any, ...]) -> tuple[Any, ...]:
        return (*files, replace(files[0], name="fastrtps_0123456789abcdef", lockable=False, held=False))

    assert healthy.with_robot("shared-memory", bare).root_ids() == []


def test_stopped_process_on_dds_ports_is_named(healthy: Machines) -> None:
    (finding,) = healthy.with_robot("ros-processes", changed(1, state="T")).root_findings()
    assert finding.id == "zombie-process"
    assert "Ctrl-Z" in finding.cause


def test_stopped_service_process_is_named(healthy: Machines) -> None:
    stopped = changed(1, state="T", parent=1, group="/system.slice/lupin-onboard.service")
    (finding,) = healthy.with_robot("ros-processes", stopped).root_findings()
    assert (finding.id, finding.fix.playbook, finding.layer) == ("process-stopped", "resume-process", "processes")
    assert finding.fix.command == f"lupin play resume-process --robot mirte -v pid={finding.fix.variables['pid']}"


def test_stopped_estop_is_resumed_without_asking(healthy: Machines) -> None:
    estop = ("python3", "-m", "lupin_runtime.stack.process", "/run/processes/estop.json")
    stopped = changed(1, state="T", parent=1, group="/system.slice/lupin-onboard.service", arguments=estop)
    (finding,) = healthy.with_robot("ros-processes", stopped).root_findings()
    assert finding.id == "process-stopped" and finding.fix.safe


@pytest.mark.parametrize("port", [11812, 11811])
def test_port_without_a_server_in_shell_and_profile_is_named(healthy: Machines, port: int) -> None:
    def with_port(shell: Any) -> Any:
        return replace(shell, environment={**shell.environment, "ROS_DISCOVERY_SERVER": f"10.42.0.1:{port}"})

    def profiles(found: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(replace(each, servers=tuple(replace(s, port=port) for s in each.servers)) for each in found)

    ids = healthy.with_laptop("shell", with_port).with_laptop("dds-profiles", profiles).root_ids()
    assert ("shell-wrong-server" in ids) == (port != 11811), ids


def test_lost_address_of_shell_is_the_only_root(healthy: Machines) -> None:
    hosts = {"wired": "10.42.0.1", "ap": "192.168.42.1"}
    server = (("ROS_DISCOVERY_SERVER", "192.168.42.1:11811"),)

    def set_up(shell: Any) -> Any:
        variables = {"ROS_DISCOVERY_SERVER": "192.168.42.1:11811"}
        return replace(shell, environment={**shell.environment, **variables}, exports={**shell.exports, **variables})

    def without_ap(addresses: Addresses) -> Addresses:
        return Addresses(tuple(each for each in addresses.entries if each.address != "192.168.42.1"))

    lost = replace(healthy, link=replace(present(healthy.link), addresses=hosts)).with_laptop("shell", set_up)
    lost = lost.with_laptop("routes", lambda routes: replace(routes, to_robot=dict.fromkeys(hosts.values(), ())))
    lost = lost.with_laptop("graph", Graphs((Graph("shell", "shell", server),))).with_robot("addresses", without_ap)
    path = Path("192.168.42.1", End("laptop", "wifi0", "192.168.42.7"), End("robot", error="Network is unreachable"))
    diagnosis = diagnose((*GROUND_TRUTH, *PATH, *CHECKS), replace(lost.snapshot, path=path))
    problems = [root.finding for root in diagnosis.roots if root.finding.severity is Severity.PROBLEM]
    assert [finding.id for finding in problems] == ["shell-wrong-server"]
    assert problems[0].fix.command.startswith("lupin dds setup 10.42.0.1")
    assert {"address-missing", "unexplained"} <= {finding.id for finding in diagnosis.findings}
    others = replace(lost, link=replace(present(lost.link), addresses={}))
    assert "shell-wrong-server" not in others.root_ids(), "it is the address of another robot that is examined too"


def test_data_from_a_second_address_is_a_sign_of_life(healthy: Machines) -> None:
    hosts = {"wired": "10.42.0.1", "ap": "192.168.42.1"}
    heard = received(environment=(("ROS_DISCOVERY_SERVER", "192.168.42.1:11811"),))
    machines = replace(healthy, link=replace(present(healthy.link), addresses=hosts)).unreachable("timeout")
    machines = machines.with_laptop("graph", Graphs((heard,)))
    machines = machines.with_laptop("routes", lambda routes: replace(routes, to_robot=dict.fromkeys(hosts.values(), ())))
    finding = next(each for each in machines.root_findings() if each.id == "robot-unreachable")
    assert "the robot's data arrives from 192.168.42.1, another of its addresses" in finding.cause
    assert finding.fix.command == "lupin transport show --robot mirte"


def test_unit_process_without_parent_is_not_stale(healthy: Machines) -> None:
    unit = changed(1, parent=1, group="/system.slice/mirte-ros.service")
    assert healthy.with_robot("ros-processes", unit).root_ids() == []
    assert healthy.with_robot("ros-processes", changed(1, parent=1, group="/user.slice/session-3.scope")).root_ids() == [
        "zombie-process"
    ]


SESSION = "/user.slice/user-1000.slice/session-3.scope"


@pytest.mark.parametrize(
    ("parent", "name", "is_stale"),
    [
        (1, "systemd", True),
        (1, "init", True),
        (1, "", True),  # hidden from this user
        (1873, "systemd", True),  # the user's own service manager, on a desktop
        (1, "bash", False),  # docker run -it ros:humble bash
        (1, "docker-init", False),
        (712, "containerd-shim", False),
        (712, "bash", False),
        (712, "", False),
    ],
)
def test_only_an_adopted_process_is_stale(healthy: Machines, parent: int, name: str, is_stale: bool) -> None:
    adopted = changed(1, parent=parent, parent_name=name, group=SESSION)
    assert healthy.with_robot("ros-processes", adopted).root_ids() == (["zombie-process"] if is_stale else [])


def test_adopted_process_that_is_ending_is_not_stale(healthy: Machines) -> None:
    """Its command line has gone with its memory, its sockets have not yet."""
    ending = changed(1, parent=1, parent_name="systemd", group=SESSION, arguments=())
    assert healthy.with_robot("ros-processes", ending).root_ids() == []


@pytest.mark.parametrize("difference", [{"user_id": 1001}, {"shared_memory": "99"}])
def test_processes_that_cannot_share_memory_are_named(healthy: Machines, difference: dict[str, Any]) -> None:
    (finding,) = healthy.with_robot("ros-processes", changed(1, **difference)).root_findings()
    assert finding.id == "shared-memory-not-shared"
    assert "FASTDDS_BUILTIN_TRANSPORTS=UDPv4" in finding.fix.instruction and "sudo kill 9'" in finding.fix.command


def test_udp_on_one_side_avoids_unshared_memory(healthy: Machines) -> None:
    def tuned(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        environment = {**processes[1].environment, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
        return changed(1, user_id=1001, environment=environment)(processes)

    assert healthy.with_robot("ros-processes", tuned).root_ids() == []


def strangers(user_id: int, port: int) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """Add the shared memory of another user's process, which is visible only by its files."""
    names = ("fastrtps_00000000deadbeef", f"fastrtps_port{port}")
    return lambda files: (*files, *(SharedFile(name, user_id, 1, 0, lockable=True, held=True, holder=4242) for name in names))


def test_unreadable_process_is_identified_by_its_memory_files(healthy: Machines) -> None:
    (finding,) = healthy.with_robot("shared-memory", strangers(1001, 7421)).root_findings()
    assert finding.id == "shared-memory-not-shared" and "process 4242 (user 1001)" in finding.cause
    assert healthy.with_robot("shared-memory", strangers(1001, 7671)).root_ids() == []  # domain 1
    assert healthy.with_robot("shared-memory", strangers(0, 7421)).root_ids() == []  # the same user, in what was captured


def test_stranger_on_the_laptop_is_judged_only_by_lost_samples(healthy: Machines) -> None:
    shared = healthy.with_laptop("shared-memory", strangers(1001, 7412))
    assert shared.root_ids() == []  # another person's own graph

    def observed(**fields: Any) -> list[Finding]:
        graph = Graph("sim", "sim", (), topics=(ObservedTopic("/scan", (), ()),), samples=(("/scan", 0),), **fields)
        return shared.with_laptop("graph", Graphs((graph,))).root_findings()

    assert observed() == observed(udp_heard=0) == []
    (finding,) = observed(udp_heard=4)
    assert (finding.id, finding.where) == ("shared-memory-not-shared", "laptop") and "names-no-samples" in finding.explains
    assert "process 4242 (user 1001)" in finding.cause
    # The process of the other person goes on.
    assert finding.fix.command == "kill 9" and "FASTDDS_BUILTIN_TRANSPORTS=UDPv4" in finding.fix.instruction


def test_no_process_of_two_users_of_a_laptop_is_ended(healthy: Machines) -> None:
    own = {file.holder for file in healthy.laptop["shared-memory"] if file.held}
    second = sorted(own)[1]
    both = healthy.with_laptop("ros-processes", lambda ps: (*ps, replace(ps[0], pid=second, user_id=1001)))
    (finding,) = (each for each in both.root_findings() if each.id == "shared-memory-not-shared")
    assert finding.fix.command == "" and "as the same user" in finding.fix.instruction


def test_memory_removed_by_logind_is_named_before_and_after(healthy: Machines) -> None:
    at_risk = healthy.with_robot("account", "loses-memory").with_robot("account", lambda who: replace(who, uid=0))
    (finding,) = at_risk.root_findings()
    assert (finding.id, finding.fix.playbook, finding.fix.safe) == ("shared-memory-at-risk", "keep-shared-memory", True)
    holder = next(file.holder for file in present(at_risk.snapshot.robot).get(SHARED_MEMORY) or () if file.held)
    gone = SharedFile("", -1, 0, 0, lockable=True, held=True, holder=holder, removed=True)
    (finding,) = at_risk.with_robot("shared-memory", lambda _files: (gone,)).root_findings()
    assert finding.id == "shared-memory-removed" and "when the last login of mirte ended" in finding.cause
    assert (finding.fix.variables, finding.fix.safe) == ({"restart": True}, False)


def test_removed_memory_of_the_doctors_visit_is_ignored(healthy: Machines) -> None:
    gone = SharedFile("", -1, 0, 0, lockable=True, held=True, holder=99, removed=True)

    def beside(*arguments: str) -> list[str]:
        own = healthy.with_laptop("ros-processes", lambda ps: (*ps, replace(ps[0], pid=99, arguments=arguments)))
        return own.with_laptop("shared-memory", lambda files: (*files, gone)).root_ids()

    assert beside("/usr/bin/python", "-m", "lupin_runtime.stack.graph_probe") == []
    assert beside("/usr/bin/python", "talker.py") == ["shared-memory-removed"]
