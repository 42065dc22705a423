"""What the robot's own part of the stack says of itself: its processes, what the robot is doing, and its gamepads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, Section, as_root_if_allowed, parse_sections
from lupin_cli.facts.units import VENDOR
from lupin_cli.systemd.units import AUTO_HOME, CAMERAS, ONBOARD
from lupin_runtime.json_text import conform, parse_json
from lupin_runtime.lights.robot_state import NAME
from lupin_runtime.teleop.map_files import map_path
from lupin_runtime.teleop.pad_maps import PadId, find_map, parse_bits

UNITS = (VENDOR, ONBOARD, AUTO_HOME, CAMERAS)
_ROBOT = {"state": "", "reason": "", "light": "", "arm": False, "since_s": 0.0}
_STAGE = {
    "name": "",
    "phase": "",
    "trouble": "",
    "why": "",
    "waiting_for": [""],
    "up_after_s": None,
    "restarts": 0,
    "cpu_percent": 0.0,
    "memory_mb": 0.0,
}
_LAST_LINES = f"""for u in {" ".join(UNITS)}; do
  [ "$(systemctl is-failed $u)" = failed ] || [ "$(systemctl is-active $u)" = activating ] || continue
  echo "@@ journal $u"; journalctl -b -q --no-pager -o cat -n 1 -u $u
done"""

PROBE = (
    PRELUDE
    + f"""echo '@@ uptime'; cat /proc/uptime
for u in {ONBOARD} {CAMERAS}; do
  f=$(ls -t /run/${{u%.service}}/lupin/runs/*/state.json 2>/dev/null | head -n 1)
  [ -r "$f" ] && echo "@@ run $u" && head -c 100000 "$f" && echo
done
f=/run/{ONBOARD.removesuffix(".service")}/{NAME}; [ -r "$f" ] && echo '@@ robot' && head -c 4096 "$f"
echo '@@ calibrated'; ls "${{XDG_CONFIG_HOME:-$HOME/.config}}/lupin/pads" 2>/dev/null
echo '@@ usage'; systemctl show --no-pager -p Id,MemoryCurrent,CPUUsageNSec {" ".join(UNITS)} 2>/dev/null
for d in /sys/class/input/event*/device; do
  [ -r "$d/id/bustype" ] || continue
  e=${{d%/device}}; e=${{e##*/}}; echo "@@ input $e"; [ -r "/dev/input/$e" ] && echo yes || echo no
  cat "$d/id/bustype" "$d/id/vendor" "$d/id/product" "$d/id/version" "$d/capabilities/key" "$d/capabilities/abs" "$d/name"
done
"""
    + as_root_if_allowed(_LAST_LINES)
    + "echo '@@ end'\n"
)


@dataclass(frozen=True)
class Process:
    """A process of a unit, as its supervisor sees it. It first was up `up_after_s` after its unit's run began."""

    unit: str
    name: str
    phase: str
    why: str
    up_after_s: float | None
    restarts: int
    cpu_percent: float
    memory_mb: float


@dataclass(frozen=True)
class Pad:
    """A gamepad that Lupin knows, by its table or a calibration, and whether the robot's user may read it."""

    device: str
    name: str
    readable: bool


@dataclass(frozen=True)
class Onboard:
    """The robot's own part of the stack. `robot` is what the light strip's process judged, None if it wrote nothing."""

    uptime_s: float
    processes: tuple[Process, ...]
    robot: Mapping[str, Any] | None
    pads: tuple[Pad, ...]
    last_lines: Mapping[str, str]  # of the journal, by unit: only of units that failed or do not come up
    memory_mb: Mapping[str, float]  # by unit, where systemd counts it
    cpu_s: Mapping[str, float]  # by unit, since its start


def parse(output: Output) -> Onboard:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    sections.lines("end")
    robot, calibrated = sections.get("robot"), sections.get("calibrated")
    maps = frozenset(calibrated.lines if calibrated is not None else ())
    return Onboard(
        uptime_s=sections.number("uptime"),
        processes=tuple(process for section in sections.all("run") for process in _processes(section)),
        robot=conform(parse_json(robot.text), _ROBOT) if robot is not None and robot.text else None,
        pads=tuple(pad for section in sections.all("input") if (pad := _pad(section, maps)) is not None),
        last_lines={section.argument: section.text for section in sections.all("journal")},
        memory_mb={unit: value / 1e6 for unit, value in _usage(sections.lines("usage"), "MemoryCurrent").items()},
        cpu_s={unit: value / 1e9 for unit, value in _usage(sections.lines("usage"), "CPUUsageNSec").items()},
    )


def _processes(section: Section) -> list[Process]:
    state = conform(parse_json("\n".join(section.lines)), {"stages": [_STAGE]})
    return [
        Process(
            section.argument,
            stage["name"],
            "not responding" if stage["trouble"] else stage["phase"],
            stage["trouble"] or stage["why"] or "; ".join(stage["waiting_for"]),
            stage["up_after_s"],
            stage["restarts"],
            stage["cpu_percent"],
            stage["memory_mb"],
        )
        for stage in state["stages"]
    ]


def _pad(section: Section, calibrated: frozenset[str]) -> Pad | None:
    """Return a gamepad; None for another input device. `calibrated` are the names of the files of calibrated ones."""
    if len(section.lines) < 8:
        return None  # it has just been unplugged
    readable, bus, vendor, product, version, keys, axes, name = section.lines[:8]
    try:
        codes = parse_bits(keys), parse_bits(axes)
        identity = PadId(int(bus, 16), int(vendor, 16), int(product, 16), int(version, 16), *codes)
    except ValueError:
        return None
    row = find_map(identity)
    if row is None and map_path(Path(), identity).name not in calibrated:
        return None
    return Pad(section.argument, name.strip() or (row.name if row is not None else "a calibrated gamepad"), readable == "yes")


def _usage(lines: tuple[str, ...], name: str) -> dict[str, int]:
    found: dict[str, int] = {}
    values: dict[str, str] = {}
    for key, _, value in (line.partition("=") for line in lines):
        if key in values:
            values = {}
        values[key] = value
        # A unit that does not run has [not set], which older versions print as the largest number.
        if "Id" in values and values.get(name, "").isdigit() and int(values[name]) < 2**63:
            found[values["Id"]] = int(values[name])
    return found


ONBOARD_STATE = Fact("onboard", PROBE, parse)
