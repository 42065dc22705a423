"""Memory, swap, memory pressure, and the number of processes killed because memory ran out."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, parse_sections

PROBE = (
    PRELUDE
    + """echo '@@ meminfo'; cat /proc/meminfo
echo '@@ vmstat'; grep -E '^oom_kill' /proc/vmstat
for f in /sys/fs/cgroup/system.slice/lupin-*.service/memory.events /sys/fs/cgroup/system.slice/mirte-*.service/memory.events; do
  [ -r "$f" ] || continue
  d=${f%/memory.events}
  echo "@@ unit ${d##*/}"; cat "$f"
  echo "max_bytes $(cat "$d/memory.max" 2>/dev/null)"; echo "current_bytes $(cat "$d/memory.current" 2>/dev/null)"
done
echo '@@ pressure'; cat /proc/pressure/memory 2>/dev/null
echo '@@ end'
"""
)


@dataclass(frozen=True)
class UnitMemory:
    """Counters of a unit's control group since the unit started."""

    unit: str
    oom_kills: int
    limit_kb: int | None  # None without a limit
    current_kb: int | None


@dataclass(frozen=True)
class Memory:
    """One machine's memory."""

    total_kb: int
    available_kb: int
    swap_total_kb: int
    swap_free_kb: int
    oom_kills: int  # since boot, of any process
    units: tuple[UnitMemory, ...]
    stalled_fraction: float | None  # share of the last minute in which some process waited for memory
    lines: tuple[str, ...]  # the lines of /proc/meminfo with these values

    @property
    def available_fraction(self) -> float:
        """Share of the memory that is available without swapping."""
        return self.available_kb / self.total_kb


def parse(output: Output) -> Memory:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    info = {}
    kept = []
    for line in sections.lines("meminfo"):
        name, _, rest = line.partition(":")
        words = rest.split()
        if words and words[0].isdigit():
            info[name] = int(words[0])
        if name in ("MemTotal", "MemAvailable", "SwapTotal", "SwapFree"):
            kept.append(" ".join(line.split()))
    missing = [name for name in ("MemTotal", "MemAvailable") if not info.get(name)]
    if missing:
        raise ValueError(f"expected {' and '.join(missing)} in /proc/meminfo, found {len(info)} other lines")
    return Memory(
        total_kb=info["MemTotal"],
        available_kb=info["MemAvailable"],
        swap_total_kb=info.get("SwapTotal", 0),
        swap_free_kb=info.get("SwapFree", 0),
        oom_kills=_pairs(sections.lines("vmstat")).get("oom_kill", 0),
        units=tuple(_unit(section.argument, section.lines) for section in sections.all("unit")),
        stalled_fraction=_stalled_fraction(sections.lines("pressure")),
        lines=tuple(kept),
    )


def _pairs(lines: tuple[str, ...]) -> dict[str, int]:
    words = [line.split() for line in lines]
    return {pair[0]: int(pair[1]) for pair in words if len(pair) == 2 and pair[1].isdigit()}


def _unit(name: str, lines: tuple[str, ...]) -> UnitMemory:
    counts = _pairs(lines)  # `max_bytes max` means no limit

    def kilobytes(key: str) -> int | None:
        return counts[key] // 1024 if key in counts else None

    return UnitMemory(name, counts.get("oom_kill", 0), kilobytes("max_bytes"), kilobytes("current_bytes"))


def _stalled_fraction(lines: tuple[str, ...]) -> float | None:
    for line in lines:
        words = line.split()
        if words[0] == "some":
            share = next((word.partition("=")[2] for word in words if word.startswith("avg60=")), "")
            return float(share) / 100.0 if share else None
    return None


MEMORY = Fact("memory", PROBE, parse, runs_in_shared_shell=True)
