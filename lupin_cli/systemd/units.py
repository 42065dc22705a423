"""Lupin's systemd units on the robot, and their texts, rendered from templates in `systemd/` with placeholders `@name@`.

An unknown variable, a missing one, and a value that systemd or the shell would interpret differently are errors, because a
slightly wrong unit fails only at the next boot, unnoticed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from lupin_cli.package_data import shipped_folder

TEMPLATES = shipped_folder("systemd")
SUFFIX = ".service.in"
CLOCK_SYNC_SCRIPT = "/usr/local/lib/lupin/clock-sync"  # the script of lupin-clock-sync.service on a robot


@dataclass(frozen=True)
class LupinUnit:
    """A unit of Lupin on the robot. To add one, add its template in `systemd/` and its row below."""

    name: str
    symptom: str  # what the operator misses while it does not run
    missing_symptom: str = ""  # ... while it is not installed, although a release that has it is deployed
    in_release: bool = True  # a deploy installs it
    optional: bool = False  # a fault of it is a warning


ONBOARD = "lupin-onboard.service"
CAMERAS = "lupin-cameras.service"  # early releases do not have it
AUTO_HOME = "lupin-auto-home.service"
CLOCK_SYNC = "lupin-clock-sync.service"
LUPIN_UNITS: dict[str, LupinUnit] = {
    unit.name: unit
    for unit in (
        LupinUnit(
            ONBOARD,
            symptom="no drive bus, no e-stop, no arm presets, no lights",
            missing_symptom="after a boot, manual drive, e-stop, arm and lights do not work",
        ),
        LupinUnit(CAMERAS, symptom="no camera images", missing_symptom="no camera images on the page"),
        LupinUnit(
            AUTO_HOME,
            symptom="controllers stay stuck after a boot, and the arm never moves to its home pose",
            missing_symptom="the arm never moves to its home pose",
        ),
        LupinUnit(CLOCK_SYNC, symptom="the clock is wrong after a boot", in_release=False, optional=True),
    )
}

_PLACEHOLDER = re.compile(r"@([a-z_]+)@")


class UnitError(ValueError):
    """A unit cannot be rendered; the message says what was expected and found."""


def _matches(pattern: str, what: str) -> Callable[[object], str]:
    def check(value: object) -> str:
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            raise UnitError(f"expected {what}, found {value!r}")
        return value

    return check


def _shell_lines(value: object) -> str:
    """Quote lines of bash for the double quotes of an ExecStart= (systemd.service(5), Command lines); each ends with "; "."""
    if isinstance(value, str) or not isinstance(value, Sequence) or not all(isinstance(line, str) for line in value):
        raise UnitError(f"expected a list of shell lines, found {value!r}")
    quoted = []
    for line in value:
        if not line.strip() or any(character < " " for character in line):
            raise UnitError(f"expected a shell line without line breaks or control characters, found {line!r}")
        if line.lstrip().startswith("#") or line.rstrip().endswith(("\\", "&", "|", ";")):
            raise UnitError(f"expected a whole shell command, found {line!r}")
        text = line.strip().replace("\\", "\\\\").replace('"', '\\"')
        quoted.append(text.replace("$", "$$").replace("%", "%%"))
    return "".join(f"{line}; " for line in quoted)


_PATH = r"/[A-Za-z0-9._+/-]+"
VARIABLES: dict[str, Callable[[object], str]] = {
    "user": _matches(r"[a-z_][a-z0-9_-]{0,31}", "a user name"),
    "release": _matches(_PATH, "an absolute path without spaces"),
    "script": _matches(_PATH, "an absolute path without spaces"),
    "laptop": _matches(r"[A-Za-z0-9][A-Za-z0-9.:-]*", "the laptop's address"),
    "set_up": _shell_lines,
}


def unit_names() -> list[str]:
    """Return the names of the units that have a template, such as lupin-onboard.service."""
    return sorted(path.name.removesuffix(".in") for path in TEMPLATES.glob(f"*{SUFFIX}"))


def variables_of(unit: str) -> set[str]:
    """Return the variables that a unit's template needs. Raises UnitError."""
    return set(_PLACEHOLDER.findall(_template(unit)))


def render(unit: str, variables: Mapping[str, object]) -> str:
    """Return the text of a unit. Raises UnitError for a variable that is unknown, missing or malformed."""
    template = _template(unit)
    needed = set(_PLACEHOLDER.findall(template))
    if needed != set(variables):
        missing, unknown = sorted(needed - set(variables)), sorted(set(variables) - needed)
        problems = [f"missing: {', '.join(missing)}"] * bool(missing) + [f"unknown: {', '.join(unknown)}"] * bool(unknown)
        raise UnitError(f"{unit} takes {', '.join(sorted(needed))}; {'; '.join(problems)}")
    values = {}
    for name, value in variables.items():
        try:
            values[name] = VARIABLES[name](value)
        except UnitError as error:
            raise UnitError(f"{unit}: {name}: {error}") from error
    return _PLACEHOLDER.sub(lambda placeholder: values[placeholder[1]], template)


def robot_units(user: str, release: str, setup_lines: Sequence[str]) -> dict[str, str]:
    """Return the units of a release, by file name. `setup_lines` run before the units' programs. Raises UnitError."""
    variables = {"user": user, "release": release, "set_up": setup_lines}
    return {unit.name: render(unit.name, variables) for unit in LUPIN_UNITS.values() if unit.in_release}


def clock_sync_unit(laptop: str, script: str = CLOCK_SYNC_SCRIPT) -> str:
    """Return the unit that sets the clock at boot from the NTP server at the address `laptop`. Raises UnitError."""
    return render(CLOCK_SYNC, {"laptop": laptop, "script": script})


def clock_sync_script() -> str:
    """Return the script that lupin-clock-sync.service runs on the robot."""
    return (TEMPLATES / "lupin-clock-sync.sh").read_text()


def _template(unit: str) -> str:
    if unit not in unit_names():
        raise UnitError(f"there is no unit {unit!r}; there are: {', '.join(unit_names())}")
    return (TEMPLATES / f"{unit}.in").read_text()
