"""The triage tree of the link: each fault is named as the one cause, and a healthy pair of machines gives nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from lupin_cli.checks import Severity
from lupin_cli.facts.addresses import Address, Addresses
from lupin_cli.facts.dds_profiles import Server
from lupin_cli.facts.shared_memory import SHARED_MEMORY, SharedFile
from lupin_cli.facts.sockets import Socket, Sockets

WRONG_PREFIX = "44.53.01.5f.45.50.52.4f.53.49.4d.41"


def without_port(port: int) -> Callable[[Sockets], Sockets]:
    return lambda sockets: Sockets(tuple(each for each in sockets.every if each.port != port))


def with_socket(**fields: Any) -> Callable[[Sockets], Sockets]:
    return lambda sockets: Sockets((*sockets.every, Socket(**fields)))


def changed(index: int, **fields: Any) -> Callable[[tuple], tuple]:
    """The tuple with one element changed."""
    return lambda values: tuple(replace(each, **fields) if at == index else each for at, each in enumerate(values))


def own_profile(**fields: Any) -> Callable[[tuple], tuple]:
    return lambda profiles: tuple(replace(each, **fields) if "/.config/" in each.path else each for each in profiles)


def test_a_healthy_pair_of_machines_gives_nothing(healthy) -> None:
    assert healthy.roots() == []


def test_a_laptop_without_a_robot_gives_nothing(healthy) -> None:
    assert replace(healthy, robot=None, link=None).roots() == []


# -- the discovery server -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("log", "word"),
    [
        ("lost-the-race", "wlan0 came late"),
        ("tool-not-found", "PATH was not filled"),
        ("server-came-up", "has ended, or was never started"),
    ],
)
def test_a_missing_discovery_server_is_told_with_what_the_journal_says_of_it(healthy, log, word) -> None:
    (finding,) = healthy.with_("robot", "sockets", without_port(11811)).with_("robot", "discovery-log", log).roots()
    assert finding.id == "discovery-server-missing"
    assert word in finding.cause
    assert finding.fix.playbook == "recover-discovery"
    assert finding.fix.safe
    assert any("ROS_DISCOVERY_SERVER=127.0.0.1:11811" in line for line in finding.evidence)


def test_a_server_that_the_vendors_script_is_about_to_start_is_not_missed_yet(healthy) -> None:
    sick = healthy.with_("robot", "sockets", without_port(11811))
    assert sick.with_("robot", "discovery-log", lambda log: replace(log, vendor_age_s=1.2)).named() == []
    assert sick.with_("robot", "ros-processes", changed(0, age_s=0.4)).named() == []
    lost = sick.with_("robot", "discovery-log", "lost-the-race")
    assert lost.with_("robot", "discovery-log", lambda log: replace(log, vendor_age_s=1.2)).named() == [
        "discovery-server-missing"
    ]


def test_journal_lines_are_the_evidence_of_a_lost_race(healthy) -> None:
    (finding,) = healthy.with_("robot", "sockets", without_port(11811)).with_("robot", "discovery-log", "lost-the-race").roots()
    assert "wasn't able to allocate the specified listening port" in finding.evidence[0]


def test_an_incomplete_path_explains_the_robots_profile_too_and_not_the_laptops(healthy) -> None:
    lost = healthy.with_("robot", "sockets", without_port(11811)).with_("robot", "discovery-log", "tool-not-found")
    error = "there is no readable file"
    unread = lost.with_("robot", "dds-profiles", lambda profiles: tuple(replace(each, error=error) for each in profiles))
    assert unread.named() == ["discovery-server-missing"]
    assert unread.with_("robot", "discovery-log", "lost-the-race").named() == ["discovery-server-missing", "profile-unreadable"]
    both = unread.with_("laptop", "dds-profiles", own_profile(error=error))
    assert both.named() == ["discovery-server-missing", "profile-unreadable"]


def test_journal_lines_of_a_race_that_was_mended_since_are_no_fault(healthy) -> None:
    assert healthy.with_("robot", "discovery-log", "lost-the-race").named() == []


def test_a_stopped_vendor_service_without_nodes_misses_no_server(healthy) -> None:
    sick = healthy.with_("robot", "sockets", without_port(11811)).with_("robot", "ros-processes", ())
    assert sick.with_("robot", "discovery-log", "no-vendor").named() == []


def test_a_server_pinned_to_one_address_is_named_by_its_socket_or_its_arguments(healthy) -> None:
    def pinned(**fields: Any) -> Callable[[Sockets], Sockets]:
        return lambda sockets: Sockets(tuple(replace(each, **fields) if each.port == 11811 else each for each in sockets.every))

    server = "fast-discovery-server -i 0 -l 192.168.42.1 -p 11811"
    for fields in ({"address": "192.168.42.1"}, {"command": server}):
        (finding,) = healthy.with_("robot", "sockets", pinned(**fields)).roots()
        assert finding.id == "discovery-server-pinned"
        assert "192.168.42.1" in finding.cause
        assert not finding.fix.safe


def test_another_program_on_the_servers_port_is_named(healthy) -> None:
    sick = healthy.with_("robot", "sockets", without_port(11811)).with_(
        "robot",
        "sockets",
        with_socket(
            protocol="udp", address="0.0.0.0", port=11811, process="socat", pid=77, command="socat -u UDP-RECV:11811 -"
        ),
    )
    (finding,) = sick.roots()
    assert finding.id == "discovery-port-taken"
    assert "socat" in finding.cause


def test_a_server_that_is_stopped_holds_its_port_and_is_named(healthy) -> None:
    (finding,) = healthy.with_("robot", "ros-processes", changed(0, state="T")).roots()
    assert finding.id == "discovery-server-stopped"
    assert finding.fix.command.endswith("kill -CONT 5'")


def test_a_vendor_that_is_not_told_to_use_the_server_is_named(healthy) -> None:
    sick = healthy.with_("robot", "sockets", without_port(11811)).with_("robot", "discovery-log", "switched-off")
    sick = sick.with_("robot", "ros-processes", lambda ps: tuple(replace(p, environment={}) for p in ps if not p.is_server))
    sick = sick.with_("robot", "sockets", with_socket(protocol="udp", address="0.0.0.0", port=7400, process="python", pid=8))
    assert sick.named() == ["discovery-server-switched-off"]


# -- processes and shells -------------------------------------------------------------------------------------------------


def test_a_process_that_only_multicasts_is_named_by_its_node_with_its_own_environment(healthy, capture) -> None:
    sick = healthy.with_("laptop", "ros-processes", lambda _: capture("ros-processes", "laptop-with-a-multicast-node"))
    (finding,) = sick.roots()
    assert finding.id == "process-multicast-only"
    assert "plain_talker" in finding.cause
    assert finding.evidence[0].startswith("/proc/")
    assert "ROS_DISCOVERY_SERVER= " in finding.evidence[0]
    assert ":7400 " in finding.evidence[1]


def test_a_private_graph_on_loopback_is_no_dead_process(healthy, capture) -> None:
    sick = healthy.with_("laptop", "ros-processes", lambda _: capture("ros-processes", "laptop-with-a-multicast-node"))
    private = sick.with_(
        "laptop",
        "sockets",
        lambda s: Sockets(tuple(replace(each, address="127.0.0.1") if each.port == 7400 else each for each in s.every)),
    )
    assert private.named() == []


def test_without_a_robot_a_multicast_node_is_dead_only_beside_one_in_a_servers_graph(healthy, capture) -> None:
    alone = replace(healthy, robot=None, link=None)
    both = alone.with_("laptop", "ros-processes", lambda _: capture("ros-processes", "laptop-with-a-multicast-node"))
    assert both.named() == ["process-multicast-only"]
    only = both.with_("laptop", "ros-processes", lambda ps: tuple(p for p in ps if not p.server))
    assert only.named() == []


@pytest.mark.parametrize(
    ("server", "why"),
    [
        ("10.42.0.9:11811", "no such address"),
        ("127.0.0.1:11811", "this laptop"),
    ],
)
def test_a_process_that_asks_the_wrong_server_is_named(healthy, server, why) -> None:
    def elsewhere(processes: tuple) -> tuple:
        return tuple(replace(p, environment={"ROS_DISCOVERY_SERVER": server}) for p in processes)

    (finding,) = healthy.with_("laptop", "ros-processes", elsewhere).roots()
    assert finding.id == "process-wrong-server"
    assert why in finding.cause


def test_a_process_that_asks_a_server_where_no_robot_is_known_is_named_while_the_robot_is_away(healthy) -> None:
    def asking(server: str) -> Any:
        return healthy.unreachable("timeout").with_(
            "laptop", "ros-processes", changed(0, environment={"ROS_DISCOVERY_SERVER": server})
        )

    assert asking("10.42.0.1:11811").named() == ["robot-unreachable"]
    found = {finding.id: finding for finding in asking("10.42.0.9:11811").roots()}
    assert sorted(found) == ["process-wrong-server", "robot-unreachable"]
    assert "the robot is known here by 10.42.0.1" in found["process-wrong-server"].cause


def test_a_process_on_another_middleware_is_named(healthy) -> None:
    libraries = frozenset({"librmw_cyclonedds_cpp.so", "libddsc.so", "librcl.so"})
    (finding,) = healthy.with_("laptop", "ros-processes", changed(0, libraries=libraries)).roots()
    assert finding.id == "rmw-mismatch"
    assert "rmw_cyclonedds_cpp" in finding.cause


def test_a_shell_older_than_the_set_up_is_named(healthy) -> None:
    (finding,) = healthy.with_("laptop", "shell", lambda s: replace(s, environment={})).roots()
    assert finding.id == "shell-multicast-only"
    assert finding.fix.command == "source /home/operator/.config/lupin/ros-env.sh"
    assert "ROS_DISCOVERY_SERVER=" in finding.evidence


def test_a_machine_that_was_never_set_up_is_named_only_where_a_robot_was_asked_for(healthy) -> None:
    sick = healthy.with_("laptop", "shell", lambda s: replace(s, environment={}, exports={}, start_files=()))
    assert sick.named() == ["dds-not-set-up"]
    assert replace(sick, robot=None, link=None).named() == []


def test_a_set_up_that_was_taken_back_explains_the_profile_that_went_with_it_and_no_other(healthy) -> None:
    gone = own_profile(error="there is no readable file")
    sick = healthy.with_("laptop", "shell", lambda s: replace(s, environment={}, exports={}, start_files=()))
    assert sick.with_("laptop", "dds-profiles", gone).named() == ["dds-not-set-up"]

    def naming(path: str) -> Any:
        environment = {"ROS_DISCOVERY_SERVER": "10.42.0.1:11811", "FASTRTPS_DEFAULT_PROFILES_FILE": path}
        return sick.with_("laptop", "ros-processes", lambda ps: (*ps, replace(ps[0], pid=99, environment=environment)))

    own = "/home/operator/.config/lupin/fastdds_super_client.xml"
    assert naming(own).with_("laptop", "dds-profiles", gone).named() == ["dds-not-set-up"]
    lost = naming("/old.xml").with_("laptop", "dds-profiles", lambda ps: (replace(ps[0], path="/old.xml", error="no file"),))
    assert sorted(lost.named()) == ["dds-not-set-up", "profile-unreadable"]


def test_the_wrong_source_order_is_named_with_both_lines_and_explains_the_empty_shell(healthy) -> None:
    (finding,) = healthy.with_("laptop", "shell", "wiped").roots()
    assert finding.id == "source-order"
    assert finding.evidence[0] == '/home/operator/.bashrc:2:. "$HOME/.config/lupin/ros-env.sh"'
    assert finding.evidence[1] == "/home/operator/.bashrc:3:source $HOME/mirte_ws/install/setup.bash"
    assert finding.evidence[2].endswith("/environment/fastdds.sh")


def test_a_later_setup_file_without_a_hook_that_wipes_is_no_fault(healthy) -> None:
    def harmless(shell: Any) -> Any:
        starts = tuple(replace(start, wipes={}) for start in shell.start_files)
        return replace(shell, start_files=starts)

    sick = healthy.with_("laptop", "shell", "wiped").with_("laptop", "shell", harmless)
    assert sick.named() == ["shell-multicast-only"]


def test_a_shell_of_another_middleware_is_named(healthy) -> None:
    environment = {"ROS_DISCOVERY_SERVER": "10.42.0.1:11811", "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}
    assert healthy.with_("laptop", "shell", lambda s: replace(s, environment=environment)).named() == ["shell-rmw-mismatch"]


def test_a_daemon_of_an_older_set_up_is_named(healthy) -> None:
    def daemon(processes: tuple) -> tuple:
        arguments = ("/usr/bin/python3", "-c", "from ros2cli.daemon.daemonize import main; main()", "--name", "ros2-daemon")
        return (*processes, replace(processes[0], pid=99, arguments=arguments, environment={}, parent=1))

    (finding,) = healthy.with_("laptop", "ros-processes", daemon).roots()
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
        ({"error": "there is no readable file"}, "profile-unreadable"),
    ],
)
def test_each_fault_of_the_profile_is_named(healthy, fault, name) -> None:
    (finding,) = healthy.with_("laptop", "dds-profiles", own_profile(**fault)).roots()
    assert finding.id == name
    assert "fastdds_super_client.xml" in finding.cause
    assert finding.fix.command == "lupin dds setup 10.42.0.1"


def test_a_profile_is_judged_by_the_shell_and_not_by_a_process_that_asks_elsewhere(healthy) -> None:
    def stale(processes: tuple) -> tuple:
        home = "/home/operator/.config/lupin/fastdds_super_client.xml"
        environment = {"ROS_DISCOVERY_SERVER": "192.168.42.1:11811", "FASTRTPS_DEFAULT_PROFILES_FILE": home}
        return (*processes, replace(processes[0], pid=99, environment=environment))

    sick = healthy.with_("laptop", "ros-processes", stale)
    assert "profile-wrong-address" not in sick.named()
    elsewhere = own_profile(servers=(Server("44.53.00.5f.45.50.52.4f.53.49.4d.41", "192.168.42.1", 11811),))
    found = sick.with_("laptop", "dds-profiles", elsewhere).roots()
    (finding,) = (finding for finding in found if finding.id == "profile-wrong-address")
    assert finding.fix.command == "lupin dds setup 10.42.0.1"


def test_a_faulty_profile_that_nobody_names_is_nobodys_concern(healthy) -> None:
    stray = healthy.with_("laptop", "dds-profiles", lambda ps: (*ps, replace(ps[0], path="/old.xml", default=False)))
    assert stray.named() == []


# -- the link -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["no-route", "timeout", "refused", "silent", "name", "lost", "host-key-changed"])
def test_an_unreachable_robot_is_told_with_what_that_kind_of_failure_means(healthy, kind) -> None:
    (finding,) = healthy.unreachable(kind).roots()
    assert finding.id == "robot-unreachable"
    assert f"({kind})" in finding.cause
    assert finding.evidence[0] == f"mirte@10.42.0.1: {kind}"


def test_a_wifi_that_roamed_is_the_root_of_an_unreachable_robot(healthy) -> None:
    sick = healthy.unreachable("no-route").with_("laptop", "routes", "roamed").with_("laptop", "addresses", "roamed")
    (finding,) = sick.with_("laptop", "network-manager", "roamed-to-eduroam").roots()
    assert finding.id == "wifi-roamed"
    assert finding.fix.command == "nmcli connection up Mirte-247264"
    assert any("eduroam" in line for line in finding.evidence)


def test_a_cable_that_is_out_is_the_root_of_an_unreachable_robot(healthy) -> None:
    sick = healthy.unreachable("no-route").with_("laptop", "routes", "cable-out").with_("laptop", "addresses", "cable-out")
    (finding,) = sick.roots()
    assert finding.id == "no-carrier"
    assert "lan0 NO-CARRIER 10.42.0.2/24" in finding.evidence


def test_equal_priorities_are_a_warning_where_the_radio_carries_the_link(healthy) -> None:
    def by_radio(routes: Any) -> Any:
        return replace(routes, wireless=frozenset({"wifi0"}))

    sick = healthy.with_("laptop", "network-manager", "equal-priorities")
    assert sick.named() == []  # the cable carries it: the radio may go where it likes
    at_the_access_point = replace(sick, link=replace(sick.link, address="192.168.42.1"))
    (finding,) = at_the_access_point.with_("laptop", "routes", by_radio).roots()
    assert (finding.id, finding.severity) == ("wifi-may-roam", Severity.WARNING)
    assert "connection.autoconnect-priority 100" in finding.fix.command
    pinned = at_the_access_point.with_("laptop", "network-manager", "on-the-access-point")
    assert pinned.with_("laptop", "routes", by_radio).named() == []


# -- addresses ------------------------------------------------------------------------------------------------------------


def without_access_point(routes: Any) -> Any:
    return replace(routes, main=tuple(route for route in routes.main if not route.destination.startswith("192.168.42.")))


def test_a_dual_homed_robot_is_named_where_one_address_has_no_route_from_here(healthy) -> None:
    (finding,) = healthy.with_("laptop", "routes", without_access_point).roots()
    assert finding.id == "robot-multi-homed"
    assert "192.168.42.1" in finding.cause
    assert "robot: wlan0 UP 192.168.42.1/24" in finding.evidence
    assert finding.fix.playbook == "single-home"
    assert not finding.fix.safe


def test_a_default_route_does_not_lead_to_the_robots_access_point(healthy) -> None:
    def internet(routes: Any) -> Any:
        default = replace(routes.main[0], destination="default", gateway="10.128.0.1", device="wifi1")
        return replace(without_access_point(routes), main=(*without_access_point(routes).main, default))

    assert healthy.with_("laptop", "routes", internet).named() == ["robot-multi-homed"]


def test_a_dual_homed_robot_whose_profile_names_one_address_is_healthy(healthy) -> None:
    sick = healthy.with_("laptop", "routes", without_access_point)
    whitelisted = sick.with_("robot", "dds-profiles", lambda ps: tuple(replace(p, whitelist=("10.42.0.1",)) for p in ps))
    assert whitelisted.named() == []


def test_an_address_without_a_carrier_is_not_announced(healthy) -> None:
    def ap_down(addresses: Addresses) -> Addresses:
        return Addresses(tuple(replace(a, carrier=False) if a.interface == "wlan0" else a for a in addresses.every))

    sick = healthy.with_("laptop", "routes", without_access_point)
    assert sick.with_("robot", "addresses", ap_down).named() == []


def test_processes_older_than_the_address_of_the_link_are_named_on_either_machine(healthy) -> None:
    def unaware(address: str) -> Callable[[Sockets], Sockets]:
        return lambda sockets: Sockets(tuple(each for each in sockets.every if each.address != address))

    (robot,) = healthy.with_("robot", "sockets", unaware("10.42.0.1")).roots()
    assert (robot.id, robot.where) == ("process-older-than-interface", "robot")
    assert "telemetrix" in robot.cause
    (laptop,) = healthy.with_("laptop", "sockets", unaware("10.42.0.2")).roots()
    assert (laptop.id, laptop.where) == ("process-older-than-interface", "laptop")
    assert "slam_toolbox" in laptop.cause


def test_an_address_that_does_not_carry_the_link_may_be_newer_than_any_process(healthy) -> None:
    newer = Address("docker0", "172.17.0.1", 16, "global", up=True, carrier=False)
    assert healthy.with_("robot", "addresses", lambda a: Addresses((*a.every, newer))).named() == []


# -- leftovers ------------------------------------------------------------------------------------------------------------


def test_a_process_that_outlived_its_launch_is_named_with_the_ports_that_it_holds(healthy) -> None:
    sick = healthy
    for fact in ("ros-processes", "sockets", "dds-profiles"):
        sick = sick.with_("robot", fact, "one-left-behind")
    (finding,) = sick.roots()
    assert finding.id == "zombie-process"
    assert "left_behind" in finding.cause
    assert "its parent is gone" in finding.cause


def test_the_memory_of_a_killed_process_is_orphaned_and_its_neighbours_is_not(healthy, capture) -> None:
    (finding,) = healthy.with_("robot", "shared-memory", "one-of-two-killed").roots()
    assert (finding.id, finding.severity) == ("shared-memory-orphans", Severity.WARNING)
    held = [each for each in capture("shared-memory", "one-of-two-killed") if each.held]
    assert held
    assert not any(each.name in line for each in held for line in finding.evidence)
    assert finding.fix.safe


def test_segments_that_a_live_process_holds_are_no_orphans_however_old(healthy) -> None:
    assert healthy.with_("robot", "shared-memory", lambda fs: tuple(replace(f, changed_s=0) for f in fs)).named() == []


def test_files_without_a_lock_file_are_left_alone(healthy) -> None:
    def bare(files: tuple) -> tuple:
        return (*files, replace(files[0], name="fastrtps_0123456789abcdef", lockable=False, held=False))

    assert healthy.with_("robot", "shared-memory", bare).named() == []


def test_a_stopped_process_on_the_graphs_ports_is_named(healthy) -> None:
    (finding,) = healthy.with_("robot", "ros-processes", changed(1, state="T")).roots()
    assert finding.id == "zombie-process"
    assert "Ctrl-Z" in finding.cause


def test_a_stopped_service_is_named_too(healthy) -> None:
    stopped = changed(1, state="T", parent=1, group="/system.slice/lupin-onboard.service")
    assert healthy.with_("robot", "ros-processes", stopped).named() == ["zombie-process"]


def test_a_unit_without_a_parent_is_no_zombie(healthy) -> None:
    unit = changed(1, parent=1, group="/system.slice/mirte-ros.service")
    assert healthy.with_("robot", "ros-processes", unit).named() == []
    assert healthy.with_("robot", "ros-processes", changed(1, parent=1, group="/user.slice/session-3.scope")).named() == [
        "zombie-process"
    ]


@pytest.mark.parametrize("apart", [{"user_id": 1001}, {"shared_memory": "99"}])
def test_two_sides_of_one_graph_that_cannot_share_memory_are_named(healthy, apart) -> None:
    (finding,) = healthy.with_("robot", "ros-processes", changed(1, **apart)).roots()
    assert finding.id == "shared-memory-not-shared"
    assert "FASTDDS_BUILTIN_TRANSPORTS=UDPv4" in finding.fix.command


def test_udp_on_either_side_cures_it(healthy) -> None:
    def tuned(processes: tuple) -> tuple:
        environment = {**processes[1].environment, "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
        return changed(1, user_id=1001, environment=environment)(processes)

    assert healthy.with_("robot", "ros-processes", tuned).named() == []


def strangers(user_id: int, port: int) -> Callable[[tuple], tuple]:
    """With the memory of a process that isn't seen otherwise: another user's."""
    names = ("fastrtps_00000000deadbeef", f"fastrtps_port{port}")
    return lambda files: (*files, *(SharedFile(name, user_id, 1, 0, lockable=True, held=True, holder=4242) for name in names))


def test_a_process_whose_environment_cannot_be_read_is_told_by_the_memory_and_the_ports_that_it_holds(healthy) -> None:
    (finding,) = healthy.with_("robot", "shared-memory", strangers(1001, 7421)).roots()
    assert finding.id == "shared-memory-not-shared" and "process 4242 (user 1001)" in finding.cause
    assert healthy.with_("robot", "shared-memory", strangers(1001, 7671)).named() == []  # domain 1
    assert healthy.with_("robot", "shared-memory", strangers(0, 7421)).named() == []  # the same user, in what was captured


def test_memory_that_the_end_of_a_login_takes_is_named_before_and_after(healthy) -> None:
    at_risk = healthy.with_("robot", "account", "loses-memory").with_("robot", "account", lambda who: replace(who, uid=0))
    (finding,) = at_risk.roots()
    assert (finding.id, finding.fix.playbook, finding.fix.safe) == ("shared-memory-at-risk", "keep-shared-memory", True)
    holder = next(file.holder for file in at_risk.evidence.robot.get(SHARED_MEMORY) if file.held)
    gone = SharedFile("", -1, 0, 0, lockable=True, held=True, holder=holder, removed=True)
    (finding,) = at_risk.with_("robot", "shared-memory", lambda files: (gone,)).roots()
    assert finding.id == "shared-memory-removed" and "when the last login of mirte ended" in finding.cause
    assert (finding.fix.variables, finding.fix.safe) == ({"restart": True}, False)


def test_memory_of_a_doctors_visit_that_ends_is_nobodys_loss(healthy) -> None:
    gone = SharedFile("", -1, 0, 0, lockable=True, held=True, holder=99, removed=True)

    def beside(*arguments: str) -> list[str]:
        own = healthy.with_("laptop", "ros-processes", lambda ps: (*ps, replace(ps[0], pid=99, arguments=arguments)))
        return own.with_("laptop", "shared-memory", lambda files: (*files, gone)).named()

    assert beside("/usr/bin/python", "-m", "lupin_runtime.stack.probe") == []
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
def test_a_port_held_by_a_stranger_is_named_and_one_held_by_its_owner_is_not(healthy, protocol, port, stranger, owner) -> None:
    def held(command: str, pid: int = 4242) -> list[str]:
        name = command.split()[0].rsplit("/", 1)[-1][:15]  # as the kernel cuts it
        socket = with_socket(protocol=protocol, address="0.0.0.0", port=port, process=name, pid=pid, command=command)
        return healthy.with_("laptop", "sockets", socket).named()

    assert held(stranger) == [f"port-{port}-taken"]
    assert held(owner) == []


def test_an_owner_that_this_user_may_not_see_is_not_accused(healthy) -> None:
    unseen = with_socket(protocol="udp", address="0.0.0.0", port=123)
    assert healthy.with_("laptop", "sockets", unseen).named() == []


# -- two at a time --------------------------------------------------------------------------------------------------------


def other_middleware(world: Any) -> Any:
    """A third process on the robot, on another middleware."""

    def more(processes: tuple) -> tuple:
        libraries = frozenset({"librmw_cyclonedds_cpp.so", "librcl.so"})
        return (*processes, replace(processes[1], pid=500, libraries=libraries))

    return world.with_("robot", "ros-processes", more)


def orphans(world: Any) -> Any:
    """The memory of two participants that were killed."""

    def more(files: tuple) -> tuple:
        names = ("fastrtps_00aa", "fastrtps_00aa_el", "fastrtps_00bb", "fastrtps_00bb_el")
        return (*files, *(replace(files[0], name=name, held=False, holder=0) for name in names))

    return world.with_("robot", "shared-memory", more)


FAULTS: dict[str, Callable[[Any], Any]] = {
    "discovery-server-missing": lambda w: w.with_("robot", "sockets", without_port(11811)),
    "robot-multi-homed": lambda w: w.with_("laptop", "routes", without_access_point),
    "zombie-process": lambda w: w.with_("robot", "ros-processes", changed(1, state="T")),
    "shared-memory-orphans": orphans,
    "rmw-mismatch": other_middleware,
    "profile-not-default": lambda w: w.with_("laptop", "dds-profiles", own_profile(default=False)),
    "source-order": lambda w: w.with_("laptop", "shell", "wiped"),
    "port-9090-taken": lambda w: w.with_(
        "laptop", "sockets", with_socket(protocol="tcp", address="0.0.0.0", port=9090, process="node", pid=9, command="node x")
    ),
    "process-older-than-interface": lambda w: w.with_(
        "laptop", "sockets", lambda s: Sockets(tuple(each for each in s.every if each.address != "10.42.0.2"))
    ),
}


@pytest.mark.parametrize("pair", [(a, b) for a in FAULTS for b in FAULTS if a < b], ids="+".join)
def test_two_faults_at_once_are_both_named_and_no_third(healthy, pair) -> None:
    sick = healthy
    for name in pair:
        sick = FAULTS[name](sick)
    assert sorted(sick.named()) == sorted(pair)
