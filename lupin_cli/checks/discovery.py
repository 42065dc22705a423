"""The discovery server of the robot: a phone book that the vendor's script starts once, and never looks at again."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.consequences import SEEN_OVER_THE_GRAPH
from lupin_cli.checks.environment import host_of
from lupin_cli.checks.typed import on_robot
from lupin_cli.facts.dds_profiles import DISCOVERY_PORT
from lupin_cli.facts.discovery_log import DISCOVERY_LOG, DiscoveryLog
from lupin_cli.facts.link import Link
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.sockets import SOCKETS, Socket

# `env -u`: with the vendor's profile in its environment the server inherits a pinned locator and fails on a free port.
START_SERVER = (
    "env -u FASTRTPS_DEFAULT_PROFILES_FILE setsid fast-discovery-server -i 0 -l 0.0.0.0 "
    f"-p {DISCOVERY_PORT} >/tmp/lupin-discovery.log 2>&1 </dev/null &"
)
STARTING_S = 5.0  # the script starts the server first of all; a busy robot takes seconds over it
_SWITCH_ON = "echo export MIRTE_FASTDDS=true >> ~/.mirte_settings.sh; sudo systemctl restart mirte-ros.service"
_SYMPTOM = "ros2 topic list returns 2; the page loads and every panel is blank, while the unit says it is active"


def find_server(evidence: Evidence) -> Iterator[Finding]:
    """Nothing bound where the robot's own nodes look for their server, another program there, or one that hangs."""
    robot = evidence.robot
    if robot is None:
        return
    sockets, log, processes = robot.get(SOCKETS), robot.get(DISCOVERY_LOG), robot.get(ROS_PROCESSES)
    if sockets is None or log is None or processes is None:
        return
    bound = sockets.on("udp", DISCOVERY_PORT)
    clients = [each for each in processes if _looks_here(each)]
    if log.vendor in ("active", "activating") and not log.wanted and not bound:
        yield _switched_off(evidence, log)
    elif bound:
        yield from _taken(evidence, bound, processes)
        yield from _stopped(evidence, bound, processes)
        yield from _pinned(evidence, bound)
    elif (clients or (log.wanted and log.vendor == "active")) and not _about_to_start(log, processes):
        yield _missing(evidence, log, clients)


def _about_to_start(log: DiscoveryLog, processes: tuple[RosProcess, ...]) -> bool:
    """Whether the vendor's script is only just under way and has not failed yet: a doctor may come with the boot."""
    if log.journal:
        return False
    young = log.vendor_age_s is not None and log.vendor_age_s < STARTING_S
    return young or any(process.is_server and process.age_s < STARTING_S for process in processes)


def lacks_server(evidence: Evidence) -> bool:
    """Whether a vendor's stack is up on the robot without anything on the discovery server's port."""
    sockets = evidence.robot.get(SOCKETS) if evidence.robot else None
    log = evidence.robot.get(DISCOVERY_LOG) if evidence.robot else None
    return sockets is not None and log is not None and log.vendor == "active" and not sockets.on("udp", DISCOVERY_PORT)


def _looks_here(process: RosProcess) -> bool:
    return host_of(process.server) in ("127.0.0.1", "localhost")


def _missing(evidence: Evidence, log: DiscoveryLog, clients: list[RosProcess]) -> Finding:
    said = " ".join(log.journal).lower()
    explains = SEEN_OVER_THE_GRAPH
    if "not found" in said:
        explains |= {"profile-unreadable:robot"}  # the script that writes it found its tools as little
        why = "the vendor's script did not find fast-discovery-server: PATH was not filled yet when it started it"
    elif "allocate" in said:
        why = "the vendor's script started it before its address was there (wlan0 came late), and never again"
    else:
        why = "it has ended, or was never started; the vendor's script starts it once and looks no further"
    return Finding(
        id="discovery-server-missing",
        severity=Severity.PROBLEM,
        where="robot",
        symptom=_SYMPTOM,
        cause=f"no discovery server listens on UDP {DISCOVERY_PORT}: {why}",
        evidence=(
            *log.journal,
            f"ss -lnu: no line with :{DISCOVERY_PORT}",
            *(each.line("ROS_DISCOVERY_SERVER") for each in clients[:3]),
        ),
        fix=Fix(on_robot(evidence, START_SERVER), playbook="recover-discovery", safe=True),
        explains=explains,
    )


def _switched_off(evidence: Evidence, log: DiscoveryLog) -> Finding:
    return Finding(
        id="discovery-server-switched-off",
        severity=Severity.PROBLEM,
        where="robot",
        symptom=_SYMPTOM,
        cause="the vendor's stack is not told to use a discovery server, so its nodes speak multicast, which WiFi drops",
        evidence=(f"~/.mirte_settings.sh: MIRTE_FASTDDS={log.switch or '(unset)'}", f"mirte-ros.service: {log.vendor}"),
        fix=Fix(on_robot(evidence, _SWITCH_ON)),
        explains=SEEN_OVER_THE_GRAPH | {"process-multicast-only"},
    )


def _recover(evidence: Evidence) -> str:
    robot = evidence.link.robot if isinstance(evidence.link, Link) else ""
    return f"lupin play recover-discovery --robot {robot}".removesuffix(" --robot ")


def _taken(evidence: Evidence, bound: tuple[Socket, ...], processes: tuple[RosProcess, ...]) -> Iterator[Finding]:
    ros = {process.pid for process in processes}
    for socket in bound:
        known = socket.pid and socket.process
        if known and socket.pid not in ros and not socket.process.startswith("fast-discovery"):
            yield Finding(
                id="discovery-port-taken",
                severity=Severity.PROBLEM,
                where="robot",
                symptom=_SYMPTOM,
                cause=f"{socket.process} holds UDP {DISCOVERY_PORT}, and it is no discovery server",
                evidence=(socket.line(), socket.command),
                fix=Fix(f"end process {socket.pid} ({socket.command or socket.process}), then: {_recover(evidence)}"),
                explains=SEEN_OVER_THE_GRAPH | {"discovery-server-pinned"},
            )


def _stopped(evidence: Evidence, bound: tuple[Socket, ...], processes: tuple[RosProcess, ...]) -> Iterator[Finding]:
    owners = {socket.pid for socket in bound}
    for process in processes:
        if process.pid in owners and process.state in ("T", "t"):
            yield Finding(
                id="discovery-server-stopped",
                severity=Severity.PROBLEM,
                where="robot",
                symptom=_SYMPTOM,
                cause=f"the discovery server (process {process.pid}) is stopped: it holds its port and answers nobody",
                evidence=(process.line(), f"state {process.state} in /proc/{process.pid}/stat"),
                fix=Fix(on_robot(evidence, f"kill -CONT {process.pid}")),
                explains=SEEN_OVER_THE_GRAPH,
            )


def _pinned(evidence: Evidence, bound: tuple[Socket, ...]) -> Iterator[Finding]:
    for socket in bound:
        words = shlex.split(socket.command) if socket.command.count('"') % 2 == 0 and "'" not in socket.command else []
        told = next((words[at + 1] for at, word in enumerate(words[:-1]) if word in ("-l", "--ip-address")), "0.0.0.0")
        address = socket.address if not socket.anywhere else told
        if address not in ("0.0.0.0", "*", "[::]"):
            yield Finding(
                id="discovery-server-pinned",
                severity=Severity.PROBLEM,
                where="robot",
                symptom="the graph is there on one network and not on the other: ros2 topic list returns 2 over the cable",
                cause=f"the discovery server is pinned to {address} and answers on no other address",
                evidence=(socket.line(), socket.command),
                fix=Fix(on_robot(evidence, f"kill {socket.pid}") + f" && {_recover(evidence)}"),
                explains=SEEN_OVER_THE_GRAPH,
            )


CHECKS = (Check("discovery.server", find_server, robot=(SOCKETS, DISCOVERY_LOG, ROS_PROCESSES)),)
