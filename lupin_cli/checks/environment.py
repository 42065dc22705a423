"""Which graph a process is in is settled by its environment when it starts, and a shell elsewhere tells nothing of it."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.way import robot_address
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.base import Facts
from lupin_cli.facts.link import Link
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.routes import ROUTES, Routes
from lupin_cli.facts.shell import SHELL, Shell, StartFile
from lupin_cli.facts.sockets import SOCKETS, Socket, Sockets

# RTPS 2.2, 9.6.1.1: participants that discover by multicast all listen here; those of a discovery server don't.
MULTICAST_PORT = 7400
_PORTS_PER_DOMAIN = 250
FAST_DDS = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")
_LOCAL = ("127.0.0.1", "localhost", "0.0.0.0")


def host_of(server: str) -> str:
    """The host of the first server of a ROS_DISCOVERY_SERVER value."""
    first = next((part for part in server.split(";") if part.strip()), "")
    return first.strip().rpartition(":")[0] or first.strip()


def machines(evidence: Evidence) -> Iterable[Facts]:
    """This machine and, where it was reached, the robot."""
    return (evidence.laptop,) if evidence.robot is None else (evidence.laptop, evidence.robot)


def multicast_socket(process: RosProcess, sockets: Sockets, domains: Iterable[int]) -> Socket | None:
    """The socket on which `process` discovers by multicast beyond this machine, in one of `domains`; None where it doesn't."""
    ports = {MULTICAST_PORT + _PORTS_PER_DOMAIN * domain for domain in domains}
    bound = (each for each in sockets.of(process.pid) if each.protocol == "udp" and each.anywhere)
    return next((each for each in bound if each.port in ports), None)


def find_dead_processes(evidence: Evidence) -> Iterator[Finding]:
    """Processes that live and hear nothing of the robot: started from a shell without the graph's three variables."""
    every = [process for facts in machines(evidence) for process in facts.get(ROS_PROCESSES) or ()]
    domains = {process.domain for process in every if process.server} | {0}
    for facts in machines(evidence):
        processes, sockets = facts.get(ROS_PROCESSES), facts.get(SOCKETS)
        if processes is None or sockets is None:
            continue
        joined = [each for each in processes if each.server and not each.is_daemon]
        if not joined and not (facts.machine == "laptop" and isinstance(evidence.link, Link)):
            continue  # nobody here is in a server's graph, and nobody asked for a robot's
        for process in processes:
            # `lupin up` sets the variables for itself before it joins: only the sockets tell which graph it is in.
            there = multicast_socket(process, sockets, domains)
            if process.server or process.is_daemon or process.is_server or process.outlived or there is None:
                continue
            yield Finding(
                id="process-multicast-only",
                severity=Severity.PROBLEM,
                where=facts.machine,
                symptom=f"{process.name} says it is live, and shows no telemetry; a fresh terminal sees everything",
                cause=f"{process.name} (process {process.pid}) was started without ROS_DISCOVERY_SERVER: it only multicasts",
                evidence=(
                    process.line("ROS_DISCOVERY_SERVER", "FASTRTPS_DEFAULT_PROFILES_FILE", "RMW_IMPLEMENTATION"),
                    there.line(),
                    *(each.line("ROS_DISCOVERY_SERVER") for each in joined[:1]),
                ),
                fix=Fix(f"end process {process.pid} and start it again from a shell where ROS_DISCOVERY_SERVER is set"),
            )


def find_wrong_server(evidence: Evidence) -> Iterator[Finding]:
    """Processes whose server is at an address that the robot doesn't have, or that this machine can't reach.

    A robot that can't be asked for its addresses has those by which it is known here; what is the matter with the way there is
    told by itself.
    """
    addresses, routes = evidence.robot.get(ADDRESSES) if evidence.robot else None, evidence.laptop.get(ROUTES)
    if addresses is not None:
        known = {each.address: each.line() for each in addresses.every}
        stray = "the robot has no such address"
    elif evidence.robot is None and routes is not None and routes.to_robot:
        known = {address: f"ip route get {address}: {' '.join(lines)}" for address, lines in routes.to_robot.items()}
        routes = None
        stray = f"the robot is known here by {' and '.join(known)}"
    else:
        return
    for facts in machines(evidence):
        for process in facts.get(ROS_PROCESSES) or ():
            if process.is_daemon or not process.server:
                continue
            why = _why_wrong(host_of(process.server), facts.machine == "laptop", known, stray, routes)
            if why:
                yield Finding(
                    id="process-wrong-server",
                    severity=Severity.PROBLEM,
                    where=facts.machine,
                    symptom=f"{process.name} lives, and nothing of the robot reaches it",
                    cause=f"{process.name} (process {process.pid}) asks the server at {process.server}: {why}",
                    evidence=(process.line("ROS_DISCOVERY_SERVER"), *known.values()),
                    fix=Fix(f"lupin dds setup {_address_of(evidence)}; then start {process.name} again"),
                )


def _why_wrong(host: str, on_laptop: bool, known: Container[str], stray: str, routes: Routes | None) -> str:
    if not host.replace(".", "").isdigit():
        return ""  # a name: whoever resolves it may know better
    if host in _LOCAL:
        return "that is this laptop, not the robot" if on_laptop else ""
    if host not in known:
        return stray
    lost = on_laptop and routes is not None and not routes.leads_to(host)
    return "no route of this machine leads there" if lost else ""


def _address_of(evidence: Evidence) -> str:
    return robot_address(evidence) or (evidence.link.address if isinstance(evidence.link, Link) else "")


def find_middleware(evidence: Evidence) -> Iterator[Finding]:
    """Processes on another middleware than Fast DDS: only that reads the server's address and the profile."""
    every = [(facts, process) for facts in machines(evidence) for process in facts.get(ROS_PROCESSES) or ()]
    for facts, process in every:
        others = [o for _, o in every if o is not process and o.rmw in FAST_DDS and o.domain == process.domain]
        if not process.rmw or process.rmw in FAST_DDS or not (process.server or others):
            continue
        yield Finding(
            id="rmw-mismatch",
            severity=Severity.PROBLEM,
            where=facts.machine,
            symptom=f"{process.name} neither hears the other nodes nor is heard by them",
            cause=f"{process.name} (process {process.pid}) runs on {process.rmw}, the others on rmw_fastrtps_cpp",
            evidence=tuple(each.line("RMW_IMPLEMENTATION") for each in (process, *others[:1])),
            fix=Fix(f"end process {process.pid} and start it again with: export RMW_IMPLEMENTATION=rmw_fastrtps_cpp"),
            explains=frozenset({"process-multicast-only", "process-wrong-server"}),
        )


def find_shell(evidence: Evidence) -> Iterator[Finding]:
    """The shell that asks: not set up at all, wiped by what its start file sources later, or older than the set-up."""
    shell = evidence.laptop.get(SHELL)
    if shell is None:
        return
    if not shell.exports:
        if isinstance(evidence.link, Link) and not shell.server:
            yield _not_set_up(evidence, shell)
        return
    wiped = [found for start in shell.start_files if (found := _wiped(start))]
    yield from (_wrong_order(shell, *found) for found in wiped)
    if shell.server == shell.exports.get("ROS_DISCOVERY_SERVER", "") or not isinstance(evidence.link, Link):
        yield from _wrong_middleware(shell)
        return
    missing = [name for name in shell.exports if not shell.environment.get(name)]
    if shell.server and "ROS_DISCOVERY_SERVER" not in missing:
        cause = (
            f"this shell asks the server at {shell.server}, Lupin's set-up the one at {shell.exports['ROS_DISCOVERY_SERVER']}"
        )
    else:
        cause = f"this shell has not sourced {shell.exports_path}: what it starts only multicasts"
    yield Finding(
        id="shell-multicast-only",
        severity=Severity.WARNING,
        where="laptop",
        symptom="ros2 topic list returns 2 in this terminal: /parameter_events and /rosout",
        cause=cause,
        evidence=tuple(f"{name}={shell.environment.get(name, '')}" for name in shell.exports),
        fix=Fix(f"source {shell.exports_path}"),
    )


def _not_set_up(evidence: Evidence, shell: Shell) -> Finding:
    return Finding(
        id="dds-not-set-up",
        severity=Severity.WARNING,
        where="laptop",
        symptom="ros2 topic list returns 2 in every terminal of this machine",
        cause="this machine has never been told of the robot's discovery server",
        evidence=(f"{shell.exports_path}: no such file, or no exports in it", "ROS_DISCOVERY_SERVER="),
        fix=Fix(f"lupin dds setup {_address_of(evidence)}"),
        # A process that was started before the set-up was taken back names the profile that went with it.
        explains=frozenset({"shell-multicast-only", "profile-unreadable:own"}),
    )


def _wiped(start: StartFile) -> tuple[StartFile, str, str, str] | None:
    """The line that sources the exports, the later line that undoes it, and the hook that does."""
    own = next((at for at, line in enumerate(start.lines) if "ros-env.sh" in line), None)
    if own is None:
        return None
    for line in start.lines[own + 1 :]:
        for sourced, hook in start.wipes.items():
            if sourced in line:
                return start, start.lines[own], line, hook
    return None


def _wrong_order(shell: Shell, start: StartFile, own: str, later: str, hook: str) -> Finding:
    return Finding(
        id="source-order",
        severity=Severity.PROBLEM,
        where="laptop",
        symptom="every new terminal lists 2 topics, although ros-env.sh is sourced",
        cause=f"{start.path} sources the workspace after ros-env.sh, and a hook of it unsets ROS_DISCOVERY_SERVER",
        evidence=(f"{start.path}:{own}", f"{start.path}:{later}", f"unsets it: {hook}"),
        fix=Fix(f"move line {own.partition(':')[0]} of {start.path} below line {later.partition(':')[0]}; then: exec $SHELL"),
        explains=frozenset({"shell-multicast-only", "process-multicast-only"}),
    )


def _wrong_middleware(shell: Shell) -> Iterator[Finding]:
    rmw = shell.environment.get("RMW_IMPLEMENTATION", "")
    if shell.server and rmw and rmw not in FAST_DDS:
        yield Finding(
            id="shell-rmw-mismatch",
            severity=Severity.WARNING,
            where="laptop",
            symptom="what this terminal starts neither hears the robot nor is heard by it",
            cause=f"RMW_IMPLEMENTATION={rmw} in this shell: it reads neither ROS_DISCOVERY_SERVER nor the profile",
            evidence=(f"RMW_IMPLEMENTATION={rmw}", f"ROS_DISCOVERY_SERVER={shell.server}"),
            fix=Fix("export RMW_IMPLEMENTATION=rmw_fastrtps_cpp"),
        )


def find_stale_daemon(evidence: Evidence) -> Iterator[Finding]:
    """The daemon of the `ros2` command answers for the graph that it was started in, not for the shell's."""
    shell, processes = evidence.laptop.get(SHELL), evidence.laptop.get(ROS_PROCESSES)
    if shell is None or processes is None:
        return
    wanted = shell.server or shell.exports.get("ROS_DISCOVERY_SERVER", "")
    for daemon in processes:
        if daemon.is_daemon and wanted and daemon.server != wanted:
            yield Finding(
                id="stale-daemon",
                severity=Severity.WARNING,
                where="laptop",
                symptom="ros2 topic list shows another graph than ros2 topic echo in the same terminal",
                cause=f"the ros2 daemon (process {daemon.pid}) is older than the set-up: it asks {daemon.server or 'nobody'}",
                evidence=(daemon.line("ROS_DISCOVERY_SERVER"), f"wanted: ROS_DISCOVERY_SERVER={wanted}"),
                fix=Fix("ros2 daemon stop"),
            )


_PROCESSES = (ROS_PROCESSES, SOCKETS)
CHECKS = (
    Check("dds.processes", find_dead_processes, laptop=_PROCESSES, robot=_PROCESSES),
    Check("dds.wrong-server", find_wrong_server, laptop=(ROS_PROCESSES, ROUTES), robot=(ROS_PROCESSES, ADDRESSES)),
    Check("dds.middleware", find_middleware, laptop=(ROS_PROCESSES,), robot=(ROS_PROCESSES,)),
    Check("dds.shell", find_shell, laptop=(SHELL, ROUTES)),
    Check("dds.daemon", find_stale_daemon, laptop=(SHELL, ROS_PROCESSES)),
)
