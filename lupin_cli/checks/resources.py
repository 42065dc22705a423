"""Disk, memory and heat. Not load: eight to twelve on four cores is a healthy robot's, and a number alone tells no cause."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from lupin_cli.checks.base import Check, Evidence, Finding, Fix, Severity
from lupin_cli.checks.leftovers import sweep
from lupin_cli.checks.typed import on_robot, there
from lupin_cli.facts.base import Facts
from lupin_cli.facts.journal import JOURNAL
from lupin_cli.facts.memory import MEMORY
from lupin_cli.facts.storage import STORAGE, Mount
from lupin_cli.facts.thermal import THERMAL

FULL_KB = 50_000  # nothing works any more: logs, temporary files, a deploy
NEARLY_FULL_KB, NEARLY_FULL = 500_000, 0.95
SMALL_KB, SMALL_FULL_KB = 550_000, 2_000
FEW_INODES = 0.02
SHARED_MEMORY = "/dev/shm"
SHARED_MEMORY_KB = 4_000  # a participant of Fast DDS takes 550 KB, a few of them take this
WRITTEN = ("/", "/home", "/tmp", "/var", "/var/log", SHARED_MEMORY)
# What they change has to be kept, or what they start writes.
WRITING = frozenset(
    {"install-clock-sync", "keep-shared-memory", "pin-wifi", "recover-discovery", "serve-clock", "start-onboard", "sync-clock"}
)
LITTLE_MEMORY, STALLED = 0.05, 0.30
HOT_C, TOO_HOT_C = 80.0, 90.0  # where the board's vendor begins to throttle, and where it gives up


def _machines(evidence: Evidence) -> Iterator[Facts]:
    yield evidence.laptop
    if evidence.robot is not None:
        yield evidence.robot


def storage(evidence: Evidence) -> Iterator[Finding]:
    """File systems that are full, out of inodes or read-only."""
    for facts in _machines(evidence):
        seen = facts.get(STORAGE)
        mounts = seen.mounts if seen else ()
        if locked := [mount for mount in mounts if mount.read_only and mount.path in WRITTEN]:
            yield Finding(
                id="filesystem-read-only",
                severity=Severity.PROBLEM,
                where=facts.machine,
                symptom="logs stop, settings are lost, a deploy fails",
                cause=f"{', '.join(mount.path for mount in locked)} is read-only: the kernel does that when the card fails",
                evidence=tuple(f"{mount.raw} (ro)" for mount in locked),
                fix=Fix(there(evidence, facts.machine, "sudo dmesg | grep -iE 'error|remount'")),
                explains=frozenset({"home-not-writable"}),
                hinders=WRITING,
            )
        for mount in mounts:
            if mount in locked:
                continue
            show = there(evidence, facts.machine, f"sudo du -xh --max-depth=2 {mount.path} | sort -h | tail")
            if mount.path == SHARED_MEMORY and mount.size_kb and mount.available_kb < SHARED_MEMORY_KB:
                yield Finding(
                    id="shared-memory-full",
                    severity=Severity.PROBLEM,
                    where=facts.machine,
                    symptom="new nodes see names and no samples, or die at start",
                    cause=f"{mount.path} is full: {mount.available_kb} KB left",
                    evidence=(mount.raw,),
                    # It helps where the dead hold it, which the size alone does not tell.
                    fix=replace(sweep(evidence, facts.machine), safe=False),
                    explains=frozenset({"names-no-samples"}),
                )
            elif mount.path != SHARED_MEMORY and mount.size_kb and _short(mount):
                full = mount.available_kb < FULL_KB
                yield Finding(
                    id="disk-full",
                    severity=Severity.PROBLEM if full else Severity.WARNING,
                    where=facts.machine,
                    symptom="logs stop, a deploy fails, services that write die at start",
                    cause=f"{mount.path} has {mount.available_kb // 1000} MB left of {mount.size_kb // 1000} MB",
                    evidence=(mount.raw,),
                    fix=Fix(show),
                )
            elif mount.inodes and mount.inodes_free / mount.inodes < FEW_INODES:
                yield Finding(
                    id="inodes-used-up",
                    severity=Severity.PROBLEM,
                    where=facts.machine,
                    symptom="'No space left on device' although there is space",
                    cause=f"{mount.path} has {mount.inodes_free} of {mount.inodes} inodes left",
                    evidence=(mount.raw, f"inodes: {mount.inodes_free} free of {mount.inodes}"),
                    fix=Fix(show),
                )


def _short(mount: Mount) -> bool:
    # Small file systems are small on purpose: /boot, and /var/log in memory, which spares the card.
    if mount.size_kb < SMALL_KB:
        return mount.available_kb < max(SMALL_FULL_KB, mount.size_kb // 50)
    return mount.available_kb < FULL_KB or (mount.used_fraction > NEARLY_FULL and mount.available_kb < NEARLY_FULL_KB)


def memory(evidence: Evidence) -> Iterator[Finding]:
    """Little memory left, or processes killed for it."""
    for facts in _machines(evidence):
        seen = facts.get(MEMORY)
        if seen is None:
            continue
        swapped_out = seen.swap_free_kb < seen.swap_total_kb // 10
        if seen.available_fraction < LITTLE_MEMORY and (swapped_out or (seen.stalled_fraction or 0.0) > STALLED):
            yield Finding(
                id="memory-low",
                severity=Severity.PROBLEM,
                where=facts.machine,
                symptom="everything stutters; soon something is killed",
                cause=f"{seen.available_kb // 1000} of {seen.total_kb // 1000} MB of memory are available, and no swap",
                evidence=seen.lines,
                fix=Fix(there(evidence, facts.machine, "ps -eo rss,pid,args --sort=-rss | head")),
            )
        killed = [unit for unit in seen.units if unit.oom_kills]
        journal = facts.get(JOURNAL)
        lines = [line.raw for line in journal.kernel if "out of memory" in line.text.lower()] if journal else []
        if killed or lines:
            limits = [
                f"{unit.unit}: oom_kill {unit.oom_kills}, memory.max {f'{unit.limit_kb} KB' if unit.limit_kb else 'none'}"
                for unit in killed
            ]
            yield Finding(
                id="killed-for-memory",
                severity=Severity.WARNING,
                where=facts.machine,
                symptom="a process vanished without a word",
                cause="for want of memory the kernel killed processes"
                + (f" of {', '.join(unit.unit for unit in killed)}" if killed else ""),
                evidence=(*limits, *lines[-5:]),
                fix=Fix(there(evidence, facts.machine, "journalctl -b -k | grep -iE 'oom|out of memory'")),
            )


def heat(evidence: Evidence) -> Iterator[Finding]:
    """A robot that is hot, slowed down, or short of voltage."""
    seen = evidence.robot.get(THERMAL) if evidence.robot else None
    if seen is None:
        return
    hot = [zone for zone in seen.zones if zone.temperature_c >= min(HOT_C, (zone.critical_c or 200.0) - 5.0)]
    voltage = [line for line in seen.firmware if "under-voltage" in line]
    slowed = [*(line for line in seen.firmware if line not in voltage), *(seen.slowed if hot else ())]
    if voltage:
        yield Finding(
            id="under-voltage",
            severity=Severity.PROBLEM,
            where="robot",
            symptom="USB devices drop out, the board resets, the card loses data",
            cause="the computer's supply is too weak",
            evidence=tuple(voltage),
            fix=Fix("charge the battery, then look at the computer's supply cable"),
        )
    if hot or slowed:
        hottest = max((zone.temperature_c for zone in seen.zones), default=0.0)
        yield Finding(
            id="too-hot",
            severity=Severity.PROBLEM if hottest >= TOO_HOT_C or slowed else Severity.WARNING,
            where="robot",
            symptom="nodes miss their rates, pictures and scans come late",
            cause=f"the computer is at {hottest:.0f} °C" + (" and slows itself down" if slowed else ""),
            evidence=(*(f"{zone.name} ({zone.kind}): {zone.temperature_c:.1f} °C" for zone in hot), *slowed),
            fix=Fix(on_robot(evidence, "sudo systemctl stop lupin-cameras")),
        )


CHECKS = (
    Check("machine.storage", storage, laptop=(STORAGE,), robot=(STORAGE,)),
    Check("machine.memory", memory, laptop=(MEMORY,), robot=(MEMORY, JOURNAL)),
    Check("machine.heat", heat, robot=(THERMAL,)),
)
