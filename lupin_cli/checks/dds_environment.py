"""The environment that decides which graph a process joins. A process reads it once, when it starts."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.robot_address import robot_address
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.routes import ROUTES, RoutingTable
from lupin_cli.facts.shell import SHELL, Shell, StartupFile
from lupin_cli.facts.sockets import SOCKETS, Socket, Sockets

# RTPS 2.2, 9.6.1.1: participants that discover by multicast all listen here; clients of a discovery server do not.
MULTICAST_PORT = 7400
_PORTS_PER_DOMAIN = 250
FAST_DDS = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")
_LOCAL = ("127.0.0.1", "localhost", "0.0.0.0")


def server_host(server: str) -> str:
    """Return the host of the first server of a ROS_DISCOVERY_SERVER value."""
    first = next((part for part in server.split(";") if part.strip()), "")
    return first.strip().rpartition(":")[0] or first.strip()


def multicast_socket(process: RosProcess, sockets: Sockets, domains: Iterable[int]) -> Socket | None:
    """Return the socket on which `process` discovers by multicast in one of `domains`, or None. Loopback does not count."""
    ports = {MULTICAST_PORT + _PORTS_PER_DOMAIN * domain for domain in domains}
    bound = (each for each in sockets.of(process.pid) if each.protocol == "udp" and each.is_wildcard)
    return next((each for each in bound if each.port in ports), None)


def find_multicast_only_processes(snapshot: Snapshot) -> Iterator[Finding]:
    """A process was started without ROS_DISCOVERY_SERVER and discovers by multicast only: it hears nothing from the robot."""
    all_processes = [process for facts in snapshot.machines for process in facts.get(ROS_PROCESSES) or ()]
    domains = {process.domain for process in all_processes if process.server} | {0}
    for facts in snapshot.machines:
        processes, sockets = facts.get(ROS_PROCESSES), facts.get(SOCKETS)
        if processes is None or sockets is None:
            continue
        clients = [each for each in processes if each.server and not each.is_daemon]
        if not clients and not (facts.machine == "laptop" and snapshot.link is not None):
            continue  # no process of this machine uses a discovery server, and the operator selected no robot
        for process in processes:
            # `lupin up` sets the variables itself before it joins: only the sockets show which graph it is in.
            socket = multicast_socket(process, sockets, domains)
            if process.server or process.is_daemon or process.is_server or process.stale_reason or socket is None:
                continue
            yield make_finding(
                "process-multicast-only",
                where=facts.machine,
                cause=f"{process.name} (process {process.pid}) was started without ROS_DISCOVERY_SERVER: it only multicasts",
                evidence=(
                    process.line("ROS_DISCOVERY_SERVER", "FASTRTPS_DEFAULT_PROFILES_FILE", "RMW_IMPLEMENTATION"),
                    socket.line(),
                    *(each.line("ROS_DISCOVERY_SERVER") for each in clients[:1]),
                ),
                command=f"terminate process {process.pid} and start it again from a shell where ROS_DISCOVERY_SERVER is set",
            )


def find_wrong_server(snapshot: Snapshot) -> Iterator[Finding]:
    """A process asks a discovery server at an address that the robot does not have, or that the laptop cannot reach.

    If the robot cannot be asked, the addresses by which the laptop knows it count as its addresses; a broken link to them is
    another finding.
    """
    addresses, routes = snapshot.robot_fact(ADDRESSES), snapshot.laptop.get(ROUTES)
    if addresses is not None:
        known = {each.address: each.line() for each in addresses.entries}
        mismatch = "the robot has no such address"
    elif snapshot.robot is None and routes is not None and routes.to_robot:
        known = {address: f"ip route get {address}: {' '.join(lines)}" for address, lines in routes.to_robot.items()}
        routes = None
        mismatch = f"the laptop knows the robot by {' and '.join(known)}"
    else:
        return
    for facts in snapshot.machines:
        for process in facts.get(ROS_PROCESSES) or ():
            if process.is_daemon or not process.server:
                continue
            reason = _server_fault(server_host(process.server), facts.machine == "laptop", known, mismatch, routes)
            if reason:
                yield make_finding(
                    "process-wrong-server",
                    where=facts.machine,
                    cause=f"{process.name} (process {process.pid}) asks the server at {process.server}: {reason}",
                    evidence=(process.line("ROS_DISCOVERY_SERVER"), *known.values()),
                    command=f"lupin dds setup {_setup_address(snapshot)}; then start {process.name} again",
                )


def _server_fault(host: str, on_laptop: bool, known: Container[str], mismatch: str, routes: RoutingTable | None) -> str:
    """Return why `host` is the wrong server for a process, with `mismatch` for an unknown host; empty if it may be right."""
    if not host.replace(".", "").isdigit():
        return ""  # a name: the process may resolve it differently
    if host in _LOCAL:
        return "that is the laptop, not the robot" if on_laptop else ""
    if host not in known:
        return mismatch
    unroutable = on_laptop and routes is not None and not routes.leads_to(host)
    return "the laptop has no route to it" if unroutable else ""


def _setup_address(snapshot: Snapshot) -> str:
    return robot_address(snapshot) or (snapshot.link.address if snapshot.link else "")


def find_rmw_mismatch(snapshot: Snapshot) -> Iterator[Finding]:
    """A process uses a middleware other than Fast DDS, the only one that reads the server's address and the profile."""
    located = [(facts, process) for facts in snapshot.machines for process in facts.get(ROS_PROCESSES) or ()]
    for facts, process in located:
        others = [o for _, o in located if o is not process and o.rmw in FAST_DDS and o.domain == process.domain]
        if not process.rmw or process.rmw in FAST_DDS or not (process.server or others):
            continue
        yield make_finding(
            "rmw-mismatch",
            where=facts.machine,
            cause=f"{process.name} (process {process.pid}) runs on {process.rmw}, the others on rmw_fastrtps_cpp",
            evidence=(each.line("RMW_IMPLEMENTATION") for each in (process, *others[:1])),
            command=f"terminate process {process.pid} and start it again with: export RMW_IMPLEMENTATION=rmw_fastrtps_cpp",
            explains={"process-multicast-only", "process-wrong-server"},
        )


def find_shell_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The operator's shell has no DDS set-up, loses it to a later `source`, is older than it, or names another middleware."""
    shell = snapshot.laptop.get(SHELL)
    if shell is None:
        return
    if not shell.exports:
        if snapshot.link is not None and not shell.server:
            yield _missing_setup(snapshot, shell)
        return
    unsetting = [found for start in shell.start_files if (found := _unsetting_lines(start))]
    yield from (_wrong_source_order(*found) for found in unsetting)
    if shell.server == shell.exports.get("ROS_DISCOVERY_SERVER", "") or snapshot.link is None:
        yield from _wrong_middleware(shell)
        return
    missing = [name for name in shell.exports if not shell.environment.get(name)]
    if shell.server and "ROS_DISCOVERY_SERVER" not in missing:
        expected = shell.exports["ROS_DISCOVERY_SERVER"]
        cause = f"this shell asks the server at {shell.server}, but Lupin's set-up names {expected}"
    else:
        cause = f"this shell has not sourced {shell.exports_path}: programs started in it only multicast"
    yield make_finding(
        "shell-multicast-only",
        where="laptop",
        cause=cause,
        evidence=(f"{name}={shell.environment.get(name, '')}" for name in shell.exports),
        command=f"source {shell.exports_path}",
    )


def _missing_setup(snapshot: Snapshot, shell: Shell) -> Finding:
    return make_finding(
        "dds-not-set-up",
        where="laptop",
        cause="the laptop has no DDS set-up for the robot's discovery server",
        evidence=(f"{shell.exports_path}: no such file, or no exports in it", "ROS_DISCOVERY_SERVER="),
        command=f"lupin dds setup {_setup_address(snapshot)}",
        # A process older than `lupin dds remove` still names the profile that the command deleted.
        explains={"shell-multicast-only", "profile-unreadable:own"},
    )


def _unsetting_lines(start: StartupFile) -> tuple[StartupFile, str, str, str] | None:
    """Return `start`, its line that sources the exports, a later line whose `source` unsets them, and the hook; or None."""
    own = next((at for at, line in enumerate(start.lines) if "ros-env.sh" in line), None)
    if own is None:
        return None
    for line in start.lines[own + 1 :]:
        for sourced, hook in start.wipes.items():
            if sourced in line:
                return start, start.lines[own], line, hook
    return None


def _wrong_source_order(start: StartupFile, own: str, later: str, hook: str) -> Finding:
    own_line, later_line = own.partition(":")[0], later.partition(":")[0]
    return make_finding(
        "source-order",
        where="laptop",
        cause=f"{start.path} sources the workspace after ros-env.sh, and a hook of the workspace unsets ROS_DISCOVERY_SERVER",
        evidence=(f"{start.path}:{own}", f"{start.path}:{later}", f"unset by: {hook}"),
        command=f"move line {own_line} of {start.path} below line {later_line}; then: exec $SHELL",
        explains={"shell-multicast-only", "process-multicast-only"},
    )


def _wrong_middleware(shell: Shell) -> Iterator[Finding]:
    rmw = shell.environment.get("RMW_IMPLEMENTATION", "")
    if shell.server and rmw and rmw not in FAST_DDS:
        yield make_finding(
            "shell-rmw-mismatch",
            where="laptop",
            cause=f"RMW_IMPLEMENTATION={rmw} in this shell: {rmw} reads neither ROS_DISCOVERY_SERVER nor the profile",
            evidence=(f"RMW_IMPLEMENTATION={rmw}", f"ROS_DISCOVERY_SERVER={shell.server}"),
            command="export RMW_IMPLEMENTATION=rmw_fastrtps_cpp",
        )


def find_stale_daemon(snapshot: Snapshot) -> Iterator[Finding]:
    """The daemon of the `ros2` command was started with another discovery server than the shell's."""
    shell, processes = snapshot.laptop.get(SHELL), snapshot.laptop.get(ROS_PROCESSES)
    if shell is None or processes is None:
        return
    expected = shell.server or shell.exports.get("ROS_DISCOVERY_SERVER", "")
    for daemon in processes:
        if daemon.is_daemon and expected and daemon.server != expected:
            yield make_finding(
                "stale-daemon",
                where="laptop",
                cause=f"the ros2 daemon (process {daemon.pid}) is older than the set-up and asks {daemon.server or 'no one'}",
                evidence=(daemon.line("ROS_DISCOVERY_SERVER"), f"expected: ROS_DISCOVERY_SERVER={expected}"),
                command="ros2 daemon stop",
            )


_PROCESSES = (ROS_PROCESSES, SOCKETS)
CHECKS = (
    Check("dds.processes", find_multicast_only_processes, laptop=_PROCESSES, robot=_PROCESSES),
    Check("dds.wrong-server", find_wrong_server, laptop=(ROS_PROCESSES, ROUTES), robot=(ROS_PROCESSES, ADDRESSES)),
    Check("dds.middleware", find_rmw_mismatch, laptop=(ROS_PROCESSES,), robot=(ROS_PROCESSES,)),
    Check("dds.shell", find_shell_faults, laptop=(SHELL, ROUTES)),
    Check("dds.daemon", find_stale_daemon, laptop=(SHELL, ROS_PROCESSES)),
)
