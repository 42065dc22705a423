"""Captured facts under all network checks: each fault is the only root cause, and healthy machines have none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.checks import Finding, Severity
from lupin_cli.checks.ground_truth import CHECKS as GROUND_TRUTH
from lupin_cli.checks.path import CHECKS as PATH
from lupin_cli.checks.resources import CHECKS as RESOURCES
from lupin_cli.checks.shell_environment import CHECKS as SHELL_ENVIRONMENT
from lupin_cli.checks.shell_environment import CLEAN_SHELL
from lupin_cli.connection.base import Output
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.addresses import Address, Addresses
from lupin_cli.facts.dds_profiles import Server, parse_profile
from lupin_cli.facts.graph import Graph, Graphs, ObservedTopic
from lupin_cli.facts.shared_memory import SHARED_MEMORY, SharedFile
from lupin_cli.facts.shell import SHELL
from lupin_cli.facts.sockets import Socket, Sockets
from lupin_cli.link.path import End, Path
from tests.lupin_cli.checks.conftest import CHECKS
from tests.lupin_cli.checks.test_ground_truth import received
from tests.support.optional import present
from tests.support.snapshots import captured

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


def test_bare_shell_is_a_problem_only_while_data_is_missing(healthy: Machines) -> None:
    bare = healthy.with_laptop("shell", lambda shell: replace(shell, environment={}))
    off = bare.with_robot("sockets", without_port(11811)).with_robot("discovery-log", "switched-off")
    assert sorted(off.root_ids()) == ["discovery-server-switched-off", "shell-multicast-only"]

    def severities(machines: Machines) -> dict[str, str]:
        return {each.id: each.severity.value for each in machines.root_findings()}

    assert severities(off)["shell-multicast-only"] == "warning"
    missing = off.with_laptop("graph", Graphs((Graph("shell", "shell", ()),)))
    assert severities(missing) == {"discovery-server-switched-off": "problem", "shell-multicast-only": "problem"}


def test_shell_without_the_profile_is_named(healthy: Machines) -> None:
    def without(shell: Any, **more: str) -> Any:
        profile = "FASTRTPS_DEFAULT_PROFILES_FILE"
        return replace(shell, environment={**{k: v for k, v in shell.environment.items() if k != profile}, **more})

    (finding,) = healthy.with_laptop("shell", without).root_findings()
    assert (finding.id, finding.layer, finding.where) == ("shell-without-profile", "environment", "laptop")
    assert finding.fix.command == "source /home/operator/.config/lupin/ros-env.sh"
    assert healthy.with_laptop("shell", lambda shell: without(shell, ROS_SUPER_CLIENT="TRUE")).root_ids() == []


@pytest.mark.parametrize("value", ["10.42.0.1:11811;", "10.42.0.1", " 10.42.0.1:11811 ; "])
def test_other_text_for_the_same_server_is_no_fault(healthy: Machines, value: str) -> None:
    def daemon(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        arguments = ("/usr/bin/python3", "-c", "from ros2cli.daemon.daemonize import main; main()")
        environment = {"ROS_DISCOVERY_SERVER": "10.42.0.1:11811"}
        return (*processes, replace(processes[0], pid=99, arguments=arguments, environment=environment, parent=1))

    def asking(value: str) -> Machines:
        changed = {"ROS_DISCOVERY_SERVER": value}
        shell = healthy.with_laptop("shell", lambda shell: replace(shell, environment={**shell.environment, **changed}))
        return shell.with_laptop("ros-processes", daemon)

    assert asking(value).root_ids() == []
    # The place in the list is the server's id.
    assert sorted(asking(";10.42.0.1:11811").root_ids()) == ["shell-multicast-only", "stale-daemon"]


def test_carriage_return_in_a_variable_is_named(healthy: Machines) -> None:
    exports = "/home/operator/.config/lupin/ros-env.sh"

    def shell(end: str, file_end: str) -> Any:
        text = f"""@@ home /home/operator\n@@ environment\nROS_DISCOVERY_SERVER=10.42.0.1:11811{end}\nROS_SUPER_CLIENT=1\n
@@ exports {exports}\nexport ROS_DISCOVERY_SERVER="10.42.0.1:11811"{file_end}\n@@ start /x\n@@ wipes /x\n"""
        return SHELL.parse(Output(0, text))

    assert healthy.with_laptop("shell", shell("", "")).root_ids() == []
    for file_end, command in (("", f"source {exports}"), ("\r", f"lupin dds setup 10.42.0.1 && source {exports}")):
        (finding,) = healthy.with_laptop("shell", shell("\r", file_end)).root_findings()
        assert (finding.id, finding.severity, finding.fix.command) == ("shell-other-graph", Severity.PROBLEM, command)
        assert finding.evidence == ("ROS_DISCOVERY_SERVER='10.42.0.1:11811\\r'",)


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
    environment = {
        "ROS_SUPER_CLIENT": "1",
        "ROS_DISCOVERY_SERVER": "10.42.0.1:11811",
        "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
    }
    assert healthy.with_laptop("shell", lambda s: replace(s, environment=environment)).root_ids() == ["shell-rmw-mismatch"]


MISLEADING = [
    {"ROS_LOCALHOST_ONLY": "1"},
    {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
    {"FASTDDS_BUILTIN_TRANSPORTS": "SHM"},
    {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv6"},
    {"ROS_DOMAIN_ID": "17"},
]
HARMLESS = {"ROS_DOMAIN_ID": "0", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4", "ROS_LOCALHOST_ONLY": "0", "ROS_VERSION": "2"}


@pytest.mark.parametrize("variables", MISLEADING, ids=lambda variables: "".join(variables.values()))
def test_shell_variables_that_lead_elsewhere_are_named(healthy: Machines, variables: dict[str, str]) -> None:
    def with_variables(shell: Any) -> Any:
        return replace(shell, environment={**shell.environment, **variables})

    (finding,) = healthy.with_laptop("shell", with_variables).root_findings()
    assert (finding.id, finding.layer, finding.where) == ("shell-other-graph", "environment", "laptop")
    assert finding.fix.command == f"unset {next(iter(variables))}"
    assert healthy.with_laptop("shell", lambda s: replace(s, environment={**s.environment, **HARMLESS})).root_ids() == []


def test_shell_gets_the_domain_of_the_robots_processes(healthy: Machines) -> None:
    def of_robot(processes: Any) -> Any:
        return tuple(replace(each, environment={**each.environment, "ROS_DOMAIN_ID": "5"}) for each in processes)

    def with_domain(shell: Any) -> Any:
        return replace(shell, environment={**shell.environment, "ROS_DOMAIN_ID": "7", "ROS_LOCALHOST_ONLY": "1"})

    found = healthy.with_robot("ros-processes", of_robot).with_laptop("shell", with_domain).root_findings()
    (finding,) = (each for each in found if each.id == "shell-other-graph")
    assert finding.fix.command == "export ROS_DOMAIN_ID=5; unset ROS_LOCALHOST_ONLY"


def in_domain(number: str) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """Return a function that gives all ROS processes a domain."""
    return lambda processes: tuple(
        replace(each, environment={**each.environment, "ROS_DOMAIN_ID": number}) for each in processes
    )


@pytest.mark.parametrize("where", ["unit", "processes"])
def test_shell_without_the_domain_of_all_others_is_named(healthy: Machines, where: str) -> None:
    """The lab gives each robot a domain; a new terminal, cron or an editor has no ROS_DOMAIN_ID."""

    def in_unit_file(units: Any) -> Any:
        setting = {"environment": {"ROS_DOMAIN_ID": "7"}}
        return replace(units, units=tuple(replace(u, **setting) if u.name == "mirte-ros.service" else u for u in units.units))

    def of_unit(processes: Any) -> Any:
        return tuple(replace(each, group="/system.slice/mirte-ros.service") for each in processes)

    set_up = healthy.with_robot("ros-processes", in_domain("7")).with_laptop("ros-processes", in_domain("7"))
    set_up = set_up.with_robot("units", in_unit_file) if where == "unit" else set_up.with_robot("ros-processes", of_unit)
    (finding,) = set_up.root_findings()
    assert (finding.id, finding.where, finding.fix.command) == ("shell-other-graph", "laptop", "export ROS_DOMAIN_ID=7")
    assert "this shell has no ROS_DOMAIN_ID" in finding.cause and any("=7" in line for line in finding.evidence)
    told = set_up.with_laptop("shell", lambda s: replace(s, environment={**s.environment, "ROS_DOMAIN_ID": "7"}))
    assert told.root_ids() == []
    alone = set_up.with_laptop("ros-processes", in_domain("0"))
    assert alone.root_ids() == ["unit-environment" if where == "unit" else "process-environment"]


def test_daemon_and_server_are_in_no_domain_of_the_robot(healthy: Machines) -> None:
    def with_daemon(processes: Any) -> Any:
        daemon = ("/usr/bin/python3", "-c", "from ros2cli.daemon.daemonize import main; main()")
        return (*in_domain("7")(processes), replace(processes[1], pid=99, arguments=daemon, environment={}))

    both = healthy.with_robot("ros-processes", with_daemon).with_laptop("ros-processes", in_domain("7"))
    assert "shell-other-graph" in both.root_ids()


@pytest.mark.parametrize("unit", ["mirte-ros", "lupin-onboard"])
@pytest.mark.parametrize("variables", [*MISLEADING, {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}], ids=str)
def test_unit_environment_that_leads_elsewhere_is_named(healthy: Machines, unit: str, variables: dict[str, str]) -> None:
    drop_in = f"/etc/systemd/system/{unit}.service.d/90-local.conf"

    def setting(found: dict[str, str], active: str = "active") -> Callable[[Any], Any]:
        changed = {"environment": found, "drop_ins": (drop_in,), "active": active, "sub": active, "result": "exit-code"}
        changed["assignments"] = {f"/etc/systemd/system/{unit}.service": {"PATH": "/usr/bin"}, drop_in: found}
        return lambda units: replace(
            units, units=tuple(replace(each, **changed) if each.name == f"{unit}.service" else each for each in units.units)
        )

    for active in ("active", "failed"):
        (finding,) = healthy.with_robot("units", setting(variables, active)).root_findings()
        assert (finding.id, finding.layer, finding.where) == ("unit-environment", "environment", "robot")
        assert f"set by: {drop_in}" in finding.evidence
        assert f"{next(iter(variables))}=" in finding.fix.command and f" {drop_in} && " in finding.fix.command
        assert finding.fix.command.endswith(f"sudo systemctl restart {unit}.service'")
    elsewhere = healthy.with_robot("units", setting(variables))
    lost = elsewhere.with_robot("units", lambda us: replace(us, units=tuple(replace(u, assignments={}) for u in us.units)))
    (finding,) = lost.root_findings()
    assert "systemctl cat" in finding.fix.command and "take" in finding.fix.instruction
    assert healthy.with_robot("units", setting(HARMLESS)).root_ids() == []


def in_unit(unit: str, **variables: str) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """Return a function that gives a variable to one process of a unit of the robot."""

    def change(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        chosen = next(each for each in processes if each.server and not each.is_server)
        mine = replace(chosen, group=f"/system.slice/{unit}.service", environment={**chosen.environment, **variables})
        return tuple(mine if each is chosen else each for each in processes)

    return change


@pytest.mark.parametrize(
    "variables", [{"ROS_LOCALHOST_ONLY": "1"}, {"FASTDDS_BUILTIN_TRANSPORTS": "SHM"}, {"ROS_DOMAIN_ID": "7"}]
)
def test_environment_of_robot_processes_is_judged(healthy: Machines, variables: dict[str, str]) -> None:
    (finding,) = healthy.with_robot("ros-processes", in_unit("mirte-ros", **variables)).root_findings()
    assert (finding.id, finding.layer, finding.where) == ("process-environment", "environment", "robot")
    assert next(iter(variables)) in finding.cause and "~/.mirte_settings.sh" in finding.fix.command
    assert healthy.with_robot("ros-processes", in_unit("mirte-ros", ROS_DOMAIN_ID="0")).root_ids() == []


def test_program_that_fails_in_this_shell_is_named(healthy: Machines) -> None:
    error = "the graph probe exited with status 1: ImportError: librcl.so: undefined symbol: x"
    faulty = healthy.with_laptop("graph", Graphs((Graph("robot", "robot", (), error=error),)))
    misled = faulty.with_laptop("shell", lambda s: replace(s, environment={**s.environment, "LD_LIBRARY_PATH": "/opt/old"}))
    for machines, command in ((faulty, "lupin dds check"), (misled, CLEAN_SHELL)):
        (finding,) = machines.root_findings()
        assert (finding.id, finding.layer, finding.where) == ("shell-program-fails", "environment", "laptop")
        assert "undefined symbol" in finding.cause and finding.fix.command == command
    diagnosis = diagnose(
        (*SHELL_ENVIRONMENT, *RESOURCES), faulty.with_laptop("storage", captured("storage", "shm-full")).snapshot
    )
    assert [root.finding.id for root in diagnosis.roots] == ["shared-memory-full"]


def test_profile_that_only_a_variable_names_is_the_variables(healthy: Machines) -> None:
    environment = {"ROS_DISCOVERY_SERVER": "10.42.0.1:11811", "FASTRTPS_DEFAULT_PROFILES_FILE": "/nowhere/7.xml"}
    faulty = healthy.with_laptop("shell", lambda s: replace(s, environment=environment))
    faulty = faulty.with_laptop("dds-profiles", lambda ps: (*ps, replace(ps[0], path="/nowhere/7.xml", error="no such file")))
    (finding,) = faulty.root_findings()
    assert (finding.id, finding.layer) == ("profile-unreadable", "environment")


def test_exports_without_a_server_are_named(healthy: Machines) -> None:
    def incomplete(shell: Any) -> Any:
        return replace(shell, exports={name: v for name, v in shell.exports.items() if name != "ROS_DISCOVERY_SERVER"})

    (finding,) = healthy.with_laptop("shell", incomplete).root_findings()
    assert (finding.id, finding.severity) == ("dds-not-set-up", Severity.WARNING)
    assert "exports no ROS_DISCOVERY_SERVER" in finding.cause


def test_daemon_older_than_the_setup_is_named(healthy: Machines) -> None:
    def daemon(processes: tuple[Any, ...]) -> tuple[Any, ...]:
        arguments = ("/usr/bin/python3", "-c", "from ros2cli.daemon.daemonize import main; main()", "--name", "ros2-daemon")
        return (*processes, replace(processes[0], pid=99, arguments=arguments, environment={}, parent=1))

    (finding,) = healthy.with_laptop("ros-processes", daemon).root_findings()
    assert (finding.id, finding.fix.command) == ("stale-daemon", "kill 99")


# -- profiles -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("fault", "name"),
    [
        ({"default": False}, "profile-not-default"),
        ({"protocol": "CLIENT"}, "profile-not-super-client"),
        ({"protocol": "SERVER"}, "profile-not-super-client"),
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


@pytest.mark.parametrize(
    ("fault", "word"),
    [
        ({"whitelist": ("192.168.42.7",)}, "interfaceWhiteList allows only 192.168.42.7"),
        ({"builtin_transports": False}, "no transport of its own"),
        ({"builtin_transports": False, "own_transports": ("SHM",)}, "its own transports are SHM"),
    ],
)
def test_profile_that_excludes_the_link_is_named(healthy: Machines, fault: dict[str, Any], word: str) -> None:
    (finding,) = healthy.with_laptop("dds-profiles", own_profile(**fault)).root_findings()
    assert (finding.id, finding.layer, finding.where) == ("profile-excludes-link", "profile", "laptop")
    assert word in finding.cause
    for harmless in ({"whitelist": ("10.42.0.2",)}, {"whitelist": ("lan0",)}):
        assert healthy.with_laptop("dds-profiles", own_profile(**harmless)).root_ids() == []
    udp: dict[str, Any] = {"builtin_transports": False, "own_transports": ("UDPv4",)}
    assert healthy.with_laptop("dds-profiles", own_profile(**udp)).root_ids() == []


def test_transports_of_a_profile_are_read() -> None:
    text = """<profiles><transport_descriptors><transport_descriptor><transport_id>mine</transport_id><type>UDPv4</type>
    <interfaceWhiteList><address>10.42.0.9</address></interfaceWhiteList></transport_descriptor></transport_descriptors>
    <participant profile_name="p" is_default_profile="true"><rtps><userTransports><transport_id>mine</transport_id>
    </userTransports><useBuiltinTransports>false</useBuiltinTransports></rtps></participant></profiles>"""
    profile = parse_profile("/p.xml", text)
    assert (profile.own_transports, profile.builtin_transports, profile.whitelist) == (("UDPv4",), False, ("10.42.0.9",))


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


@pytest.mark.parametrize("machine", ["laptop", "robot"])
def test_process_older_than_its_profile_is_named(healthy: Machines, machine: str) -> None:
    with_fact = healthy.with_laptop if machine == "laptop" else healthy.with_robot

    def aged(seconds: float | None) -> Machines:
        changed = with_fact("dds-profiles", lambda ps: tuple(replace(each, age_s=seconds) for each in ps))
        return changed.with_laptop("graph", Graphs((Graph("robot", "robot", ()),)))

    def found(seconds: float | None) -> list[Finding]:
        return [finding for finding in aged(seconds).root_findings() if finding.id == "profile-changed"]

    (finding,) = found(0.5)
    assert (finding.where, finding.layer, finding.severity) == (machine, "profile", Severity.WARNING)
    assert "started before" in finding.cause and any("s old" in line for line in finding.evidence)
    assert not found(1e9) and not found(None) and not found(-5.0)
    assert (
        "profile-changed" not in with_fact("dds-profiles", lambda ps: tuple(replace(each, age_s=0.5) for each in ps)).root_ids()
    )  # nothing is missing


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


def test_login_shell_that_runs_nothing_is_the_robots(healthy: Machines) -> None:
    (finding,) = healthy.unreachable("login-shell").root_findings()
    assert (finding.id, finding.layer, finding.where) == ("robot-unreachable", "login", "robot")


def test_roamed_wifi_explains_unreachable_robot(healthy: Machines) -> None:
    faulty = healthy.unreachable("no-route").with_laptop("routes", "roamed").with_laptop("addresses", "roamed")
    faulty = replace(faulty, link=replace(present(faulty.link), address="192.168.42.1"))
    (finding,) = faulty.with_laptop("network-manager", "roamed-to-eduroam").root_findings()
    assert finding.id == "wifi-roamed"
    assert finding.fix.command == "nmcli connection up Mirte-247264"
    assert any("eduroam" in line for line in finding.evidence)


def test_unplugged_cable_explains_unreachable_robot(healthy: Machines) -> None:
    faulty = healthy.unreachable("no-route").with_laptop("routes", "cable-out").with_laptop("addresses", "cable-out")
    (finding,) = faulty.root_findings()
    assert finding.id == "no-carrier"
    assert (finding.layer, finding.where) == ("carrier", "link")
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


def test_multihomed_robot_with_unroutable_address_is_named(healthy: Machines) -> None:
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


def test_multihomed_robot_with_whitelist_is_healthy(healthy: Machines) -> None:
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


# -- ports ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("protocol", "port", "stranger", "owner"),
    [
        ("tcp", 8090, "node vite", "/usr/bin/python -m lupin_runtime.stack.process console.json"),
        ("tcp", 9090, "python rosbridge_websocket", "/opt/lupin/bin/lupin up"),
        (
            "tcp",
            8090,
            "/home/me/lupin/.venv/bin/python -m http.server 8090",
            "/home/me/robot/.venv/bin/python -P -m lupin_cli.app up",
        ),
        ("tcp", 9090, "python3 -m http.server --directory /srv/lupin", "/usr/bin/python3 /opt/x/bin/lupin console"),
        ("udp", 123, "ntpd", "/usr/sbin/chronyd -F 1"),
        ("udp", 123, "ntpd -c /etc/chronyd", "/usr/sbin/chronyd"),
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
