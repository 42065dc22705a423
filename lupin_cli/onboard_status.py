"""The status of a robot by itself: what its units, processes and devices do, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from lupin_cli.facts.onboard import UNITS, Onboard, Process
from lupin_cli.facts.units import VENDOR, Unit, Units
from lupin_cli.systemd.units import AUTO_HOME, ONBOARD
from lupin_runtime.cameras.driver_state import OFF, RUNNING, DriverState
from lupin_runtime.lights.robot_state import RobotState

DEPLOY, DOCTOR, HOME = "lupin deploy robot", "lupin doctor", "lupin home"
_UNKNOWN = "unknown"


@dataclass(frozen=True)
class UnitLine:
    """A unit. `since_s` is how long it is in its state, `cpu_percent` that of one core since then; None if not known."""

    name: str
    state: str
    since_s: float | None
    memory_mb: float | None
    cpu_percent: float | None
    last_line: str  # of its journal, if it failed


@dataclass(frozen=True)
class Problem:
    """What is wrong, and the command that helps: one of `lupin`, or one for the robot."""

    text: str
    next_command: str


@dataclass(frozen=True)
class Status:
    """The status of one robot. `doing` is a RobotState's value or "unknown", and `light` the rule that its strip follows."""

    robot: str
    doing: str
    reason: str
    light: str
    units: tuple[UnitLine, ...]
    processes: tuple[Process, ...]
    devices: Mapping[str, str]
    problems: tuple[Problem, ...]

    @property
    def ready(self) -> bool:
        """Whether the robot is ready, and nothing is wrong."""
        return self.doing == RobotState.READY.value and not self.problems

    def plain(self) -> dict[str, Any]:
        """Return the status for `--json`."""
        return {**asdict(self), "ready": self.ready}


def judge(robot: str, units: Units, onboard: Onboard, cameras: Mapping[str, DriverState]) -> Status:
    """Return the status of the robot of this name."""
    lines = tuple(_unit_line(name, units.get(name), onboard) for name in UNITS)
    # Without the process that writes it, what the robot is doing is an old judgement.
    is_current = any(process.name == "body" and process.phase == "up" for process in onboard.processes)
    said = onboard.robot if is_current and onboard.robot is not None else {}
    doing = str(said.get("state") or _UNKNOWN)
    devices = {
        "arm": ("its joint states arrive" if said["arm"] else "no joint states") if said else _UNKNOWN,
        **{f"{name} camera": f"{each.state}: {each.text}".rstrip(": ") for name, each in cameras.items()},
        "gamepad": ", ".join(pad.name + ("" if pad.readable else " (may not be read)") for pad in onboard.pads) or "none",
    }
    problems = [*_unit_problems(units, lines), *_process_problems(onboard)]
    if doing == RobotState.HELP.value:
        problems.append(Problem(str(said["reason"]), HOME if "arm is not home" in str(said["reason"]) else DOCTOR))
    if said.get("light") == "e-stop or fault":
        problems.append(Problem("the e-stop is engaged, or a mission is in FAULT", DOCTOR))
    problems += [Problem(f"{pad.name} may not be read", DEPLOY) for pad in onboard.pads if not pad.readable]
    problems += [
        Problem(f"the {name} camera does not run: {each.text}", DOCTOR)
        for name, each in cameras.items()
        if each.state not in (OFF, RUNNING)
    ]
    if doing == _UNKNOWN and not problems:
        problems.append(Problem("its process body has not said what the robot does", f"journalctl -b -u {ONBOARD} -n 50"))
    reason, light = str(said.get("reason", "")), str(said.get("light", ""))
    return Status(robot, doing, reason, light, lines, onboard.processes, devices, tuple(problems))


def _unit_line(name: str, unit: Unit | None, onboard: Onboard) -> UnitLine:
    if unit is None:
        return UnitLine(name, "not installed", None, None, None, "")
    state = unit.active if unit.active == unit.sub or unit.active == "active" else f"{unit.active} ({unit.sub})"
    began_s = unit.active_since_s if unit.active == "active" else unit.started_s
    since_s = onboard.uptime_s - began_s if began_s and unit.running else None
    used_s = onboard.cpu_s.get(name)
    percent = 100.0 * used_s / since_s if used_s is not None and since_s else None
    return UnitLine(name, state, since_s, onboard.memory_mb.get(name), percent, onboard.last_lines.get(name, ""))


def _unit_problems(units: Units, lines: tuple[UnitLine, ...]) -> list[Problem]:
    if not units.systemd:
        return [Problem(f"systemd does not run on it: its first process is {units.pid1}", DOCTOR)]
    found = []
    for line in lines:
        unit, says = units.get(line.name), f": {line.last_line}" if line.last_line else ""
        if unit is None:
            found.append(Problem(f"{line.name} is not installed", DOCTOR if line.name == VENDOR else DEPLOY))
        elif unit.active == "failed":
            command = HOME if line.name == AUTO_HOME else DOCTOR
            found.append(Problem(f"{line.name} failed ({unit.result}){says}", command))
        elif line.name != AUTO_HOME and unit.active != "active":
            start = f"sudo systemctl start {line.name}" if unit.active == "inactive" else f"journalctl -b -u {line.name} -n 50"
            found.append(Problem(f"{line.name} is {line.state}{says}", start))
    return found


def _process_problems(onboard: Onboard) -> list[Problem]:
    def command(process: Process) -> str:
        return f"journalctl -b -u {process.unit} -n 50"

    # A camera's process is judged by the state of its driver.
    return [
        Problem(f"{each.name} is {each.phase}" + (f": {each.why}" if each.why else ""), command(each))
        for each in onboard.processes
        if each.phase != "up" and each.unit == ONBOARD
    ]
