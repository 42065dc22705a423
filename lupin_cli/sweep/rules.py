"""What of a machine's ROS processes and shared memory is left over. Pure: facts in, plan out.

A process is ended only where all of this holds: it is a ROS process (by its libraries), it holds a DDS port, no live run of
ours owns it, no service manager looks after it, and whoever started it is gone. All others are named and left alone.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from lupin_cli.facts.ros_processes import RosProcess
from lupin_cli.facts.shared_memory import SharedFile
from lupin_cli.facts.sockets import Sockets
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.sweep.families import Families

# RTPS 2.2, 9.6.1.1: unicast ports of a domain's first 19 participants, 7410 to 7447 in domain 0.
_FIRST_PORT, _LAST_PORT, _PORTS_PER_DOMAIN = 7410, 7447, 250
# A process whose parent ended is handed to one of these.
_FOSTER_PARENTS = ("systemd", "init", "tini", "dumb-init", "docker-init", "containerd-shim")


@dataclass(frozen=True)
class Culprit:
    """A process to end."""

    pid: int
    start_ticks: int
    name: str
    command: str
    ports: tuple[int, ...]
    why: str


@dataclass(frozen=True)
class Kept:
    """Something that is in the way or looks like it, and why it stays."""

    what: str
    why: str
    blocks: bool = False  # it is left over, but not ours to remove


@dataclass(frozen=True)
class Orphan:
    """Files of one segment, port or semaphore that nobody uses. `lock` is the file to hold while they are removed, or empty."""

    lock: str
    files: tuple[str, ...]
    size_bytes: int


@dataclass(frozen=True)
class Plan:
    """What to end, what to remove, what to leave."""

    culprits: tuple[Culprit, ...]
    orphans: tuple[Orphan, ...]
    kept: tuple[Kept, ...]

    @property
    def clean(self) -> bool:
        """Whether there is nothing to do."""
        return not self.culprits and not self.orphans


def make_plan(
    processes: Sequence[RosProcess],
    sockets: Sockets,
    files: Sequence[SharedFile],
    families: Families,
    *,
    user_id: int,
    runs: Mapping[int, str] | None = None,
    ourselves: Collection[int] = (),
) -> Plan:
    """What is left over on a machine.

    `user_id` is who would do the sweeping, `runs` the processes of live runs with the names of these, `ourselves` the processes
    that must not be touched since they do the sweeping.
    """
    culprits, kept = [], []
    by_pid = {process.pid: process for process in processes}
    for process in processes:
        ports = _ports(process, sockets)
        if not ports and not process.is_daemon:
            continue
        reason = _protected(process, families, runs or {}, ourselves)
        if reason:
            kept.append(Kept(f"{process.name} ({process.pid}){_on(ports)}", reason))
        elif user_id not in (0, process.user_id):
            kept.append(Kept(f"{process.name} ({process.pid}){_on(ports)}", f"belongs to user {process.user_id}", True))
        elif process.pid in families.members:
            start = families.members[process.pid].start_ticks
            culprits.append(Culprit(process.pid, start, process.name, process.command, ports, _why(process)))
    for socket in sockets.every:
        if socket.protocol == "udp" and _FIRST_PORT <= socket.port <= _LAST_PORT and socket.pid and socket.pid not in by_pid:
            kept.append(Kept(f"{socket.process} ({socket.pid}) on {socket.port}", "is no ROS process"))
    orphans, foreign = _orphans(files, families, user_id)
    return Plan(tuple(culprits), tuple(orphans), (*kept, *foreign))


def _ports(process: RosProcess, sockets: Sockets) -> tuple[int, ...]:
    base = _PORTS_PER_DOMAIN * process.domain
    held = {s.port for s in sockets.of(process.pid) if s.protocol == "udp" and _FIRST_PORT <= s.port - base <= _LAST_PORT}
    return tuple(sorted(held))


def _why(process: RosProcess) -> str:
    if process.is_daemon:
        return "the ros2 command's daemon answers from what it once saw"
    return "it is stopped and answers nobody" if process.state == "T" else "who started it is gone"


def _on(ports: tuple[int, ...]) -> str:
    return f" on {', '.join(map(str, ports))}" if ports else ""


def _protected(process: RosProcess, families: Families, runs: Mapping[int, str], ourselves: Collection[int]) -> str:
    """Why a ROS process must not be ended; empty where nothing speaks for it."""
    line = [process.pid, *(member.pid for member in families.ancestors(process.pid))]
    run = next((runs[pid] for pid in line if pid in runs), "")
    if run:
        return f"part of the live run {run}; end that with: lupin down"
    if process.pid in ourselves:
        return "does the sweeping"
    if process.is_daemon:
        return ""
    unit = process.group.rpartition("/")[2]
    # A service's process that is stopped answers nobody either; its service manager may start it again.
    if process.state != "T" and unit.endswith(".service") and not unit.startswith("user@"):
        return f"part of {unit}; restart that instead"
    if process.is_server:
        return "a discovery server; others wait for it"
    parent = families.members.get(process.parent)
    if parent is not None and parent.pid != 1 and parent.name not in _FOSTER_PARENTS:
        return f"started by {parent.name} ({parent.pid}), which lives; end it there, or with: kill {process.pid}"
    return ""


def _orphans(files: Sequence[SharedFile], families: Families, user_id: int) -> tuple[list[Orphan], list[Kept]]:
    orphans, kept = [], []
    for owner, group in _by_owner(files).items():
        if any(file.held for file in group):
            continue
        lock = next((file.name for file in group if file.name.endswith(("_el", "_sl"))), "")
        users = sorted({pid for file in group for pid in families.maps.get(file.name, ())})
        if not lock and (users or not families.every_map_read):
            # Without a lock only the maps tell whether it is in use.
            kept.append(
                Kept(owner, f"mapped by {users}" if users else "other users' processes can't be looked at; ask as root")
            )
        elif user_id not in (0, *(file.user_id for file in group)):
            kept.append(Kept(owner, f"nobody's any more, but belongs to user {group[0].user_id}", True))
        else:
            names = tuple(sorted(file.name for file in group))
            orphans.append(Orphan(lock, names, sum(file.size_bytes for file in group)))
    return orphans, kept


def _by_owner(files: Sequence[SharedFile]) -> dict[str, list[SharedFile]]:
    """The files of each segment or port: itself, its lock, its semaphore."""
    found: dict[str, list[SharedFile]] = {}
    for file in files:
        name = file.name.removeprefix("sem.")
        for suffix in ("_el", "_sl", "_mutex"):
            name = name.removesuffix(suffix)
        found.setdefault(name, []).append(file)
    return found
