"""Decides which ROS processes and shared memory of a machine are stale. Pure: facts in, plan out.

A process is terminated only if all of these conditions hold: it is a ROS process (by its libraries) that holds a DDS port; it
does not belong to a live run of Lupin; it is not a discovery server; its parent is gone; and no service manager supervises it,
or it is stopped (state T). The daemon of the `ros2` command is terminated unless it belongs to a live run. The plan lists the
other processes on DDS ports with the reason why they are kept.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from lupin_cli.cleanup.process_tree import ProcessTree
from lupin_cli.facts.ros_processes import RosProcess, adopts
from lupin_cli.facts.shared_memory import SharedFile
from lupin_cli.facts.sockets import Sockets

# RTPS 2.2, 9.6.1.1: unicast ports of a domain's first 19 participants, 7410 to 7447 in domain 0.
_FIRST_PORT, _LAST_PORT, _PORTS_PER_DOMAIN = 7410, 7447, 250


@dataclass(frozen=True)
class StaleProcess:
    """A process to terminate."""

    pid: int
    start_ticks: int  # clock ticks since boot: distinguishes it from a later process with the same PID
    name: str
    command: str
    ports: tuple[int, ...]
    reason: str


@dataclass(frozen=True)
class Kept:
    """A process or a file that may be in the way, and why the cleanup keeps it."""

    subject: str
    reason: str
    needs_root: bool = False  # it is stale, but another user's: only root may remove it


@dataclass(frozen=True)
class StaleSegment:
    """The files of one segment, port or semaphore that no process uses.

    `lock` is the file whose lock must be held while they are removed; empty if there is none.
    """

    lock: str
    files: tuple[str, ...]
    size_bytes: int


@dataclass(frozen=True)
class CleanupPlan:
    """The processes to terminate, the shared memory to remove, and what is kept."""

    processes: tuple[StaleProcess, ...]
    segments: tuple[StaleSegment, ...]
    kept: tuple[Kept, ...]

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing to terminate or to remove."""
        return not self.processes and not self.segments


def make_plan(
    processes: Sequence[RosProcess],
    sockets: Sockets,
    files: Sequence[SharedFile],
    tree: ProcessTree,
    *,
    user_id: int,
    runs: Mapping[int, str] | None = None,
    own_pids: Collection[int] = (),
) -> CleanupPlan:
    """Plan the cleanup of one machine.

    `user_id` is the user that would clean up, `runs` maps the PIDs of live runs to their names, and `own_pids` are the PIDs of
    the cleaning program itself.
    """
    stale, kept = [], []
    by_pid = {process.pid: process for process in processes}
    for process in processes:
        ports = _dds_ports(process, sockets)
        if not ports and not process.is_daemon:
            continue
        subject = f"{process.name} ({process.pid}){_on(ports)}"
        if reason := _reason_to_keep(process, tree, runs or {}, own_pids):
            kept.append(Kept(subject, reason))
        elif user_id not in (0, process.user_id):
            kept.append(Kept(subject, f"belongs to user {process.user_id}", True))
        elif process.pid in tree.processes:
            start_ticks = tree.processes[process.pid].start_ticks
            reason = _reason_to_terminate(process)
            stale.append(StaleProcess(process.pid, start_ticks, process.name, process.command, ports, reason))
    for socket in sockets.entries:
        if socket.protocol == "udp" and _FIRST_PORT <= socket.port <= _LAST_PORT and socket.pid and socket.pid not in by_pid:
            kept.append(Kept(f"{socket.process} ({socket.pid}) on {socket.port}", "is not a ROS process"))
    segments, kept_segments = _stale_segments(files, tree, user_id)
    return CleanupPlan(tuple(stale), tuple(segments), (*kept, *kept_segments))


def _dds_ports(process: RosProcess, sockets: Sockets) -> tuple[int, ...]:
    base = _PORTS_PER_DOMAIN * process.domain
    held = {s.port for s in sockets.of(process.pid) if s.protocol == "udp" and _FIRST_PORT <= s.port - base <= _LAST_PORT}
    return tuple(sorted(held))


def _reason_to_terminate(process: RosProcess) -> str:
    if process.is_daemon:
        return "the ros2 command's daemon answers from an old cache"
    return "it is stopped and does not respond" if process.state == "T" else "its parent process is gone"


def _on(ports: tuple[int, ...]) -> str:
    return f" on {', '.join(map(str, ports))}" if ports else ""


def _reason_to_keep(process: RosProcess, tree: ProcessTree, runs: Mapping[int, str], own_pids: Collection[int]) -> str:
    """Why a ROS process must not be terminated; empty if it may be."""
    lineage = [process.pid, *(ancestor.pid for ancestor in tree.ancestors(process.pid))]
    run = next((runs[pid] for pid in lineage if pid in runs), "")
    if run:
        return f"part of the live run {run}; stop that with: lupin down"
    if process.pid in own_pids:
        return "does the cleanup"
    if process.is_daemon:
        return ""
    # A stopped process of a service does not respond either; its service manager may start it again.
    if process.state != "T" and process.supervisor:
        return f"part of {process.supervisor}; restart that instead"
    if process.is_server:
        return "a discovery server; other processes depend on it"
    if process.state != "T" and process.is_lupin:
        return f"a command of Lupin, which needs no parent; end it with: kill {process.pid}"
    parent = tree.processes.get(process.parent)
    if parent is not None and not adopts(parent.pid, parent.name):
        return f"its parent {parent.name} ({parent.pid}) is alive; terminate it there, or with: kill {process.pid}"
    return ""


def _stale_segments(files: Sequence[SharedFile], tree: ProcessTree, user_id: int) -> tuple[list[StaleSegment], list[Kept]]:
    stale, kept = [], []
    for name, group in _by_segment(files).items():
        if any(file.held for file in group):
            continue
        lock = next((file.name for file in group if file.name.endswith(("_el", "_sl"))), "")
        users = sorted({pid for file in group for pid in tree.mapped_by.get(file.name, ())})
        if not lock and (users or not tree.all_maps_readable):
            # Without a lock file, only the memory maps show whether it is in use.
            kept.append(
                Kept(
                    name,
                    f"mapped by {users}"
                    if users
                    else "the memory maps of other users' processes are not readable; run as root",
                )
            )
        elif user_id not in (0, *(file.user_id for file in group)):
            kept.append(Kept(name, f"unused, but belongs to user {group[0].user_id}", True))
        else:
            names = tuple(sorted(file.name for file in group))
            stale.append(StaleSegment(lock, names, sum(file.size_bytes for file in group)))
    return stale, kept


def _by_segment(files: Sequence[SharedFile]) -> dict[str, list[SharedFile]]:
    """The files of each segment or port, by its name: the memory, its lock, its semaphore."""
    found: dict[str, list[SharedFile]] = {}
    for file in files:
        name = file.name.removeprefix("sem.")
        for suffix in ("_el", "_sl", "_mutex"):
            name = name.removesuffix(suffix)
        found.setdefault(name, []).append(file)
    return found
