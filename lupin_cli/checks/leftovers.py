"""What a launch that died left behind: processes that still hold DDS ports, and shared memory that nobody holds any more."""

from __future__ import annotations

import re
from collections.abc import Iterator

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.discovery import lacks_server
from lupin_cli.checks.environment import machines
from lupin_cli.facts.account import ACCOUNT, Account
from lupin_cli.facts.base import Facts
from lupin_cli.facts.discovery_log import DISCOVERY_LOG
from lupin_cli.facts.link import Link
from lupin_cli.facts.ros_processes import ROS_PROCESSES, RosProcess
from lupin_cli.facts.shared_memory import SHARED_MEMORY, SharedFile
from lupin_cli.facts.sockets import SOCKETS
from lupin_cli.quick_dataclass import dataclass

# Unicast ports of domain 0: 7410 + 2 * participant, and one more each for data.
FIRST_PORT, LAST_PORT = 7410, 7447
DOMAIN_0, DOMAIN_GAIN = 7400, 250  # RTPS 9.6.2.3: where the ports of each domain begin
_PORT = re.compile(r"fast(?:rtps|dds)_port(\d+)")


def sweep(evidence: Evidence, machine: str) -> Fix:
    """What ends and removes the leftovers of one machine, each after a look at whose it is: nothing that works is stopped."""
    robot = f" --robot {evidence.link.robot}" if machine == "robot" and isinstance(evidence.link, Link) else ""
    return Fix(f"lupin sweep{robot}", playbook="sweep", variables={"machine": machine}, safe=True)


def find_zombies(evidence: Evidence) -> Iterator[Finding]:
    """Processes whose launch is gone and which still sit on the graph's ports: the server hands out their topics."""
    for facts in machines(evidence):
        processes, sockets = facts.get(ROS_PROCESSES), facts.get(SOCKETS)
        if processes is None or sockets is None:
            continue
        for process in processes:
            held = [s for s in sockets.of(process.pid) if s.protocol == "udp" and FIRST_PORT <= s.port <= LAST_PORT]
            why = "" if process.is_server else process.outlived
            if held and why:
                ports = ", ".join(str(port) for port in sorted({socket.port for socket in held}))
                yield Finding(
                    id="zombie-process",
                    severity=Severity.PROBLEM,
                    where=facts.machine,
                    symptom="a fresh node sees the topics and gets nothing, or two answers",
                    cause=f"{process.name} (process {process.pid}) outlived its launch and still holds UDP {ports}: {why}",
                    evidence=(process.line(), f"parent {process.parent}, group {process.group}", *(s.line() for s in held)),
                    fix=sweep(evidence, facts.machine),
                )


def find_orphaned_memory(evidence: Evidence) -> Iterator[Finding]:
    """Segments and ports of dead processes: the next participant fails to lock them, and never completes discovery."""
    for facts in machines(evidence):
        files = facts.get(SHARED_MEMORY) or ()
        orphans = [file for file in files if file.lockable and not file.held]
        segments = [file for file in orphans if file.is_segment]
        if not orphans or (len(segments) <= 1 and facts is evidence.robot and lacks_server(evidence)):
            continue  # that one is of the dead discovery server, which is told already
        total_kib = sum(file.size_bytes for file in orphans) / 1024
        yield Finding(
            id="shared-memory-orphans",
            severity=Severity.WARNING,
            where=facts.machine,
            symptom="a new node comes up, and never finishes discovery",
            cause=f"{len(orphans)} shared-memory files of Fast DDS ({total_kib:.0f} KiB) belong to processes that were killed",
            evidence=tuple(
                f"/dev/shm/{file.name}: {file.size_bytes} bytes, user {file.user_id}, nobody holds its lock"
                for file in orphans[:6]
            ),
            fix=sweep(evidence, facts.machine),
        )


def find_unshared_memory(evidence: Evidence) -> Iterator[Finding]:
    """Two sides on one machine that can't share memory and believe they do: names arrive, samples never."""
    for facts in machines(evidence):
        processes, files = facts.get(ROS_PROCESSES) or (), facts.get(SHARED_MEMORY) or ()
        holders = {file.holder for file in files if file.held and file.holder}
        graphs: dict[tuple[int, str], list[RosProcess]] = {}
        for process in processes:
            if _uses_shared_memory(process, holders):
                graphs.setdefault((process.domain, process.server), []).append(process)
        for members in graphs.values():
            other = next((each for each in members if _apart(each, members[0])), None)
            if other is not None:
                yield _unshared(facts, members[0], _side(other), files)
        seen = {process.pid for process in processes}
        for stranger in filter(None, (_stranger(pid, files) for pid in sorted(holders - seen))):
            near = (each[0] for each in graphs.values() if each[0].domain in stranger.domains)
            one = next((process for process in near if process.user_id != stranger.user_id), None)
            if one is not None:
                yield _unshared(facts, one, stranger, files)


def find_removed_memory(evidence: Evidence) -> Iterator[Finding]:
    """Shared memory that was removed under the processes that use it."""
    for facts in machines(evidence):
        if losers := _losers(facts):
            yield _lost(evidence, facts, losers, facts.get(ACCOUNT))


def find_memory_at_risk(evidence: Evidence) -> Iterator[Finding]:
    """Shared memory on the robot that will be removed when the next login there ends."""
    account = evidence.robot.get(ACCOUNT) if evidence.robot else None
    if evidence.robot is None or account is None or not account.loses_memory or _losers(evidence.robot):
        return
    files = evidence.robot.get(SHARED_MEMORY) or ()
    at_risk = [file for file in files if file.held and file.is_segment and file.user_id == account.uid]
    if at_risk:
        yield _at_risk(evidence, account, at_risk)


def _losers(facts: Facts) -> list[RosProcess]:
    """The processes that hold memory which nobody else can open any more. Visitors end all the time."""
    lost = {file.holder for file in facts.get(SHARED_MEMORY) or () if file.removed}
    return [each for each in facts.get(ROS_PROCESSES) or () if each.pid in lost and not each.is_visitor]


def _lost(evidence: Evidence, facts: Facts, using: list[RosProcess], account: Account | None) -> Finding:
    user = account.user if account is not None and account.loses_memory else ""
    return Finding(
        id="shared-memory-removed",
        severity=Severity.PROBLEM,
        where=facts.machine,
        symptom="whoever joins there now sees every name and gets no sample; nodes that were there first hear each other",
        cause="the shared memory of running processes was removed"
        + (f" by logind, when the last login of {user} ended" if user else ""),
        evidence=(
            *(f"{p.name} (process {p.pid}) holds locks on files that are gone from /dev/shm" for p in using[:4]),
            *((f"logind: RemoveIPC true; {user} does not linger",) if user else ()),
        ),
        fix=_keep(evidence, restart=True)
        if facts.machine == "robot"
        else Fix("start them again: " + ", ".join(p.name for p in using)),
        explains=frozenset({"names-no-samples", "shared-memory-not-shared"}),
    )


def _at_risk(evidence: Evidence, account: Account, files: list[SharedFile]) -> Finding:
    return Finding(
        id="shared-memory-at-risk",
        severity=Severity.WARNING,
        where="robot",
        symptom="the robot works until somebody has logged in and out; then late joiners there see names and get no samples",
        cause=f"logind removes what {account.user} has in /dev/shm ten seconds after their last login, while the stack runs",
        evidence=(
            f"logind: RemoveIPC true; {account.user} (user id {account.uid}) does not linger",
            *(f"/dev/shm/{file.name}: held by process {file.holder}" for file in files[:3]),
        ),
        fix=_keep(evidence, restart=False),
    )


def _keep(evidence: Evidence, restart: bool) -> Fix:
    robot = f" --robot {evidence.link.robot}" if isinstance(evidence.link, Link) else ""
    asked = " -v restart=true" if restart else ""
    playbook = "keep-shared-memory"
    return Fix(f"lupin play {playbook}{robot}{asked}", playbook=playbook, variables={"restart": restart}, safe=not restart)


def _uses_shared_memory(process: RosProcess, holders: set[int]) -> bool:
    if process.is_daemon or process.outlived or process.environment.get("FASTDDS_BUILTIN_TRANSPORTS", "").startswith("UDP"):
        return False
    return process.pid in holders


@dataclass(frozen=True)
class _Side:
    """A process that others can't share memory with."""

    pid: int
    user_id: int
    name: str
    lines: tuple[str, ...] = ()
    domains: frozenset[int] = frozenset()


def _side(process: RosProcess) -> _Side:
    return _Side(process.pid, process.user_id, process.name, (process.line("FASTDDS_BUILTIN_TRANSPORTS"),))


def _stranger(pid: int, files: tuple[SharedFile, ...]) -> _Side | None:
    """A process that holds a segment and can't be read, as another user's can't: its ports tell its domains."""
    user = next((file.user_id for file in files if file.holder == pid and file.is_segment), None)
    ports = (int(found[1]) for file in files if file.holder == pid and (found := _PORT.fullmatch(file.name)))
    domains = frozenset((port - DOMAIN_0) // DOMAIN_GAIN for port in ports if port >= DOMAIN_0)
    return None if user is None else _Side(pid, user, f"process {pid}", domains=domains)


def _shown(files: tuple[SharedFile, ...], pid: int) -> list[SharedFile]:
    return [file for file in files if file.holder == pid and not file.removed][:2]


def _apart(one: RosProcess, other: RosProcess) -> bool:
    different_memory = bool(one.shared_memory and other.shared_memory) and one.shared_memory != other.shared_memory
    return different_memory or one.user_id != other.user_id  # segments are writable for their owner only


def _unshared(facts: Facts, one: RosProcess, other: _Side, files: tuple[SharedFile, ...]) -> Finding:
    return Finding(
        id="shared-memory-not-shared",
        severity=Severity.PROBLEM,
        where=facts.machine,
        symptom="a late subscriber sees every topic name and gets no sample",
        cause=f"{one.name} (user {one.user_id}) and {other.name} (user {other.user_id}) can't share memory, and think they do",
        evidence=(
            one.line("FASTDDS_BUILTIN_TRANSPORTS"),
            *other.lines,
            *(
                f"/dev/shm/{file.name}: user {file.user_id}, held by {file.holder}"
                for side in (one, other)
                for file in _shown(files, side.pid)
            ),
        ),
        fix=Fix(f"start {other.name} again with: export FASTDDS_BUILTIN_TRANSPORTS=UDPv4"),
    )


_MEMORY = (SHARED_MEMORY, ROS_PROCESSES)
# A process that starts or ends right now holds no lock for a moment, or locks on files that it has taken away already: what is
# an orphan, or robbed, still is at the second look.
CHECKS = (
    Check("dds.zombies", find_zombies, (ROS_PROCESSES, SOCKETS), (ROS_PROCESSES, SOCKETS)),
    Check("dds.shared-memory", find_unshared_memory, _MEMORY, _MEMORY),
    Check("dds.memory-at-risk", find_memory_at_risk, (), (*_MEMORY, ACCOUNT)),
    Check(
        "dds.removed-memory",
        find_removed_memory,
        _MEMORY,
        (*_MEMORY, ACCOUNT),
        closer_laptop=(SHARED_MEMORY,),
        closer_robot=(SHARED_MEMORY,),
    ),
    Check(
        "dds.orphans",
        find_orphaned_memory,
        (SHARED_MEMORY,),
        (SHARED_MEMORY, SOCKETS, DISCOVERY_LOG),
        closer_laptop=(SHARED_MEMORY,),
        closer_robot=(SHARED_MEMORY,),
    ),
)
