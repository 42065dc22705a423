"""The robot's discovery server. The vendor's start script starts it once and never monitors it."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Snapshot
from lupin_cli.checks.dds_environment import server_host
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.remote_command import command_on_robot, robot_option
from lupin_cli.facts.discovery_log import DISCOVERY_LOG, DiscoveryLog
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.sockets import SOCKETS, Socket
from lupin_runtime.ports import DISCOVERY_PORT

# `env -u`: with the vendor's profile in its environment the server inherits a pinned locator and fails even on a free port.
START_SERVER = (
    "env -u FASTRTPS_DEFAULT_PROFILES_FILE setsid fast-discovery-server -i 0 -l 0.0.0.0 "
    f"-p {DISCOVERY_PORT} >/tmp/lupin-discovery.log 2>&1 </dev/null &"
)
STARTING_S = 5.0  # the script starts the server first; on a busy robot that takes seconds
_SWITCH_ON = "echo export MIRTE_FASTDDS=true >> ~/.mirte_settings.sh; sudo systemctl restart mirte-ros.service"


def find_server_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot has no usable discovery server: none listens, another program has its port, or it is stopped or pinned."""
    sockets, log = snapshot.robot_fact(SOCKETS), snapshot.robot_fact(DISCOVERY_LOG)
    processes = snapshot.robot_fact(ROS_PROCESSES)
    if sockets is None or log is None or processes is None:
        return
    bound = sockets.on("udp", DISCOVERY_PORT)
    clients = [each for each in processes if _asks_local_server(each)]
    if log.vendor in ("active", "activating") and not log.server_enabled and not bound:
        yield _disabled_server(snapshot, log)
    elif bound:
        yield from _taken_port(snapshot, bound, processes)
        yield from _stopped_server(snapshot, bound, processes)
        yield from _pinned_server(snapshot, bound)
    elif (clients or (log.server_enabled and log.vendor == "active")) and not _is_starting(log, processes):
        yield _missing_server(snapshot, log, clients)


def _is_starting(log: DiscoveryLog, processes: tuple[RosProcess, ...]) -> bool:
    """Return whether the vendor's script may be about to start the server: the doctor may run during boot."""
    if log.journal:
        return False  # it has failed already
    young = log.vendor_age_s is not None and log.vendor_age_s < STARTING_S
    return young or any(process.is_server and process.age_s < STARTING_S for process in processes)


def lacks_server(snapshot: Snapshot) -> bool:
    """Return whether the vendor's stack runs on the robot while nothing listens on the discovery server's port."""
    sockets = snapshot.robot_fact(SOCKETS)
    log = snapshot.robot_fact(DISCOVERY_LOG)
    return sockets is not None and log is not None and log.vendor == "active" and not sockets.on("udp", DISCOVERY_PORT)


def _asks_local_server(process: RosProcess) -> bool:
    return server_host(process.server) in ("127.0.0.1", "localhost")


def _missing_server(snapshot: Snapshot, log: DiscoveryLog, clients: list[RosProcess]) -> Finding:
    journal = " ".join(log.journal).lower()
    explains = OVER_GRAPH
    if "not found" in journal:
        explains |= {"profile-unreadable:robot"}  # the script that writes the profile did not find its tools either
        reason = "the vendor's script did not find fast-discovery-server: PATH was incomplete when it ran"
    elif "allocate" in journal:
        reason = "the vendor's script started it before its address existed (wlan0 came up late), and did not try again"
    else:
        reason = "it has exited, or was never started; the vendor's script starts it once and does not restart it"
    return make_finding(
        "discovery-server-missing",
        where="robot",
        cause=f"no discovery server listens on UDP {DISCOVERY_PORT}: {reason}",
        evidence=(
            *log.journal,
            f"ss -lnu: no line with :{DISCOVERY_PORT}",
            *(each.line("ROS_DISCOVERY_SERVER") for each in clients[:3]),
        ),
        command=command_on_robot(snapshot, START_SERVER),
        explains=explains,
    )


def _disabled_server(snapshot: Snapshot, log: DiscoveryLog) -> Finding:
    return make_finding(
        "discovery-server-switched-off",
        where="robot",
        cause="the vendor's settings do not enable the discovery server, so its nodes multicast, which WiFi drops",
        evidence=(f"~/.mirte_settings.sh: MIRTE_FASTDDS={log.switch or '(unset)'}", f"mirte-ros.service: {log.vendor}"),
        command=command_on_robot(snapshot, _SWITCH_ON),
        explains=OVER_GRAPH | {"process-multicast-only"},
    )


def _recover_command(snapshot: Snapshot) -> str:
    return f"lupin play recover-discovery{robot_option(snapshot)}"


def _taken_port(snapshot: Snapshot, bound: tuple[Socket, ...], processes: tuple[RosProcess, ...]) -> Iterator[Finding]:
    ros_pids = {process.pid for process in processes}
    for socket in bound:
        known = socket.pid and socket.process
        if known and socket.pid not in ros_pids and not socket.process.startswith("fast-discovery"):
            yield make_finding(
                "discovery-port-taken",
                where="robot",
                cause=f"{socket.process} holds UDP {DISCOVERY_PORT} and is not a discovery server",
                evidence=(socket.line(), socket.command),
                command=f"terminate process {socket.pid} ({socket.command or socket.process}), "
                f"then: {_recover_command(snapshot)}",
                explains=OVER_GRAPH | {"discovery-server-pinned"},
            )


def _stopped_server(snapshot: Snapshot, bound: tuple[Socket, ...], processes: tuple[RosProcess, ...]) -> Iterator[Finding]:
    owners = {socket.pid for socket in bound}
    for process in processes:
        if process.pid in owners and process.state in ("T", "t"):
            yield make_finding(
                "discovery-server-stopped",
                where="robot",
                cause=f"the discovery server (process {process.pid}) is stopped: it holds its port but answers no client",
                evidence=(process.line(), f"state {process.state} in /proc/{process.pid}/stat"),
                command=command_on_robot(snapshot, f"kill -CONT {process.pid}"),
                explains=OVER_GRAPH,
            )


def _pinned_server(snapshot: Snapshot, bound: tuple[Socket, ...]) -> Iterator[Finding]:
    for socket in bound:
        words = shlex.split(socket.command) if socket.command.count('"') % 2 == 0 and "'" not in socket.command else []
        argument = next((words[at + 1] for at, word in enumerate(words[:-1]) if word in ("-l", "--ip-address")), "0.0.0.0")
        address = socket.address if not socket.is_wildcard else argument
        if address not in ("0.0.0.0", "*", "[::]"):
            yield make_finding(
                "discovery-server-pinned",
                where="robot",
                cause=f"the discovery server is pinned to {address} and answers on no other address",
                evidence=(socket.line(), socket.command),
                command=command_on_robot(snapshot, f"kill {socket.pid}") + f" && {_recover_command(snapshot)}",
                explains=OVER_GRAPH,
            )


CHECKS = (Check("discovery.server", find_server_faults, robot=(SOCKETS, DISCOVERY_LOG, ROS_PROCESSES)),)
