"""The environment of this shell, which decides what graph the programs join that a person starts in it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.dds_environment import (
    FAST_DDS,
    domains_in_use,
    misleading_variables,
    ros_programs,
    server_host,
    server_port,
    servers,
)
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import FixText, source_exports
from lupin_cli.checks.robot_address import is_of_examined_robot, set_up_laptop
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.base import Facts
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.routes import ROUTES
from lupin_cli.facts.shell import SHELL, Shell, StartupFile
from lupin_cli.facts.sockets import SOCKETS
from lupin_runtime.ports import DISCOVERY_PORT

_PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_MAKING_SUPER_CLIENTS = (_PROFILE, "FASTDDS_DEFAULT_PROFILES_FILE", "ROS_SUPER_CLIENT")
_LOADING = ("PYTHONPATH", "PYTHONHOME", "LD_LIBRARY_PATH", "LD_PRELOAD")  # variables that decide what a program loads
CLEAN_SHELL = 'env -i HOME="$HOME" TERM="$TERM" bash -l'
EXITED = "exited with status"  # of `stack.graph_probe`: its process ended with an error


def find_shell_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The operator's shell has no DDS set-up, loses it to a later `source`, is older than it, or names another middleware."""
    shell = snapshot.laptop.get(SHELL)
    if shell is None:
        return
    if not shell.exports:
        if snapshot.link is not None and not shell.server:
            yield _missing_setup(snapshot, shell)
        return
    if not shell.exports.get("ROS_DISCOVERY_SERVER"):
        if snapshot.link is not None:
            yield _incomplete_setup(snapshot, shell)
        return
    yield from _carriage_returns(snapshot, shell)
    unsetting = [found for start in shell.start_files if (found := _unsetting_lines(start))]
    yield from (_wrong_source_order(snapshot, *found) for found in unsetting)
    if servers(shell.server) == servers(shell.exports["ROS_DISCOVERY_SERVER"]) or snapshot.link is None:
        yield from _missing_profile(snapshot, shell)
        yield from _wrong_middleware(snapshot, shell)
        yield from _other_graph(snapshot, shell)
        return
    missing = [name for name in shell.exports if not shell.environment.get(name)]
    if shell.server and "ROS_DISCOVERY_SERVER" not in missing:
        expected = shell.exports["ROS_DISCOVERY_SERVER"].strip()
        cause = f"this shell asks the server at {shell.server}, but Lupin's set-up names {expected}"
    else:
        cause = f"this shell has not sourced {shell.exports_path}: programs started in it only multicast"
    yield make_finding(
        "shell-multicast-only",
        where="laptop",
        cause=cause,
        # The other server may be the same robot's, at another address.
        severity=Severity.WARNING if shell.server else _severity_in_this_shell(snapshot),
        evidence=(f"{name}={shell.environment.get(name, '')}" for name in shell.exports),
        command=source_exports(snapshot),
    )


def _severity_in_this_shell(snapshot: Snapshot) -> Severity:
    """Return the severity of what keeps programs of this shell from the robot's data.

    While data is missing here, this takes it away whatever else does. Otherwise the programs of Lupin work nevertheless.
    """
    broken = ground_truth.measure(snapshot).state is ground_truth.State.BROKEN
    return Severity.PROBLEM if broken else Severity.WARNING


def _missing_profile(snapshot: Snapshot, shell: Shell) -> Iterator[Finding]:
    """Yield a finding if this shell asks the discovery server, and nothing makes its programs super clients."""
    if shell.exports.get(_PROFILE) and not any(shell.environment.get(name) for name in _MAKING_SUPER_CLIENTS):
        yield make_finding(
            "shell-without-profile",
            where="laptop",
            cause=f"this shell has no {_PROFILE}, which {shell.exports_path} exports: its programs see only the topics that "
            "they use themselves",
            evidence=(f"{_PROFILE}=", f"ROS_DISCOVERY_SERVER={shell.server}"),
            command=source_exports(snapshot),
        )


def _carriage_returns(snapshot: Snapshot, shell: Shell) -> Iterator[Finding]:
    """Yield a finding for variables of this shell that a script with the line endings of Windows has set."""
    names = sorted(name for name, value in shell.environment.items() if value.endswith("\r") and name not in _LOADING)
    if names:
        in_exports = any(value.endswith("\r") for value in shell.exports.values())
        fix = set_up_laptop(snapshot) if in_exports else FixText(command=source_exports(snapshot))
        yield make_finding(
            "shell-other-graph",
            where="laptop",
            cause=f"{', '.join(names)} in this shell {'ends' if len(names) == 1 else 'end'} with a carriage return, which DDS "
            "takes for a part of the value",
            evidence=(f"{name}={shell.environment[name]!r}" for name in names),
            command=fix.get("command", ""),
            instruction=fix.get("instruction", "")
            or "also give Unix line endings to the script that sets the variables, such as a startup file",
            about="carriage-return",
            explains={"profile-unreadable", "shell-program-fails"},
        )


def _missing_setup(snapshot: Snapshot, shell: Shell) -> Finding:
    return make_finding(
        "dds-not-set-up",
        where="laptop",
        cause="the laptop has no DDS set-up for the robot's discovery server",
        evidence=(f"{shell.exports_path}: no such file, or no exports in it", "ROS_DISCOVERY_SERVER="),
        **set_up_laptop(snapshot),
        # A process older than `lupin dds remove` still names the profile that the command deleted.
        explains={"shell-multicast-only", "profile-unreadable:own"},
    )


def _incomplete_setup(snapshot: Snapshot, shell: Shell) -> Finding:
    return make_finding(
        "dds-not-set-up",
        where="laptop",
        cause=f"{shell.exports_path} exports no ROS_DISCOVERY_SERVER: programs of the next terminal only multicast",
        evidence=(*(f"export {name}={value}" for name, value in shell.exports.items()), f"ROS_DISCOVERY_SERVER={shell.server}"),
        **set_up_laptop(snapshot),
        explains={"shell-multicast-only"},
    )


def _unsetting_lines(start: StartupFile) -> tuple[StartupFile, str, str, str] | None:
    """Return `start`, its line that sources the exports, a later line whose `source` unsets them, and the hook; or None."""
    own = max((at for at, line in enumerate(start.lines) if "ros-env.sh" in line), default=None)
    if own is None:
        return None
    for line in start.lines[own + 1 :]:
        for sourced, hook in start.wipes.items():
            if sourced in line:
                return start, start.lines[own], line, hook
    return None


def _wrong_source_order(snapshot: Snapshot, start: StartupFile, own: str, later: str, hook: str) -> Finding:
    own_line, later_line = own.partition(":")[0], later.partition(":")[0]
    shell = " --shell zsh" if start.path.endswith(".zshrc") else ""
    return make_finding(
        "source-order",
        where="laptop",
        cause=f"{start.path} sources the workspace after ros-env.sh, and a hook of the workspace unsets ROS_DISCOVERY_SERVER",
        evidence=(f"{start.path}:{own}", f"{start.path}:{later}", f"unset by: {hook}"),
        explains={"shell-multicast-only", "process-multicast-only"},
        **set_up_laptop(
            snapshot,
            options=shell,
            instruction=f"the command moves line {own_line} of {start.path} below line {later_line}; reopen other terminals",
        ),
    )


def _wrong_middleware(snapshot: Snapshot, shell: Shell) -> Iterator[Finding]:
    rmw = shell.environment.get("RMW_IMPLEMENTATION", "")
    if shell.server and rmw and rmw not in FAST_DDS:
        yield make_finding(
            "shell-rmw-mismatch",
            where="laptop",
            severity=_severity_in_this_shell(snapshot),
            cause=f"RMW_IMPLEMENTATION={rmw} in this shell: {rmw} reads neither ROS_DISCOVERY_SERVER nor the profile",
            evidence=(f"RMW_IMPLEMENTATION={rmw}", f"ROS_DISCOVERY_SERVER={shell.server}"),
            command="export RMW_IMPLEMENTATION=rmw_fastrtps_cpp",
        )


def _other_graph(snapshot: Snapshot, shell: Shell) -> Iterator[Finding]:
    domains = domains_in_use(snapshot.robot)
    found = misleading_variables(shell.environment, domains or None)
    found.pop("RMW_IMPLEMENTATION", None)  # a finding of its own
    causes = [f"{name}={shell.environment[name]} in this shell: {reason}" for name, reason in found.items()]
    inside = [each for facts in snapshot.machines for each in _first_in(domains, facts)]
    if _lacks_domain(snapshot, shell, domains):
        found["ROS_DOMAIN_ID"] = ""
        causes.append(f"this shell has no ROS_DOMAIN_ID, and programs of robot and laptop are in domain {_only(domains)}")
    if shell.server and found:
        yield make_finding(
            "shell-other-graph",
            where="laptop",
            cause="; ".join(causes),
            evidence=(
                *(f"{name}={shell.environment.get(name, '')}" for name in found),
                f"ROS_DISCOVERY_SERVER={shell.server}",
                *(each.line("ROS_DOMAIN_ID") for each in inside if "ROS_DOMAIN_ID" in found),
            ),
            command=_leave_other_graph(found, domains),
        )


def _lacks_domain(snapshot: Snapshot, shell: Shell, domains: frozenset[int]) -> bool:
    """Return whether robot and laptop use one domain, and only this shell, in which the variable is unset, does not."""
    if shell.environment.get("ROS_DOMAIN_ID") or not _only(domains):
        return False
    return _only(domains) in domains_in_use(snapshot.laptop)


def _first_in(domains: frozenset[int], facts: Facts) -> list[RosProcess]:
    return [each for each in ros_programs(facts) if each.domain in domains][:1]


def _only(domains: frozenset[int]) -> int:
    """Return the domain in which all programs are; 0 if there is none."""
    return next(iter(domains)) if len(domains) == 1 else 0


def _leave_other_graph(found: Iterable[str], domains: frozenset[int]) -> str:
    """Return the command that gives this shell the robot's domain, where that is known, and unsets what else misleads."""
    others = [name for name in found if name != "ROS_DOMAIN_ID"]
    commands = [f"unset {' '.join(others)}"] if others else []
    if "ROS_DOMAIN_ID" in found:
        domain = _only(domains)
        commands.insert(0, f"export ROS_DOMAIN_ID={domain}" if domain else "unset ROS_DOMAIN_ID")
    return "; ".join(commands)


def find_failing_programs(snapshot: Snapshot) -> Iterator[Finding]:
    """A ROS program that is started in this shell ends with an error before it joins any graph."""
    shell, seen = snapshot.laptop.get(SHELL), snapshot.laptop.get(GRAPH)
    errors = [graph.error for graph in seen.graphs if graph.kind != "sim" and EXITED in graph.error] if seen is not None else []
    if seen is None and snapshot.laptop.why_unknown(GRAPH).startswith("unreadable answer"):
        errors = [snapshot.laptop.why_unknown(GRAPH)]
    if not errors or shell is None or shell.environment.get("RMW_IMPLEMENTATION", FAST_DDS[0]) not in FAST_DDS:
        return  # another middleware is a finding of its own
    found = {name: shell.environment[name] for name in _LOADING if shell.environment.get(name)}
    yield make_finding(
        "shell-program-fails",
        where="laptop",
        cause=f"a ROS program that is started in this shell ends with an error: {_last_words(errors[0])}"
        + (f"; variables of this shell decide what it loads: {', '.join(found)}" if found else ""),
        evidence=(*errors, *(f"{name}={value}" for name, value in found.items())),
        # Unsetting them would also take away what a setup file of ROS put there.
        command=CLEAN_SHELL if found else "lupin dds check",
        explains={"graph-not-visited"},
    )


def _last_words(error: str) -> str:
    """Return what a program printed last, without what the probe says about it."""
    return (error.partition(EXITED)[2].partition(": ")[2] or error)[:160]


def find_wrong_shell_server(snapshot: Snapshot) -> Iterator[Finding]:
    """This shell asks a discovery server at an address that the robot does not have, or on a port where nothing listens."""
    shell, addresses, sockets = snapshot.laptop.get(SHELL), snapshot.robot_fact(ADDRESSES), snapshot.robot_fact(SOCKETS)
    if shell is None or addresses is None or sockets is None or snapshot.link is None:
        return
    server = shell.server or shell.exports.get("ROS_DISCOVERY_SERVER", "")
    host, port = server_host(server), server_port(server)
    if not host.replace(".", "").isdigit() or (is_of_examined_robot(snapshot, host) and not addresses.has(host)):
        return  # a name; or the server of another robot that is examined too
    if lost := not addresses.has(host):
        reason = "the robot has no such address"
    elif port != DISCOVERY_PORT and not sockets.on("udp", port):
        reason = f"nothing listens there; the robot's server has port {DISCOVERY_PORT}"
    else:
        return
    is_measured = lost and snapshot.path is not None and snapshot.path.address == host
    yield make_finding(
        "shell-wrong-server",
        where="laptop",
        cause=f"this shell asks the discovery server at {server}: {reason}",
        evidence=(f"ROS_DISCOVERY_SERVER={server}", *(f"robot: {each.line()}" for each in addresses.announced)),
        # Both compare what this shell asks: the one with the profile, the other with the set-up.
        explains={"profile-wrong-address", "shell-multicast-only", *(_ON_THE_WAY if is_measured else ())},
        **set_up_laptop(snapshot),
    )


# What packets to an address that the robot does not have meet.
_ON_THE_WAY = ("address-missing", "no-route", "route-elsewhere", "neighbor-wrong", "link-dead", "udp-lost", "packets-lost")


def find_stale_daemon(snapshot: Snapshot) -> Iterator[Finding]:
    """The daemon of the `ros2` command was started with another discovery server than the shell's."""
    shell, processes = snapshot.laptop.get(SHELL), snapshot.laptop.get(ROS_PROCESSES)
    if shell is None or processes is None:
        return
    expected = shell.server or shell.exports.get("ROS_DISCOVERY_SERVER", "")
    for daemon in processes:
        if daemon.is_daemon and expected and servers(daemon.server) != servers(expected):
            yield make_finding(
                "stale-daemon",
                where="laptop",
                cause=f"the ros2 daemon (process {daemon.pid}) is older than the set-up and asks {daemon.server or 'no one'}",
                evidence=(daemon.line("ROS_DISCOVERY_SERVER"), f"expected: ROS_DISCOVERY_SERVER={expected}"),
                # Not `ros2 daemon stop`: it would look for the daemon of this shell's domain.
                command=f"kill {daemon.pid}",
                instruction="the next `ros2` command starts a new daemon",
            )


CHECKS = (
    Check("dds.shell", find_shell_faults, laptop=(SHELL, ROUTES, GRAPH, ROS_PROCESSES), robot=(ROS_PROCESSES,)),
    Check("dds.shell-server", find_wrong_shell_server, laptop=(SHELL, ROUTES), robot=(ADDRESSES, SOCKETS)),
    Check("dds.shell-program", find_failing_programs, laptop=(SHELL, GRAPH)),
    Check("dds.daemon", find_stale_daemon, laptop=(SHELL, ROS_PROCESSES)),
)
