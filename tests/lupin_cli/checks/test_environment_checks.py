"""Checks of the DDS environment of processes and shells. Captured facts: each fault is the only root cause."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from lupin_cli.checks import Severity
from lupin_cli.checks.resources import CHECKS as RESOURCES
from lupin_cli.checks.shell_environment import CHECKS as SHELL_ENVIRONMENT
from lupin_cli.checks.shell_environment import CLEAN_SHELL
from lupin_cli.connection.base import Output
from lupin_cli.doctor.engine import diagnose
from lupin_cli.facts.graph import Graph, Graphs
from lupin_cli.facts.shell import SHELL
from lupin_cli.facts.sockets import Sockets
from tests.support.changed_facts import changed, own_profile, without_port
from tests.support.snapshots import captured

if TYPE_CHECKING:
    from tests.lupin_cli.checks.conftest import Machines


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
