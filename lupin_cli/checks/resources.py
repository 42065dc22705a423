"""Disk, memory and heat. Load is not judged: 8 to 12 on four cores is normal for the robot, and a number shows no cause."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lupin_cli.checks import ground_truth
from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import command_on, command_on_robot
from lupin_cli.checks.stale_resources import sweep_command
from lupin_cli.facts.account import ACCOUNT
from lupin_cli.facts.base import Facts
from lupin_cli.facts.clock import CLOCK
from lupin_cli.facts.memory import MEMORY
from lupin_cli.facts.shell import SHELL
from lupin_cli.facts.socket_buffers import SOCKET_BUFFERS, WINDOW_S
from lupin_cli.facts.storage import STORAGE, Mount
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL, JournalLine
from lupin_cli.facts.thermal import THERMAL
from lupin_runtime.stack.dds import SOCKET_BUFFER_BYTES

FULL_KB = 50_000  # below this, logs, temporary files and deploys fail
NEARLY_FULL_KB, NEARLY_FULL = 500_000, 0.95
SMALL_KB, SMALL_FULL_KB = 550_000, 2_000
FEW_INODES = 0.02
SHARED_MEMORY = "/dev/shm"
SHARED_MEMORY_KB = 4_000  # room for a few Fast DDS participants of 550 KB each
WRITTEN_PATHS = ("/", "/home", "/tmp", "/var", "/var/log", SHARED_MEMORY)
# Playbooks whose changes must persist, or that start something that writes.
WRITING_PLAYBOOKS = frozenset(
    {"install-clock-sync", "keep-shared-memory", "pin-wifi", "recover-discovery", "serve-clock", "start-onboard", "sync-clock"}
)
RECENT_S = 300.0  # an operator still looks for a process that was killed so long ago
LITTLE_MEMORY, STALLED = 0.05, 0.30  # fractions: of memory available, of time that processes wait for memory
HOT_C, TOO_HOT_C = 80.0, 90.0  # the vendor's limits: the board is throttled from the first on, and fails at the second


def find_storage_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """A file system is full, out of inodes or read-only."""
    for facts in snapshot.machines:
        storage = facts.get(STORAGE)
        mounts = storage.mounts if storage else ()
        written = {*WRITTEN_PATHS, *_home(facts)}
        read_only = [mount for mount in mounts if mount.read_only and mount.path in written]
        if read_only:
            paths = ", ".join(mount.path for mount in read_only)
            yield make_finding(
                "filesystem-read-only",
                where=facts.machine,
                cause=f"{paths} is read-only: the kernel remounts a file system read-only when its SD card fails",
                evidence=(f"{mount.raw} (ro)" for mount in read_only),
                instruction="if the command fails, save what is on the card and replace it: it is worn out",
                command=command_on(
                    snapshot, facts.machine, " && ".join(f"sudo mount -o remount,rw {mount.path}" for mount in read_only)
                ),
                explains={"home-not-writable"},
                blocks_playbooks=WRITING_PLAYBOOKS,
            )
        for mount in mounts:
            if mount not in read_only:
                yield from _full_mount(snapshot, facts.machine, mount)


def _home(facts: Facts) -> tuple[str, ...]:
    """Return the home folder of the machine's user, if it is known."""
    account, shell = facts.get(ACCOUNT), facts.get(SHELL)
    return tuple(filter(None, (account.home if account is not None else "", shell.home if shell is not None else "")))


def _full_mount(snapshot: Snapshot, machine: str, mount: Mount) -> Iterator[Finding]:
    show_largest = command_on(snapshot, machine, f"sudo du -xh --max-depth=2 {mount.path} | sort -h | tail")
    if mount.path == SHARED_MEMORY and mount.size_kb and mount.available_kb < SHARED_MEMORY_KB:
        # `--fix` asks first: the playbook helps only if exited processes left the files, which the size does not show.
        yield make_finding(
            "shared-memory-full",
            where=machine,
            cause=f"{mount.path} is full: {mount.available_kb} KB left",
            evidence=(mount.raw,),
            instruction=f"if {mount.path} is still full afterwards, delete its largest files that no program needs",
            command=sweep_command(snapshot, machine),
            variables={"machine": machine},
            # A program that writes to memory that the full file system cannot give is ended without a word.
            explains={"names-no-samples", *(("shell-program-fails",) if machine == "laptop" else ())},
        )
    elif mount.path != SHARED_MEMORY and mount.size_kb and _is_full(mount):
        yield make_finding(
            "disk-full",
            severity=Severity.PROBLEM if mount.available_kb < FULL_KB else Severity.WARNING,
            where=machine,
            cause=f"{mount.path} has {mount.available_kb // 1000} MB left of {mount.size_kb // 1000} MB",
            evidence=(mount.raw,),
            instruction=f"delete what is not needed on {mount.path}; the command lists its largest folders",
            command=show_largest,
        )
    elif mount.inodes and mount.inodes_free / mount.inodes < FEW_INODES:
        yield make_finding(
            "inodes-used-up",
            where=machine,
            cause=f"{mount.path} has {mount.inodes_free} of {mount.inodes} inodes left",
            evidence=(mount.raw, f"inodes: {mount.inodes_free} free of {mount.inodes}"),
            instruction=f"delete files that are not needed on {mount.path}; the command lists the folders with the most files",
            command=command_on(snapshot, machine, f"sudo du -x --inodes --max-depth=3 {mount.path} | sort -n | tail"),
        )


def _is_full(mount: Mount) -> bool:
    # Some file systems are small on purpose: /boot, and /var/log in memory, which spares the SD card.
    if mount.size_kb < SMALL_KB:
        return mount.available_kb < max(SMALL_FULL_KB, mount.size_kb // 50)
    return mount.available_kb < FULL_KB or (mount.used_fraction > NEARLY_FULL and mount.available_kb < NEARLY_FULL_KB)


def find_memory_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """Little memory is left, or the kernel killed processes for lack of it."""
    for facts in snapshot.machines:
        memory = facts.get(MEMORY)
        if memory is None:
            continue
        swap_used_up = memory.swap_free_kb < memory.swap_total_kb // 10
        if memory.available_fraction < LITTLE_MEMORY and (swap_used_up or (memory.stalled_fraction or 0.0) > STALLED):
            yield make_finding(
                "memory-low",
                where=facts.machine,
                cause=f"{memory.available_kb // 1000} of {memory.total_kb // 1000} MB of memory are available, and no swap",
                evidence=memory.lines,
                instruction="end what is not needed; the command lists the processes that use most memory, in KB",
                command=command_on(snapshot, facts.machine, "ps -eo rss,pid,args --sort=-rss | head"),
            )
        killed = [unit for unit in memory.units if unit.oom_kills]
        journal = facts.get(SYSTEM_JOURNAL)
        killing = [line for line in (journal.kernel if journal else ()) if "out of memory" in line.text.lower()]
        lines = [line.line for line in killing]
        # The counters and the journal keep a kill until the next boot. It explains nothing once everything works again.
        works = ground_truth.measure(snapshot).state is ground_truth.State.HEALTHY
        if (killed or lines) and not (works and not _are_recent(facts, killing)):
            limits = [
                f"{unit.unit}: oom_kill {unit.oom_kills}, memory.max {f'{unit.limit_kb} KB' if unit.limit_kb else 'none'}"
                for unit in killed
            ]
            yield make_finding(
                "killed-for-memory",
                where=facts.machine,
                cause="the kernel ran out of memory and killed processes"
                + (f" of {', '.join(unit.unit for unit in killed)}" if killed else ""),
                evidence=(*limits, *lines[-5:]),
                instruction="start again what was killed, and use less memory; the command lists what the kernel killed",
                command=command_on(
                    snapshot, facts.machine, "sudo journalctl --no-pager -b -k --grep 'oom-kill|out of memory' | tail -n 20"
                ),
            )


def _are_recent(facts: Facts, lines: Sequence[JournalLine]) -> bool:
    """Return whether one of the lines was written within the last minutes, by the machine's own clock."""
    clock = facts.get(CLOCK)
    return clock is not None and any(0 <= clock.epoch_ns / 1e9 - line.time_s <= RECENT_S for line in lines)


def find_heat_and_voltage_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """The robot's computer is hot, throttled, or short of voltage."""
    thermal = snapshot.robot_fact(THERMAL)
    if thermal is None:
        return
    hot = [zone for zone in thermal.zones if zone.temperature_c >= min(HOT_C, (zone.critical_c or 200.0) - 5.0)]
    voltage = [line for line in thermal.firmware if "under-voltage" in line]
    throttled = [*(line for line in thermal.firmware if line not in voltage), *(thermal.slowed if hot else ())]
    if voltage:
        yield make_finding(
            "under-voltage",
            where="robot",
            cause="the computer's power supply is too weak",
            evidence=voltage,
            instruction="charge the battery; if that does not help, check the cable that supplies the computer",
        )
    if hot or throttled:
        hottest = max((zone.temperature_c for zone in thermal.zones), default=0.0)
        yield make_finding(
            "too-hot",
            severity=Severity.PROBLEM if hottest >= TOO_HOT_C or throttled else Severity.WARNING,
            where="robot",
            cause=f"the computer is at {hottest:.0f} °C" + (" and throttled" if throttled else ""),
            evidence=(*(f"{zone.name} ({zone.kind}): {zone.temperature_c:.1f} °C" for zone in hot), *throttled),
            instruction="let the robot cool down and check its fan; the command lists its busiest processes",
            command=command_on_robot(snapshot, "ps -eo pcpu,pid,args --sort=-pcpu | head"),
        )


def find_small_socket_buffers(snapshot: Snapshot) -> Iterator[Finding]:
    """Datagrams are lost because socket buffers are full, and the kernel allows no larger ones.

    The limits of every distribution are small. So they are a fault only where they cost something.
    """
    for facts in snapshot.machines:
        buffers = facts.get(SOCKET_BUFFERS)
        if buffers is None:
            continue
        small = {
            name: limit
            for name, limit, lost in (
                ("net.core.rmem_max", buffers.receive_limit, buffers.lost_receiving),
                ("net.core.wmem_max", buffers.send_limit, buffers.lost_sending),
            )
            if lost > 0 and limit is not None and limit < SOCKET_BUFFER_BYTES
        }
        if small:
            wanted = " ".join(f"{name}={SOCKET_BUFFER_BYTES}" for name in small)
            yield make_finding(
                "socket-buffers-small",
                where=facts.machine,
                cause=f"{buffers.lost_receiving + buffers.lost_sending} datagrams were lost within {WINDOW_S} s because socket "
                f"buffers were full, and {' and '.join(f'{name} is {limit}' for name, limit in small.items())}",
                evidence=(
                    *(f"{name} = {limit}" for name, limit in small.items()),
                    f"/proc/net/snmp: RcvbufErrors +{buffers.lost_receiving}, SndbufErrors +{buffers.lost_sending}",
                ),
                command=command_on(snapshot, facts.machine, f"sudo sysctl -w {wanted}"),
                about=facts.machine,
            )


CHECKS = (
    Check("machine.storage", find_storage_faults, laptop=(STORAGE, SHELL), robot=(STORAGE, ACCOUNT)),
    Check("machine.memory", find_memory_faults, laptop=(MEMORY,), robot=(MEMORY, SYSTEM_JOURNAL, CLOCK)),
    Check("machine.socket-buffers", find_small_socket_buffers, laptop=(SOCKET_BUFFERS,), robot=(SOCKET_BUFFERS,)),
    Check("machine.heat", find_heat_and_voltage_faults, robot=(THERMAL,)),
)
