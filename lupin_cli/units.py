"""The robot's systemd units: templates under `systemd/`, filled in strictly. A hole is `@name@`.

An unknown name, a missing one, and a value that systemd or the shell would read as something else are errors, since a unit that
is nearly right fails at the next boot, when nobody looks.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

from lupin_cli.shipped import shipped_folder

TEMPLATES = shipped_folder("systemd")
SUFFIX = ".service.in"
CLOCK_SYNC_SCRIPT = "/usr/local/lib/lupin/clock-sync"  # where the script of lupin-clock-sync.service lies on a robot

_HOLE = re.compile(r"@([a-z_]+)@")


class UnitError(ValueError):
    """A unit that can't be rendered: what was expected, what was found."""


def _word(pattern: str, what: str) -> Callable[[object], str]:
    def check(value: object) -> str:
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            raise UnitError(f"expected {what}, found {value!r}")
        return value

    return check


def _shell_lines(value: object) -> str:
    """Lines of bash as one prefix, inside the double quotes of an ExecStart= (systemd.service(5), Command lines)."""
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
    "user": _word(r"[a-z_][a-z0-9_-]{0,31}", "a user name"),
    "release": _word(_PATH, "an absolute path without spaces"),
    "script": _word(_PATH, "an absolute path without spaces"),
    "laptop": _word(r"[A-Za-z0-9][A-Za-z0-9.:-]*", "the laptop's address"),
    "set_up": _shell_lines,
}


def unit_names() -> list[str]:
    """The units there are templates of, such as lupin-onboard.service."""
    return sorted(path.name.removesuffix(".in") for path in TEMPLATES.glob(f"*{SUFFIX}"))


def variables_of(unit: str) -> set[str]:
    """The variables that a unit's template needs. Raises UnitError."""
    return set(_HOLE.findall(_template(unit)))


def render(unit: str, variables: Mapping[str, object]) -> str:
    """The text of `unit` with every hole filled; raises UnitError for a variable that is unknown, missing or malformed."""
    template = _template(unit)
    needed = set(_HOLE.findall(template))
    if needed != set(variables):
        missing, unknown = sorted(needed - set(variables)), sorted(set(variables) - needed)
        said = [f"missing: {', '.join(missing)}"] * bool(missing) + [f"unknown: {', '.join(unknown)}"] * bool(unknown)
        raise UnitError(f"{unit} takes {', '.join(sorted(needed))}; {'; '.join(said)}")
    values = {}
    for name, value in variables.items():
        try:
            values[name] = VARIABLES[name](value)
        except UnitError as error:
            raise UnitError(f"{unit}: {name}: {error}") from error
    return _HOLE.sub(lambda hole: values[hole[1]], template)


def robot_units(user: str, release: str, set_up: Sequence[str]) -> dict[str, str]:
    """The units that a release consists of, by file name. Raises UnitError."""
    variables = {"user": user, "release": release, "set_up": set_up}
    return {unit: render(unit, variables) for unit in ("lupin-onboard.service", "lupin-auto-home.service")}


def clock_sync_unit(laptop: str, script: str = CLOCK_SYNC_SCRIPT) -> str:
    """The boot-time clock unit, for a laptop that serves its time at this address. Raises UnitError."""
    return render("lupin-clock-sync.service", {"laptop": laptop, "script": script})


def clock_sync_script() -> str:
    """What lupin-clock-sync.service runs on the robot."""
    return (TEMPLATES / "lupin-clock-sync.sh").read_text()


def _template(unit: str) -> str:
    if unit not in unit_names():
        raise UnitError(f"there is no unit {unit!r}; there are: {', '.join(unit_names())}")
    return (TEMPLATES / f"{unit}.in").read_text()
