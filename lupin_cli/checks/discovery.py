"""The robot's discovery server. The vendor's start script starts it once and never monitors it."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.dds_environment import server_host
from lupin_cli.checks.findings import OVER_GRAPH, make_finding
from lupin_cli.checks.remote_command import FixText, command_on_robot, robot_option, sudo_for
from lupin_cli.facts.discovery_log import DISCOVERY_LOG, DiscoveryLog
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.sockets import SOCKETS, Socket
from lupin_cli.systemd.units import AUTO_HOME, ONBOARD
from lupin_runtime.ports import DISCOVERY_PORT

SERVER_ID = "0"  # its GUID prefix is that of `facts.dds_profiles.SERVER_PREFIX`
STARTING_S = 5.0  # the script starts the server first; on a busy robot that takes seconds
_SWITCH_ON = "echo export MIRTE_FASTDDS=true >> ~/.mirte_settings.sh; sudo systemctl restart mirte-ros.service"
# What the lack of a usable server explains: all data over DDS, and units whose programs discover no other program.
_WITHOUT_SERVER = OVER_GRAPH | {f"oneshot-failed:{AUTO_HOME}", f"unit-restarting:{ONBOARD}"}


def find_server_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot has no usable discovery server: none listens, another program has its port, or it is stopped or pinned."""
    sockets, log = snapshot.robot_fact(SOCKETS), snapshot.robot_fact(DISCOVERY_LOG)
    processes = snapshot.robot_fact(ROS_PROCESSES)
    if sockets is None or log is None or processes is None:
        return
    bound = sockets.on("udp", DISCOVERY_PORT)
    clients = [each for each in processes if _asks_local_server(each)]
    # A server that somebody else started serves nobody while the robot's programs only multicast.
    in_use = bound and any(each.server and not (each.is_daemon or each.is_server) for each in processes)
    if log.vendor in ("active", "activating") and not log.server_enabled and not in_use:
        yield _disabled_server(snapshot, log)
    elif bound:
        yield from _taken_port(snapshot, bound, processes)
        yield from _stopped_server(snapshot, bound, processes)
        yield from _pinned_server(snapshot, bound, processes)
        yield from _other_server(snapshot, bound, processes)
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
    explains = _WITHOUT_SERVER
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
        command=_recover_command(snapshot),
        explains=explains,
    )


def _disabled_server(snapshot: Snapshot, log: DiscoveryLog) -> Finding:
    return make_finding(
        "discovery-server-switched-off",
        where="robot",
        cause="the vendor's settings do not enable the discovery server, so its nodes multicast, which WiFi drops"
        + (f": MIRTE_FASTDDS is {log.switch!r}, and the script wants 'true'" if log.switch not in ("", "false") else ""),
        evidence=(f"~/.mirte_settings.sh: MIRTE_FASTDDS={log.switch or '(unset)'}", f"mirte-ros.service: {log.vendor}"),
        command=command_on_robot(snapshot, _SWITCH_ON),
        # The vendor's programs take any other value for the address of a server elsewhere.
        explains=OVER_GRAPH | {"process-multicast-only", f"process-wrong-server:robot {log.switch}"},
    )


def _recover_command(snapshot: Snapshot) -> str:
    return f"lupin play recover-discovery{robot_option(snapshot)}"


def _replace_server(snapshot: Snapshot, socket: Socket, processes: tuple[RosProcess, ...]) -> FixText:
    """Return how a server is ended, and one started that answers on every address. Its PID may be visible only to root."""
    recover = _recover_command(snapshot)
    if not socket.pid:
        return FixText(
            command=command_on_robot(snapshot, f"sudo ss -lunp sport = :{DISCOVERY_PORT}"),
            instruction=f"the command names the process that holds the port; end it, then type: {recover}",
        )
    owner = [process for process in processes if process.pid == socket.pid]
    sudo = sudo_for(snapshot, "robot", owner) if owner else "sudo "
    return FixText(command=f"{command_on_robot(snapshot, f'{sudo}kill {socket.pid}')} && {recover}")


def _taken_port(snapshot: Snapshot, bound: tuple[Socket, ...], processes: tuple[RosProcess, ...]) -> Iterator[Finding]:
    ros_pids, cuts_off = {process.pid for process in processes}, _cuts_off(snapshot)
    for socket in bound:
        known = socket.pid and socket.process
        if known and socket.pid not in ros_pids and not socket.process.startswith("fast-discovery"):
            yield make_finding(
                "discovery-port-taken",
                where="robot",
                cause=f"{socket.process} holds UDP {DISCOVERY_PORT} and is not a discovery server",
                evidence=(socket.line(), socket.command),
                command=f"{command_on_robot(snapshot, f'sudo kill {socket.pid}')} && {_recover_command(snapshot)}",
                instruction=f"the command ends {socket.command or socket.process}",
                explains=OVER_GRAPH | {"discovery-server-pinned"} if cuts_off else {"discovery-server-pinned"},
                breaks=None if cuts_off else (),
                severity=Severity.PROBLEM if cuts_off else Severity.WARNING,
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
                command=command_on_robot(snapshot, f"{sudo_for(snapshot, 'robot', [process])}kill -CONT {process.pid}"),
                explains=OVER_GRAPH,
            )


def _pinned_server(snapshot: Snapshot, bound: tuple[Socket, ...], processes: tuple[RosProcess, ...]) -> Iterator[Finding]:
    cuts_off = _cuts_off(snapshot)
    for socket in bound:
        argument = _option(socket.command, "0.0.0.0", "-l", "--ip-address")
        address = socket.address if not socket.is_wildcard else argument
        if address not in ("0.0.0.0", "*", "[::]"):
            yield make_finding(
                "discovery-server-pinned",
                where="robot",
                cause=f"the discovery server is pinned to {address} and answers on no other address",
                evidence=(socket.line(), socket.command),
                explains=_WITHOUT_SERVER if cuts_off else (),
                breaks=None if cuts_off else (),
                severity=Severity.PROBLEM if cuts_off else Severity.WARNING,
                **_replace_server(snapshot, socket, processes),
            )


def _cuts_off(snapshot: Snapshot) -> bool:
    """Return whether an unusable server may be why nothing arrives. What does arrive was found by a usable one."""
    return not ground_truth.hears_robot(ground_truth.measure(snapshot))


def _option(command: str, default: str, *names: str) -> str:
    """Return the argument of an option in the command line of a discovery server."""
    words = shlex.split(command) if command.count('"') % 2 == 0 and "'" not in command else []
    return next((words[at + 1] for at, word in enumerate(words[:-1]) if word in names), default)


def _other_server(snapshot: Snapshot, bound: tuple[Socket, ...], processes: tuple[RosProcess, ...]) -> Iterator[Finding]:
    """Yield the finding for a server with another id: no client knows the GUID prefix that the id gives it."""
    cuts_off = _cuts_off(snapshot)
    for socket in bound:
        number = _option(socket.command, SERVER_ID, "-i", "--server-id")
        if socket.process.startswith("fast-discovery") and number != SERVER_ID:
            yield make_finding(
                "discovery-server-other-id",
                where="robot",
                cause=f"the discovery server has the id {number}, and all profiles expect {SERVER_ID}: it answers no client",
                evidence=(socket.line(), socket.command),
                explains=_WITHOUT_SERVER if cuts_off else (),
                breaks=None if cuts_off else (),
                severity=Severity.PROBLEM if cuts_off else Severity.WARNING,
                **_replace_server(snapshot, socket, processes),
            )


CHECKS = (Check("discovery.server", find_server_faults, robot=(SOCKETS, DISCOVERY_LOG, ROS_PROCESSES)),)
