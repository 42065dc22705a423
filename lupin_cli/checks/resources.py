"""Disk, memory and heat. Load is not judged: 8 to 12 on four cores is normal for the robot, and a number shows no cause."""

from __future__ import annotations

from collections.abc import Iterator

from lupin_cli.checks.base import Check, Finding, Severity, Snapshot
from lupin_cli.checks.findings import make_finding
from lupin_cli.checks.remote_command import command_on, command_on_robot
from lupin_cli.checks.stale_resources import sweep_command
from lupin_cli.facts.memory import MEMORY
from lupin_cli.facts.storage import STORAGE, Mount
from lupin_cli.facts.system_journal import SYSTEM_JOURNAL
from lupin_cli.facts.thermal import THERMAL

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
LITTLE_MEMORY, STALLED = 0.05, 0.30  # fractions: of memory available, of time that processes wait for memory
HOT_C, TOO_HOT_C = 80.0, 90.0  # the vendor's limits: the board is throttled from the first on, and fails at the second


def find_storage_faults(snapshot: Snapshot) -> Iterator[Finding]:
    """A file system is full, out of inodes or read-only."""
    for facts in snapshot.machines:
        storage = facts.get(STORAGE)
        mounts = storage.mounts if storage else ()
        read_only = [mount for mount in mounts if mount.read_only and mount.path in WRITTEN_PATHS]
        if read_only:
            paths = ", ".join(mount.path for mount in read_only)
            yield make_finding(
                "filesystem-read-only",
                where=facts.machine,
                cause=f"{paths} is read-only: the kernel remounts a file system read-only when the card fails",
                evidence=(f"{mount.raw} (ro)" for mount in read_only),
                command=command_on(snapshot, facts.machine, "sudo dmesg | grep -iE 'error|remount'"),
                explains={"home-not-writable"},
                blocks_playbooks=WRITING_PLAYBOOKS,
            )
        for mount in mounts:
            if mount not in read_only:
                yield from _full_mount(snapshot, facts.machine, mount)


def _full_mount(snapshot: Snapshot, machine: str, mount: Mount) -> Iterator[Finding]:
    show_largest = command_on(snapshot, machine, f"sudo du -xh --max-depth=2 {mount.path} | sort -h | tail")
    if mount.path == SHARED_MEMORY and mount.size_kb and mount.available_kb < SHARED_MEMORY_KB:
        # `--fix` asks first: the playbook helps only if exited processes left the files, which the size does not show.
        yield make_finding(
            "shared-memory-full",
            where=machine,
            cause=f"{mount.path} is full: {mount.available_kb} KB left",
            evidence=(mount.raw,),
            command=sweep_command(snapshot, machine),
            variables={"machine": machine},
            explains={"names-no-samples"},
        )
    elif mount.path != SHARED_MEMORY and mount.size_kb and _is_full(mount):
        yield make_finding(
            "disk-full",
            severity=Severity.PROBLEM if mount.available_kb < FULL_KB else Severity.WARNING,
            where=machine,
            cause=f"{mount.path} has {mount.available_kb // 1000} MB left of {mount.size_kb // 1000} MB",
            evidence=(mount.raw,),
            command=show_largest,
        )
    elif mount.inodes and mount.inodes_free / mount.inodes < FEW_INODES:
        yield make_finding(
            "inodes-used-up",
            where=machine,
            cause=f"{mount.path} has {mount.inodes_free} of {mount.inodes} inodes left",
            evidence=(mount.raw, f"inodes: {mount.inodes_free} free of {mount.inodes}"),
            command=show_largest,
        )


def _is_full(mount: Mount) -> bool:
    # Some file systems are small on purpose: /boot, and /var/log in memory, which spares the card.
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
                command=command_on(snapshot, facts.machine, "ps -eo rss,pid,args --sort=-rss | head"),
            )
        killed = [unit for unit in memory.units if unit.oom_kills]
        journal = facts.get(SYSTEM_JOURNAL)
        lines = [line.raw for line in journal.kernel if "out of memory" in line.text.lower()] if journal else []
        if killed or lines:
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
                command=command_on(snapshot, facts.machine, "journalctl -b -k | grep -iE 'oom|out of memory'"),
            )


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
            command="charge the battery, then check the computer's supply cable",
        )
    if hot or throttled:
        hottest = max((zone.temperature_c for zone in thermal.zones), default=0.0)
        yield make_finding(
            "too-hot",
            severity=Severity.PROBLEM if hottest >= TOO_HOT_C or throttled else Severity.WARNING,
            where="robot",
            cause=f"the computer is at {hottest:.0f} °C" + (" and throttled" if throttled else ""),
            evidence=(*(f"{zone.name} ({zone.kind}): {zone.temperature_c:.1f} °C" for zone in hot), *throttled),
            command="let the robot cool down and check its fan; then list the busiest processes: "
            + command_on_robot(snapshot, "ps -eo pcpu,pid,args --sort=-pcpu | head"),
        )


CHECKS = (
    Check("machine.storage", find_storage_faults, laptop=(STORAGE,), robot=(STORAGE,)),
    Check("machine.memory", find_memory_faults, laptop=(MEMORY,), robot=(MEMORY, SYSTEM_JOURNAL)),
    Check("machine.heat", find_heat_and_voltage_faults, robot=(THERMAL,)),
)
