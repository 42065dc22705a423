"""Captured facts under all network checks: each fault is the only root cause, and healthy machines have none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.checks import Severity
from lupin_cli.facts.addresses import Address, Addresses
from lupin_cli.facts.dds_profiles import Server
from lupin_cli.facts.shared_memory import SHARED_MEMORY, SharedFile
from lupin_cli.facts.sockets import Socket, Sockets
from tests.support.optional import present

if TYPE_CHECKING:
    from tests.lupin_cli.checks.conftest import Machines

WRONG_PREFIX = "44.53.01.5f.45.50.52.4f.53.49.4d.41"


def without_port(port: int) -> Callable[[Sockets], Sockets]:
    return lambda sockets: Sockets(tuple(each for each in sockets.entries if each.port != port))


def with_socket(**fields: Any) -> Callable[[Sockets], Sockets]:
    return lambda sockets: Sockets((*sockets.entries, Socket(**fields)))


def changed(index: int, **fields: Any) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """Return a function that changes one element of a tuple."""
    return lambda values: tuple(replace(each, **fields) if at == index else each for at, each in enumerate(values))


def own_profile(**fields: Any) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    return lambda profiles: tuple(replace(each, **fields) if "/.config/" in each.path else each for each in profiles)


def test_healthy_machines_have_no_findings(healthy: Machines) -> None:
    assert healthy.root_findings() == []


def test_laptop_without_robot_has_no_findings(healthy: Machines) -> None:
    assert replace(healthy, robot=None, link=None).root_findings() == []


# -- the discovery server -----------------------------------------------------------------------------------------------


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


# -- processes and shells -------------------------------------------------------------------------------------------------


def test_multicast_process_is_named_with_its_environment(healthy: Machines, capture: Callable[..., Any]) -> None:
    faulty = healthy.with_laptop("ros-processes", lambda _: capture("ros-processes", "laptop-with-a-multicast-node"))
    (finding,) = faulty.root_findings()
    assert finding.id == "process-multicast-only"
    assert "plain_talker" in finding.cause
    assert finding.evidence[0].startswith("/proc/")
    assert "ROS_DISCOVERY_SERVER= " in finding.evidence[0]
    assert ":7400 " in finding.evidence[1]


def test_loopback_multicast_is_no_fault(healthy: Machines, capture: Callable[..., Any]) -> None:
    faulty = healthy.with_laptop("ros-processes", lambda _: capture("ros-processes", "laptop-with-a-multicast-node"))
    private = faulty.with_laptop(
        "sockets",
        lambda s: Sockets(tuple(replace(each, address="127.0.0.1") if each.port == 7400 else each for each in s.entries)),
    )
    assert private.root_ids() == []


def test_without_robot_multicast_node_needs_a_client_beside_it(healthy: Machines, capture: Callable[..., Any]) -> None:
    alone = replace(healthy, robot=None, link=None)
    both = alone.with_laptop("ros-processes", lambda _: capture("ros-processes", "laptop-with-a-multicast-node"))
    assert both.root_ids() == ["process-multicast-only"]
    only = both.with_laptop("ros-processes", lambda ps: tuple(p for p in ps if not p.server))
    assert only.root_ids() == []


@pytest.mark.parametrize(
    ("server", "why"),
    [
        ("10.42.0.9:11811", "no such address"),
        ("127.0.0.1:11811", "the laptop"),
    ],
)
def test_process_with_wrong_server_is_named(healthy: Machines, server: str, why: str) -> None:
    def elsewhere(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(replace(p, environment={"ROS_DISCOVERY_SERVER": server}) for p in processes)

    (finding,) = healthy.with_laptop("ros-processes", elsewhere).root_findings()
    assert finding.id == "process-wrong-server"
    assert why in finding.cause


def test_wrong_server_is_named_while_robot_is_unreachable(healthy: Machines) -> None:
    def asking(server: str) -> Any:
        return healthy.unreachable("timeout").with_laptop(
            "ros-processes", changed(0, environment={"ROS_DISCOVERY_SERVER": server})
        )

    assert asking("10.42.0.1:11811").root_ids() == ["robot-unreachable"]
    found = {finding.id: finding for finding in asking("10.42.0.9:11811").root_findings()}
    assert sorted(found) == ["process-wrong-server", "robot-unreachable"]
    assert "the laptop knows the robot by 10.42.0.1" in found["process-wrong-server"].cause


def test_process_on_another_middleware_is_named(healthy: Machines) -> None:
    libraries = frozenset({"librmw_cyclonedds_cpp.so", "libddsc.so", "librcl.so"})
    (finding,) = healthy.with_laptop("ros-processes", changed(0, libraries=libraries)).root_findings()
    assert finding.id == "rmw-mismatch"
    assert "rmw_cyclonedds_cpp" in finding.cause


def test_shell_older_than_the_setup_is_named(healthy: Machines) -> None:
    (finding,) = healthy.with_laptop("shell", lambda s: replace(s, environment={})).root_findings()
    assert finding.id == "shell-multicast-only"
    assert finding.fix.command == "source /home/operator/.config/lupin/ros-env.sh"
    assert "ROS_DISCOVERY_SERVER=" in finding.evidence


def test_missing_setup_is_named_only_with_a_robot(healthy: Machines) -> None:
    faulty = healthy.with_laptop("shell", lambda s: replace(s, environment={}, exports={}, start_files=()))
    assert faulty.root_ids() == ["dds-not-set-up"]
    assert replace(faulty, robot=None, link=None).root_ids() == []


def test_removed_setup_explains_only_its_own_profile(healthy: Machines) -> None:
    gone = own_profile(error="the file is missing or not readable")
    faulty = healthy.with_laptop("shell", lambda s: replace(s, environment={}, exports={}, start_files=()))
    assert faulty.with_laptop("dds-profiles", gone).root_ids() == ["dds-not-set-up"]

    def naming(path: str) -> Any:
        environment = {"ROS_DISCOVERY_SERVER": "10.42.0.1:11811", "FASTRTPS_DEFAULT_PROFILES_FILE": path}
        return faulty.with_laptop("ros-processes", lambda ps: (*ps, replace(ps[0], pid=99, environment=environment)))

    own = "/home/operator/.config/lupin/fastdds_super_client.xml"
    assert naming(own).with_laptop("dds-profiles", gone).root_ids() == ["dds-not-set-up"]
    lost = naming("/old.xml").with_laptop("dds-profiles", lambda ps: (replace(ps[0], path="/old.xml", error="no file"),))
    assert sorted(lost.root_ids()) == ["dds-not-set-up", "profile-unreadable"]


def test_wrong_source_order_shows_both_lines(healthy: Machines) -> None:
    (finding,) = healthy.with_laptop("shell", "wiped").root_findings()
    assert finding.id == "source-order"
    assert finding.evidence[0] == '/home/operator/.bashrc:2:. "$HOME/.config/lupin/ros-env.sh"'
    assert finding.evidence[1] == "/home/operator/.bashrc:3:source $HOME/mirte_ws/install/setup.bash"
    assert finding.evidence[2].endswith("/environment/fastdds.sh")


def test_later_source_without_unset_hook_is_no_fault(healthy: Machines) -> None:
    def harmless(shell: Any) -> Any:
        starts = tuple(replace(start, wipes={}) for start in shell.start_files)
        return replace(shell, start_files=starts)

    faulty = healthy.with_laptop("shell", "wiped").with_laptop("shell", harmless)
    assert faulty.root_ids() == ["shell-multicast-only"]


def test_shell_with_another_middleware_is_named(healthy: Machines) -> None:
    environment = {"ROS_DISCOVERY_SERVER": "10.42.0.1:11811", "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}
    assert healthy.with_laptop("shell", lambda s: replace(s, environment=environment)).root_ids() == ["shell-rmw-mismatch"]


def test_daemon_older_than_the_setup_is_named(healthy: Machines) -> None:
    def daemon(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        arguments = ("/usr/bin/python3", "-c", "from ros2cli.daemon.daemonize import main; main()", "--name", "ros2-daemon")
        return (*processes, replace(processes[0], pid=99, arguments=arguments, environment={}, parent=1))

    (finding,) = healthy.with_laptop("ros-processes", daemon).root_findings()
    assert (finding.id, finding.fix.command) == ("stale-daemon", "ros2 daemon stop")


# -- profiles -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        ({"default": False}, "profile-not-default"),
        ({"protocol": "CLIENT"}, "profile-not-super-client"),
        ({"servers": (Server(WRONG_PREFIX, "10.42.0.1", 11811),)}, "profile-wrong-prefix"),
        ({"servers": (Server("44.53.00.5f.45.50.52.4f.53.49.4d.41", "192.168.42.1", 11811),)}, "profile-wrong-address"),
        ({"servers": ()}, "profile-without-server"),
        ({"error": "the file is missing or not readable"}, "profile-unreadable"),
    ],
)
def test_each_profile_fault_is_named(healthy: Machines, fault: dict[str, Any], name: str) -> None:
    (finding,) = healthy.with_laptop("dds-profiles", own_profile(**fault)).root_findings()
    assert finding.id == name
    assert "fastdds_super_client.xml" in finding.cause
    assert finding.fix.command == "lupin dds setup 10.42.0.1"


def test_profile_is_compared_with_the_shells_server(healthy: Machines) -> None:
    def stale(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        home = "/home/operator/.config/lupin/fastdds_super_client.xml"
        environment = {"ROS_DISCOVERY_SERVER": "192.168.42.1:11811", "FASTRTPS_DEFAULT_PROFILES_FILE": home}
        return (*processes, replace(processes[0], pid=99, environment=environment))

    faulty = healthy.with_laptop("ros-processes", stale)
    assert "profile-wrong-address" not in faulty.root_ids()
    elsewhere = own_profile(servers=(Server("44.53.00.5f.45.50.52.4f.53.49.4d.41", "192.168.42.1", 11811),))
    found = faulty.with_laptop("dds-profiles", elsewhere).root_findings()
    (finding,) = (finding for finding in found if finding.id == "profile-wrong-address")
    assert finding.fix.command == "lupin dds setup 10.42.0.1"


def test_unused_faulty_profile_is_ignored(healthy: Machines) -> None:
    stray = healthy.with_laptop("dds-profiles", lambda ps: (*ps, replace(ps[0], path="/old.xml", default=False)))
    assert stray.root_ids() == []


# -- the link -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["no-route", "timeout", "refused", "silent", "name", "lost", "host-key-changed"])
def test_unreachable_robot_is_explained_by_failure_kind(healthy: Machines, kind: str) -> None:
    (finding,) = healthy.unreachable(kind).root_findings()
    assert finding.id == "robot-unreachable"
    assert f"({kind})" in finding.cause
    assert finding.evidence[0] == f"mirte@10.42.0.1: {kind}"


def test_roamed_wifi_explains_unreachable_robot(healthy: Machines) -> None:
    faulty = healthy.unreachable("no-route").with_laptop("routes", "roamed").with_laptop("addresses", "roamed")
    (finding,) = faulty.with_laptop("network-manager", "roamed-to-eduroam").root_findings()
    assert finding.id == "wifi-roamed"
    assert finding.fix.command == "nmcli connection up Mirte-247264"
    assert any("eduroam" in line for line in finding.evidence)


def test_unplugged_cable_explains_unreachable_robot(healthy: Machines) -> None:
    faulty = healthy.unreachable("no-route").with_laptop("routes", "cable-out").with_laptop("addresses", "cable-out")
    (finding,) = faulty.root_findings()
    assert finding.id == "no-carrier"
    assert "lan0 NO-CARRIER 10.42.0.2/24" in finding.evidence


def test_equal_wifi_priorities_warn_only_over_radio(healthy: Machines) -> None:
    def by_radio(routes: Any) -> Any:
        return replace(routes, wireless=frozenset({"wifi0"}))

    faulty = healthy.with_laptop("network-manager", "equal-priorities")
    assert faulty.root_ids() == []  # the cable carries the link
    at_the_access_point = replace(faulty, link=replace(present(faulty.link), address="192.168.42.1"))
    (finding,) = at_the_access_point.with_laptop("routes", by_radio).root_findings()
    assert (finding.id, finding.severity) == ("wifi-may-roam", Severity.WARNING)
    assert "connection.autoconnect-priority 100" in finding.fix.command
    pinned = at_the_access_point.with_laptop("network-manager", "on-the-access-point")
    assert pinned.with_laptop("routes", by_radio).root_ids() == []


# -- addresses ------------------------------------------------------------------------------------------------------------


def without_access_point(routes: Any) -> Any:
    return replace(routes, main=tuple(route for route in routes.main if not route.destination.startswith("192.168.42.")))


def test_dual_homed_robot_with_unroutable_address_is_named(healthy: Machines) -> None:
    (finding,) = healthy.with_laptop("routes", without_access_point).root_findings()
    assert finding.id == "robot-multi-homed"
    assert "192.168.42.1" in finding.cause
    assert "robot: wlan0 UP 192.168.42.1/24" in finding.evidence
    assert finding.fix.playbook == "single-home"
    assert not finding.fix.safe


def test_default_route_does_not_lead_to_the_access_point(healthy: Machines) -> None:
    def internet(routes: Any) -> Any:
        default = replace(routes.main[0], destination="default", gateway="10.128.0.1", device="wifi1")
        return replace(without_access_point(routes), main=(*without_access_point(routes).main, default))

    assert healthy.with_laptop("routes", internet).root_ids() == ["robot-multi-homed"]


def test_dual_homed_robot_with_whitelist_is_healthy(healthy: Machines) -> None:
    faulty = healthy.with_laptop("routes", without_access_point)
    whitelisted = faulty.with_robot("dds-profiles", lambda ps: tuple(replace(p, whitelist=("10.42.0.1",)) for p in ps))
    assert whitelisted.root_ids() == []


def test_address_without_carrier_is_not_announced(healthy: Machines) -> None:
    def ap_down(addresses: Addresses) -> Addresses:
        return Addresses(tuple(replace(a, carrier=False) if a.interface == "wlan0" else a for a in addresses.entries))

    faulty = healthy.with_laptop("routes", without_access_point)
    assert faulty.with_robot("addresses", ap_down).root_ids() == []


def test_process_older_than_address_is_named_on_both_machines(healthy: Machines) -> None:
    def unaware(address: str) -> Callable[[Sockets], Sockets]:
        return lambda sockets: Sockets(tuple(each for each in sockets.entries if each.address != address))

    (robot,) = healthy.with_robot("sockets", unaware("10.42.0.1")).root_findings()
    assert (robot.id, robot.where) == ("process-older-than-interface", "robot")
    assert "telemetrix" in robot.cause
    (laptop,) = healthy.with_laptop("sockets", unaware("10.42.0.2")).root_findings()
    assert (laptop.id, laptop.where) == ("process-older-than-interface", "laptop")
    assert "slam_toolbox" in laptop.cause


def test_newer_address_off_the_link_is_ignored(healthy: Machines) -> None:
    newer = Address("docker0", "172.17.0.1", 16, "global", up=True, carrier=False)
    assert healthy.with_robot("addresses", lambda a: Addresses((*a.entries, newer))).root_ids() == []


# -- stale resources ----------------------------------------------------------------------------------------------------


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
    assert healthy.with_robot("ros-processes", stopped).root_ids() == ["zombie-process"]


def test_unit_process_without_parent_is_not_stale(healthy: Machines) -> None:
    unit = changed(1, parent=1, group="/system.slice/mirte-ros.service")
    assert healthy.with_robot("ros-processes", unit).root_ids() == []
    assert healthy.with_robot("ros-processes", changed(1, parent=1, group="/user.slice/session-3.scope")).root_ids() == [
        "zombie-process"
    ]


@pytest.mark.parametrize("difference", [{"user_id": 1001}, {"shared_memory": "99"}])
def test_processes_that_cannot_share_memory_are_named(healthy: Machines, difference: dict[str, Any]) -> None:
    (finding,) = healthy.with_robot("ros-processes", changed(1, **difference)).root_findings()
    assert finding.id == "shared-memory-not-shared"
    assert "FASTDDS_BUILTIN_TRANSPORTS=UDPv4" in finding.fix.command


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


# -- ports ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("protocol", "port", "stranger", "owner"),
    [
        ("tcp", 8090, "node vite", "/usr/bin/python -m lupin_runtime.stack.process console.json"),
        ("tcp", 9090, "python rosbridge_websocket", "/opt/lupin/bin/lupin up"),
        ("udp", 123, "ntpd", "/usr/sbin/chronyd -F 1"),
    ],
)
def test_port_is_named_unless_its_owner_holds_it(
    healthy: Machines, protocol: str, port: int, stranger: str, owner: str
) -> None:
    def held(command: str, pid: int = 4242) -> list[str]:
        name = command.split()[0].rsplit("/", 1)[-1][:15]  # the kernel truncates it
        socket = with_socket(protocol=protocol, address="0.0.0.0", port=port, process=name, pid=pid, command=command)
        return healthy.with_laptop("sockets", socket).root_ids()

    assert held(stranger) == [f"port-{port}-taken"]
    assert held(owner) == []


def test_port_with_invisible_owner_is_ignored(healthy: Machines) -> None:
    unseen = with_socket(protocol="udp", address="0.0.0.0", port=123)
    assert healthy.with_laptop("sockets", unseen).root_ids() == []


# -- two at a time --------------------------------------------------------------------------------------------------------


def with_other_middleware(machines: Any) -> Any:
    """Add a process to the robot that uses another middleware."""

    def more(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        libraries = frozenset({"librmw_cyclonedds_cpp.so", "librcl.so"})
        return (*processes, replace(processes[1], pid=500, libraries=libraries))

    return machines.with_robot("ros-processes", more)


def with_orphans(machines: Any) -> Any:
    """Add shared memory of two killed participants."""

    def more(files: tuple[Any, ...]) -> tuple[Any, ...]:
        names = ("fastrtps_00aa", "fastrtps_00aa_el", "fastrtps_00bb", "fastrtps_00bb_el")
        return (*files, *(replace(files[0], name=name, held=False, holder=0) for name in names))

    return machines.with_robot("shared-memory", more)


FAULTS: dict[str, Callable[[Any], Any]] = {
    "discovery-server-missing": lambda machines: machines.with_robot("sockets", without_port(11811)),
    "robot-multi-homed": lambda machines: machines.with_laptop("routes", without_access_point),
    "zombie-process": lambda machines: machines.with_robot("ros-processes", changed(1, state="T")),
    "shared-memory-orphans": with_orphans,
    "rmw-mismatch": with_other_middleware,
    "profile-not-default": lambda machines: machines.with_laptop("dds-profiles", own_profile(default=False)),
    "source-order": lambda machines: machines.with_laptop("shell", "wiped"),
    "port-9090-taken": lambda machines: machines.with_laptop(
        "sockets", with_socket(protocol="tcp", address="0.0.0.0", port=9090, process="node", pid=9, command="node x")
    ),
    "process-older-than-interface": lambda machines: machines.with_laptop(
        "sockets", lambda s: Sockets(tuple(each for each in s.entries if each.address != "10.42.0.2"))
    ),
}


@pytest.mark.parametrize("pair", [(a, b) for a in FAULTS for b in FAULTS if a < b], ids="+".join)
def test_two_faults_are_named_and_no_third(healthy: Machines, pair: tuple[str, str]) -> None:
    faulty = healthy
    for name in pair:
        faulty = FAULTS[name](faulty)
    assert sorted(faulty.root_ids()) == sorted(pair)
