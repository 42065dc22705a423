"""What a launch that has exited left behind, or lost: processes that still hold DDS ports, and shared memory files.

Segments are writable for their owner only, and logind may remove them at the end of a login (RemoveIPC).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.controllers import observed_graphs
from lupin_cli.checks.dds_environment import servers
from lupin_cli.checks.discovery import lacks_server
from lupin_cli.checks.drive import SILENT_BUTTON
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.missing_parts import describe_programs, losses_of, signs_of_loss
from lupin_cli.checks.remote_command import FixText, command_on, restart_processes, robot_option, service_of
from lupin_cli.facts.account import ACCOUNT, Account
from lupin_cli.facts.base import Facts
from lupin_cli.facts.discovery_log import DISCOVERY_LOG
from lupin_cli.facts.graph import GRAPH
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.shared_memory import SHARED_MEMORY, SharedFile
from lupin_cli.facts.sockets import SOCKETS
from lupin_cli.facts.units import VENDOR
from lupin_cli.systemd.units import CAMERAS, ONBOARD

# Unicast ports of domain 0: 7410 + 2 * participant for discovery, and the next one for data.
FIRST_PORT, LAST_PORT = 7410, 7447
DOMAIN_0, DOMAIN_GAIN = 7400, 250  # RTPS 9.6.2.3: where the ports of each domain begin
UDP_ONLY = "FASTDDS_BUILTIN_TRANSPORTS=UDPv4"
_PORT_FILE = re.compile(r"fast(?:rtps|dds)_port(\d+)")


def sweep_command(snapshot: Snapshot, machine: str) -> str:
    """Return the command that cleans up one machine. The cleanup checks each owner first and stops nothing that works."""
    return f"lupin sweep{robot_option(snapshot)}" if machine == "robot" else "lupin sweep --local"


def find_stale_processes(snapshot: Snapshot) -> Iterator[Finding]:
    """A process outlived its launch and still holds DDS ports: the discovery server still announces its topics."""
    for facts in snapshot.machines:
        processes, sockets = facts.get(ROS_PROCESSES), facts.get(SOCKETS)
        if processes is None or sockets is None:
            continue
        for process in processes:
            if _stopped_unit(process):
                continue  # a part of the running robot: it must go on, not be terminated
            held = [s for s in sockets.of(process.pid) if s.protocol == "udp" and FIRST_PORT <= s.port <= LAST_PORT]
            reason = "" if process.is_server else process.stale_reason
            if held and reason:
                ports = ", ".join(str(port) for port in sorted({socket.port for socket in held}))
                yield make_finding(
                    "zombie-process",
                    where=facts.machine,
                    cause=f"{process.name} (process {process.pid}) outlived its launch and still holds UDP {ports}: {reason}",
                    evidence=(
                        process.line(),
                        f"parent {process.parent} ({process.parent_name or 'not readable'}), group {process.group}",
                        *(s.line() for s in held),
                    ),
                    command=sweep_command(snapshot, facts.machine),
                    variables={"machine": facts.machine},
                )


def _stopped_unit(process: RosProcess) -> str:
    """Return the service of the robot that a stopped process belongs to; empty if it runs, or belongs to none."""
    unit = process.group.rpartition("/")[2]
    return unit if process.state in ("T", "t") and unit in (VENDOR, ONBOARD, CAMERAS) else ""


def find_stopped_processes(snapshot: Snapshot) -> Iterator[Finding]:
    """A process of the robot's services is stopped: systemd counts it as running, and it does nothing."""
    stopped: dict[str, list[RosProcess]] = {}
    for process in snapshot.robot_fact(ROS_PROCESSES) or ():
        if unit := _stopped_unit(process):
            stopped.setdefault(unit, []).append(process)
    for unit, processes in stopped.items():
        others = [process for process in processes if not process.is_server]
        if not others:
            continue  # the check of the discovery server names it
        first = others[0]
        with_server = {"discovery-server-stopped"} if len(others) < len(processes) else set()
        losses = _losses_of_stopped(snapshot, unit, others)
        yield make_finding(
            "process-stopped",
            where="robot",
            # Lupin's own processes drive, stop and supervise, whatever arrives meanwhile.
            severity=Severity.PROBLEM if losses or unit == ONBOARD else Severity.WARNING,
            cause=f"{', '.join(f'{each.name} (process {each.pid})' for each in others)} of {unit} is stopped: "
            "it exists, and does nothing",
            evidence=[f"{each.line()}: state {each.state} in /proc/{each.pid}/stat" for each in processes],
            command=f"lupin play resume-process{robot_option(snapshot)} -v pid={first.pid}",
            variables={"pid": first.pid},
            # The e-stop moves nothing when it goes on. Others may act on commands that have waited, so a person decides.
            safe=len(others) == 1 and first.name == "estop",
            explains=signs_of_loss(losses) | _SIGNS_OF_STOPPED[unit] | {f"unit-restarting:{unit}"} | with_server,
            breaks=losses,
            about=unit,
        )


_SIGNS_OF_STOPPED = {
    VENDOR: frozenset({"board-wedged", f"estop-engaged:{SILENT_BUTTON}"}),
    ONBOARD: frozenset({"bus-locked", "estop-engaged"}),
    CAMERAS: frozenset({"camera-silent"}),
}


def _losses_of_stopped(snapshot: Snapshot, unit: str, processes: list[RosProcess]) -> tuple[str, ...]:
    """Return what stopped processes of a unit may have taken with them."""
    program = "" if unit == CAMERAS else describe_programs(processes)  # the cameras are no part of the ground truth
    return losses_of(ground_truth.measure(snapshot), program, in_vendor_unit=unit == VENDOR)


def find_orphaned_memory(snapshot: Snapshot) -> Iterator[Finding]:
    """Killed processes left shared memory: new participants fail to lock it and never complete discovery."""
    for facts in snapshot.machines:
        files = facts.get(SHARED_MEMORY) or ()
        orphans = [file for file in files if file.lockable and not file.held]
        segments = [file for file in orphans if file.is_segment]
        if not orphans or (len(segments) <= 1 and facts is snapshot.robot and lacks_server(snapshot)):
            continue  # a single segment belongs to the missing discovery server, which is another finding
        total_kib = sum(file.size_bytes for file in orphans) / 1024
        yield make_finding(
            "shared-memory-orphans",
            where=facts.machine,
            cause=f"{len(orphans)} shared-memory files of Fast DDS ({total_kib:.0f} KiB) belong to processes that were killed",
            evidence=(
                f"/dev/shm/{file.name}: {file.size_bytes} bytes, user {file.user_id}, no process holds its lock"
                for file in orphans[:6]
            ),
            command=sweep_command(snapshot, facts.machine),
            variables={"machine": facts.machine},
        )


def find_unshared_memory(snapshot: Snapshot) -> Iterator[Finding]:
    """Two processes of a graph on one machine cannot share memory, and do not notice: names arrive, samples do not."""
    for facts in snapshot.machines:
        processes, files = facts.get(ROS_PROCESSES) or (), facts.get(SHARED_MEMORY) or ()
        holders = {file.holder for file in files if file.held and file.holder}
        graphs: dict[tuple[int, tuple[tuple[str, int], ...]], list[RosProcess]] = {}
        for process in processes:
            if _uses_shared_memory(process, holders):
                graphs.setdefault((process.domain, servers(process.server)), []).append(process)
        for members in graphs.values():
            other = next((each for each in members if _cannot_share(each, members[0])), None)
            if other is not None:
                line = other.line("FASTDDS_BUILTIN_TRANSPORTS")
                user = MemoryUser(other.pid, other.user_id, other.name, (line,), service=service_of(other))
                yield _unshared_memory(snapshot, facts, members[0], user, files)
        known = {process.pid for process in processes}
        # People share a laptop, and each may have a graph of their own: only lost samples show that two are in one.
        suspected = holders - known if facts.machine == "robot" or _loses_samples_in_memory(snapshot) else set()
        for stranger in filter(None, (_unreadable_user(pid, files) for pid in sorted(suspected))):
            same_domain = (members[0] for members in graphs.values() if members[0].domain in stranger.domains)
            one = next((process for process in same_domain if process.user_id != stranger.user_id), None)
            if one is not None:
                yield _unshared_memory(snapshot, facts, one, stranger, files)


def _loses_samples_in_memory(snapshot: Snapshot) -> bool:
    """Return whether a graph delivers samples to the laptop over UDP only, and none through shared memory."""
    return any(graph.udp_heard for graph in observed_graphs(snapshot))


def find_removed_memory(snapshot: Snapshot) -> Iterator[Finding]:
    """Shared memory was removed while processes use it."""
    for facts in snapshot.machines:
        if users := _users_of_removed_memory(facts):
            yield _removed_memory(snapshot, facts, users, facts.get(ACCOUNT))


AT_RISK = "shared-memory-at-risk"


def find_memory_at_risk(snapshot: Snapshot) -> Iterator[Finding]:
    """logind will remove the shared memory of the running stack when the next login on the robot ends."""
    account = snapshot.robot_fact(ACCOUNT)
    if snapshot.robot is None or account is None or not account.loses_memory or _users_of_removed_memory(snapshot.robot):
        return
    files = snapshot.robot.get(SHARED_MEMORY) or ()
    at_risk = [file for file in files if file.held and file.is_segment and file.user_id == account.uid]
    if at_risk:
        yield make_finding(
            AT_RISK,
            where="robot",
            cause=f"logind removes the files of {account.user} in /dev/shm ten seconds after their last logout, "
            "while the stack runs",
            evidence=(
                f"logind: RemoveIPC true; {account.user} (user id {account.uid}) does not linger",
                *(f"/dev/shm/{file.name}: held by process {file.holder}" for file in at_risk[:3]),
            ),
            command=_keep_memory_command(snapshot, restart=False),
            variables={"restart": False},
        )


def _users_of_removed_memory(facts: Facts) -> list[RosProcess]:
    """Return the processes that hold memory which no other process can open any more. The doctor's own probes do not count."""
    holders = {file.holder for file in facts.get(SHARED_MEMORY) or () if file.removed}
    return [each for each in facts.get(ROS_PROCESSES) or () if each.pid in holders and not each.is_graph_probe]


def _removed_memory(snapshot: Snapshot, facts: Facts, users: list[RosProcess], account: Account | None) -> Finding:
    user = account.user if account is not None and account.loses_memory else ""
    on_robot = facts.machine == "robot"
    return make_finding(
        "shared-memory-removed",
        where=facts.machine,
        cause="the shared memory of running processes was removed"
        + (f" by logind, when the last login of {user} ended" if user else ""),
        evidence=(
            *(f"{p.name} (process {p.pid}) holds locks on files that are gone from /dev/shm" for p in users[:4]),
            *((f"logind: RemoveIPC true; {user} does not linger",) if user else ()),
        ),
        playbook=None if on_robot else "",
        variables={"restart": True} if on_robot else {},
        explains={"names-no-samples", "shared-memory-not-shared"},
        **(
            FixText(
                command=_keep_memory_command(snapshot, restart=True),
                instruction="the robot's stack stops for about 30 seconds, with whatever it is doing",
            )
            if on_robot
            else restart_processes(snapshot, facts.machine, users)
        ),
    )


def _keep_memory_command(snapshot: Snapshot, restart: bool) -> str:
    return f"lupin play keep-shared-memory{robot_option(snapshot)}{' -v restart=true' if restart else ''}"


def _uses_shared_memory(process: RosProcess, holders: set[int]) -> bool:
    if process.is_daemon or process.stale_reason or process.environment.get("FASTDDS_BUILTIN_TRANSPORTS", "").startswith("UDP"):
        return False
    return process.pid in holders


@dataclass(frozen=True)
class MemoryUser:
    """A process that uses shared memory which another one cannot open."""

    pid: int
    user_id: int
    name: str
    lines: tuple[str, ...] = ()  # evidence
    domains: frozenset[int] = frozenset()
    service: str = ""  # the system service that it belongs to, if that is known


def _unreadable_user(pid: int, files: tuple[SharedFile, ...]) -> MemoryUser | None:
    """Return another user's process that holds a segment: it is unreadable, but its port files show its domains."""
    user = next((file.user_id for file in files if file.holder == pid and file.is_segment), None)
    ports = (int(found[1]) for file in files if file.holder == pid and (found := _PORT_FILE.fullmatch(file.name)))
    domains = frozenset((port - DOMAIN_0) // DOMAIN_GAIN for port in ports if port >= DOMAIN_0)
    return None if user is None else MemoryUser(pid, user, f"process {pid}", domains=domains)


def _cannot_share(one: RosProcess, other: RosProcess) -> bool:
    different_memory = bool(one.shared_memory and other.shared_memory) and one.shared_memory != other.shared_memory
    return different_memory or one.user_id != other.user_id


def _unshared_memory(
    snapshot: Snapshot, facts: Facts, one: RosProcess, other: MemoryUser, files: tuple[SharedFile, ...]
) -> Finding:
    return make_finding(
        "shared-memory-not-shared",
        where=facts.machine,
        cause=f"{one.name} (user {one.user_id}) and {other.name} (user {other.user_id}) cannot share memory, "
        "but both assume that they do",
        evidence=(
            one.line("FASTDDS_BUILTIN_TRANSPORTS"),
            *other.lines,
            *(
                f"/dev/shm/{file.name}: user {file.user_id}, held by {file.holder}"
                for pid in (one.pid, other.pid)
                for file in [file for file in files if file.holder == pid and not file.removed][:2]
            ),
        ),
        explains={"names-no-samples"} if facts.machine == "laptop" and _loses_samples_in_memory(snapshot) else (),
        **_share_or_send(snapshot, facts.machine, one, other),
    )


def _share_or_send(snapshot: Snapshot, machine: str, one: RosProcess, other: MemoryUser) -> FixText:
    """Return how one of two processes shares memory with the other, or sends over UDP. A service keeps running."""
    if other.service and service_of(one):
        folder = f"/etc/systemd/system/{other.service}.d"
        lines = f"[Service]\\nEnvironment={UDP_ONLY}\\n"
        script = (
            f'sudo mkdir -p {folder} && printf "{lines}" | sudo tee {folder}/60-udp.conf >/dev/null && '
            f"sudo systemctl daemon-reload && sudo systemctl restart {other.service}"
        )
        return FixText(
            command=command_on(snapshot, machine, script),
            instruction=f"the command lets {other.service} send over UDP; better, let its unit run as the same user",
        )
    if machine == "laptop":
        return _share_on_laptop(one, other)
    pid, name, user_id = (one.pid, one.name, other.user_id) if other.service else (other.pid, other.name, one.user_id)
    return FixText(
        command=command_on(snapshot, machine, f"sudo kill {pid}"),
        instruction=f"the command ends {name} (process {pid}); then start it again as the user with the id {user_id}, "
        f"or after: export {UDP_ONLY}",
    )


def _share_on_laptop(one: RosProcess, other: MemoryUser) -> FixText:
    """Return how two processes of the laptop exchange data. What another person runs there is theirs to end."""
    again = f"start it again after: export {UDP_ONLY}"
    if other.lines:  # both are readable, so neither is known to be the operator's
        return FixText(instruction=f"run {one.name} and {other.name} as the same user, or end one of the two and {again}")
    return FixText(command=f"kill {one.pid}", instruction=f"the command ends {one.name} (process {one.pid}); then {again}")


_MEMORY = (SHARED_MEMORY, ROS_PROCESSES)
MEMORY_AT_RISK = Check("dds.memory-at-risk", find_memory_at_risk, robot=(*_MEMORY, ACCOUNT))
# A process that is starting or exiting holds no lock for a moment, or holds locks on files that it has already removed.
# Orphaned and removed memory is therefore read a second time.
CHECKS = (
    Check("processes.stopped", find_stopped_processes, robot=(ROS_PROCESSES,)),
    Check("dds.zombies", find_stale_processes, laptop=(ROS_PROCESSES, SOCKETS), robot=(ROS_PROCESSES, SOCKETS)),
    Check("dds.shared-memory", find_unshared_memory, laptop=(*_MEMORY, GRAPH), robot=_MEMORY),
    MEMORY_AT_RISK,
    Check(
        "dds.removed-memory",
        find_removed_memory,
        laptop=_MEMORY,
        robot=(*_MEMORY, ACCOUNT),
        followup_laptop=(SHARED_MEMORY,),
        followup_robot=(SHARED_MEMORY,),
    ),
    Check(
        "dds.orphans",
        find_orphaned_memory,
        laptop=(SHARED_MEMORY,),
        robot=(SHARED_MEMORY, SOCKETS, DISCOVERY_LOG),
        followup_laptop=(SHARED_MEMORY,),
        followup_robot=(SHARED_MEMORY,),
    ),
)
