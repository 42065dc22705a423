"""The environment that decides which graph a process joins. A process reads it once, when it starts."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping

from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.layers import EVERYTHING
from lupin_cli.checks.remote_command import FixText, remove_assignments, restart_processes, service_of, source_exports
from lupin_cli.checks.robot_address import is_of_examined_robot, robot_address
from lupin_cli.facts.addresses import ADDRESSES
from lupin_cli.facts.base import Facts
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.routes import ROUTES, RoutingTable
from lupin_cli.facts.sockets import SOCKETS, Socket, Sockets
from lupin_cli.facts.units import UNIT_STATES
from lupin_runtime.ports import DISCOVERY_PORT

# RTPS 2.2, 9.6.1.1: participants that discover by multicast all listen here; clients of a discovery server do not.
MULTICAST_PORT = 7400
_PORTS_PER_DOMAIN = 250
FAST_DDS = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")
_SHOWN_PROCESSES = 4
_SERVER = "ROS_DISCOVERY_SERVER"
_NO_ROUTE = "the laptop has no route to it"
_BY_DEFAULT_ROUTE = "only the laptop's default route leads there, so hardly to the robot"
_LOCAL = ("127.0.0.1", "localhost", "0.0.0.0")


# Values of FASTDDS_BUILTIN_TRANSPORTS without UDP over IPv4, in which all addresses of this project are.
_WITHOUT_UDP = ("SHM", "UDPv6", "DEFAULTv6", "NONE")
_OWN_MACHINE = ("LOCALHOST", "OFF")  # values of ROS_AUTOMATIC_DISCOVERY_RANGE


def misleading_variables(environment: Mapping[str, str], domains: Container[int] | None) -> dict[str, str]:
    """Return the variables with which a process joins another graph than the robot's, each with what it does.

    `domains` are those of the other machine; None if they are not known.
    """
    found = {}
    rmw, domain = environment.get("RMW_IMPLEMENTATION", ""), environment.get("ROS_DOMAIN_ID", "")
    if rmw and rmw not in FAST_DDS:
        found["RMW_IMPLEMENTATION"] = f"{rmw} reads neither ROS_DISCOVERY_SERVER nor the profile"
    if domain.isdigit() and domains is not None and int(domain) not in domains:
        found["ROS_DOMAIN_ID"] = "nothing on the other machine is in that domain"
    if environment.get("ROS_LOCALHOST_ONLY") == "1":
        found["ROS_LOCALHOST_ONLY"] = "its DDS uses no address but 127.0.0.1"
    if environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper() in _OWN_MACHINE:
        found["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "its DDS looks for no other machine"
    if environment.get("FASTDDS_BUILTIN_TRANSPORTS", "").partition("?")[0] in _WITHOUT_UDP:
        found["FASTDDS_BUILTIN_TRANSPORTS"] = "its DDS sends nothing over IPv4"
    return found


def ros_programs(facts: Facts | None) -> tuple[RosProcess, ...]:
    """Return the ROS programs of a machine that a person or a service runs.

    The `ros2` daemon, discovery servers, the doctor's own probes and what a dead launch left behind are none.
    """
    processes = facts.get(ROS_PROCESSES) if facts is not None else None
    return tuple(
        each for each in processes or () if not (each.is_daemon or each.is_server or each.is_graph_probe or each.stale_reason)
    )


def domains_in_use(facts: Facts | None) -> frozenset[int]:
    """Return the DDS domains of a machine's ROS programs; empty if they are not known, or there are none."""
    return frozenset(process.domain for process in ros_programs(facts))


def server_host(server: str) -> str:
    """Return the host of the first server of a ROS_DISCOVERY_SERVER value."""
    first = next((part for part in server.split(";") if part.strip()), "")
    return first.strip().rpartition(":")[0] or first.strip()


def server_port(server: str) -> int:
    """Return the port of the first server of a ROS_DISCOVERY_SERVER value; DDS uses the usual one if none is given."""
    first = next((part for part in server.split(";") if part.strip()), "")
    port = first.strip().rpartition(":")[2]
    return int(port) if ":" in first and port.isdigit() else DISCOVERY_PORT


def servers(value: str) -> tuple[tuple[str, int], ...]:
    """Return host and port of each server of a ROS_DISCOVERY_SERVER value, which several texts may stand for.

    The place of a server in the list is its id, so empty places count, but not at the end.
    """
    parts = [part.strip() for part in value.rstrip("; \t\r").split(";")] if value.strip("; \t\r") else []
    return tuple((server_host(part), server_port(part)) if part else ("", 0) for part in parts)


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
                **restart_processes(snapshot, facts.machine, [process], again=_where_set_up(snapshot, facts.machine)),
                breaks=(EVERYTHING,) if facts.machine == "robot" else (),
            )


def _where_set_up(snapshot: Snapshot, machine: str) -> str:
    """Return where a program is started so that it gets Lupin's DDS set-up."""
    then = source_exports(snapshot) if machine == "laptop" else ""
    return f"in a terminal after: {then}" if then else "where ROS_DISCOVERY_SERVER is set"


def find_wrong_server(snapshot: Snapshot) -> Iterator[Finding]:
    """A process asks a discovery server at an address that the robot does not have, or that the laptop cannot reach.

    A program of the laptop may be for another robot that is examined too. If the robot cannot be asked, the addresses by which
    the laptop knows it count as its addresses; a broken link to them is another finding.
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
        on_laptop = facts.machine == "laptop"
        asking: dict[tuple[str, str, str], list[RosProcess]] = {}
        for process in facts.get(ROS_PROCESSES) or ():
            if process.is_daemon or not process.server:
                continue
            if reason := _server_fault(snapshot, server_host(process.server), on_laptop, known, mismatch, routes):
                # The processes of a unit of the robot have their variables from one place.
                place = str(process.pid) if on_laptop else service_of(process)
                asking.setdefault((place, process.server, reason), []).append(process)
        for (_, server, reason), processes in asking.items():
            severity = Severity.WARNING if reason == _BY_DEFAULT_ROUTE else None
            what = f"the server at {server}: {reason}"
            yield _wrong_server(snapshot, facts.machine, processes, what, known.values(), severity)


def _wrong_server(
    snapshot: Snapshot, machine: str, processes: list[RosProcess], what: str, known: Iterable[str], severity: Severity | None
) -> Finding:
    named = [f"{process.name} (process {process.pid})" for process in processes[:_SHOWN_PROCESSES]]
    more = [f"{len(processes) - _SHOWN_PROCESSES} more"] if len(processes) > _SHOWN_PROCESSES else []
    subject = f"{', '.join((*named, *more))} {'asks' if len(processes) == 1 else 'ask'}"
    return make_finding(
        "process-wrong-server",
        where=machine,
        severity=severity,
        about=f"{machine} {processes[0].server}",
        cause=f"{subject} {what}",
        evidence=(*(process.line("ROS_DISCOVERY_SERVER") for process in processes[:_SHOWN_PROCESSES]), *known),
        breaks=(EVERYTHING,) if machine == "robot" else (),
        **_ask_another_server(snapshot, machine, processes),
    )


def _ask_another_server(snapshot: Snapshot, machine: str, processes: list[RosProcess]) -> FixText:
    service = service_of(processes[0]) if machine == "robot" else ""
    fix = restart_processes(snapshot, machine, processes, again=_where_set_up(snapshot, machine))
    if not service:
        return fix
    units = snapshot.robot_fact(UNIT_STATES)
    unit = units.get(service) if units is not None else None
    if unit is not None and unit.files_setting(_SERVER, processes[0].server):
        return remove_assignments(snapshot, unit, [_SERVER])
    fix["instruction"] = f"if they ask it again after the restart, correct {_SERVER} in the scripts that {service} sources"
    return fix


def _server_fault(
    snapshot: Snapshot, host: str, on_laptop: bool, known: Container[str], mismatch: str, routes: RoutingTable | None
) -> str:
    """Return why `host` is the wrong server for a process, with `mismatch` for an unknown host; empty if it may be right."""
    if not host.replace(".", "").isdigit():
        return ""  # a name: the process may resolve it differently
    if host in _LOCAL:
        return "that is the laptop, not the robot" if on_laptop else ""
    if host not in known:
        return "" if on_laptop and is_of_examined_robot(snapshot, host) else mismatch
    if not on_laptop or routes is None:
        return ""
    if routes.refuses(host):
        return _NO_ROUTE
    address = robot_address(snapshot)
    if host == address or routes.leads_to(host):
        return ""
    if routes.best(host) is None:
        return _NO_ROUTE
    # A gateway that leads to the robot may lead to its other addresses, too.
    return _BY_DEFAULT_ROUTE if not address or routes.leads_to(address) else ""


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
            explains={"process-multicast-only", "process-wrong-server"},
            breaks=(EVERYTHING,) if facts.machine == "robot" else (),
            **restart_processes(
                snapshot, facts.machine, [process], again="in a terminal after: export RMW_IMPLEMENTATION=rmw_fastrtps_cpp"
            ),
        )


_PROCESSES = (ROS_PROCESSES, SOCKETS)
CHECKS = (
    Check("dds.processes", find_multicast_only_processes, laptop=_PROCESSES, robot=_PROCESSES),
    Check("dds.wrong-server", find_wrong_server, laptop=(ROS_PROCESSES, ROUTES), robot=(ROS_PROCESSES, ADDRESSES, UNIT_STATES)),
    Check("dds.middleware", find_rmw_mismatch, laptop=(ROS_PROCESSES,), robot=(ROS_PROCESSES,)),
)
