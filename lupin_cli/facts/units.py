"""The states of Lupin's and the vendor's systemd units, and all failed units."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from ipaddress import ip_address, ip_network

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, number, parse_sections
from lupin_cli.systemd.units import LUPIN_UNITS

VENDOR = "mirte-ros.service"
UNITS = (VENDOR, *LUPIN_UNITS, "mirte-ap.service", "mirte-wifi-watchdog.service", "chrony.service")

PROPERTIES = (
    "Id,LoadState,ActiveState,SubState,Result,Type,NRestarts,UnitFileState,PartOf,MainPID,ExecMainStatus,"
    "ActiveEnterTimestampMonotonic,InactiveExitTimestampMonotonic,NeedDaemonReload,FragmentPath,DropInPaths,Environment,"
    "FreezerState,IPAddressDeny,IPAddressAllow,PrivateNetwork,RestrictAddressFamilies"
)

PROBE = (
    PRELUDE
    + f"""if [ ! -d /run/systemd/system ]; then echo '@@ no-systemd'; cat /proc/1/comm; exit 0; fi
echo '@@ show'; systemctl show --no-pager -p {PROPERTIES} {" ".join(UNITS)}
echo '@@ failed'; systemctl list-units --failed --plain --no-legend --no-pager
echo '@@ assignments'
systemctl cat --no-pager {VENDOR} {" ".join(LUPIN_UNITS)} 2>/dev/null | grep -E '^(# /|[[:space:]]*Environment=)'
echo '@@ uptime'; cat /proc/uptime
"""
)


@dataclass(frozen=True)
class Unit:
    """A unit as `systemctl show` prints it. Times are seconds since boot (monotonic clock); 0.0 for never."""

    name: str
    load: str  # loaded, not-found, masked, bad-setting, error
    active: str  # active, activating, deactivating, inactive, failed
    sub: str
    result: str  # success, exit-code, signal, timeout, start-limit-hit, oom-kill, ...
    type: str
    restarts: int
    enabled: str  # enabled, disabled, masked, static, ""
    part_of: tuple[str, ...]
    main_pid: int
    exit_status: int
    active_since_s: float
    started_s: float  # when it last began to start
    needs_reload: bool
    path: str
    drop_ins: tuple[str, ...] = ()  # files beside the unit's own that change it
    environment: Mapping[str, str] = field(default_factory=dict)  # that the unit's files set
    assignments: Mapping[str, Mapping[str, str]] = field(default_factory=dict)  # file → the variables that it sets
    frozen: bool = False  # `systemctl freeze`: its processes do not run
    network_limits: tuple[str, ...] = ()  # settings with which its processes do not reach the network

    @property
    def installed(self) -> bool:
        """Whether systemd found a unit file."""
        return self.load not in ("not-found", "")

    @property
    def running(self) -> bool:
        """Whether it is active or starting."""
        return self.active in ("active", "activating", "reloading")

    def files_setting(self, variable: str, value: str) -> tuple[str, ...]:
        """Return the unit's files that set a variable to a value."""
        return tuple(file for file, variables in self.assignments.items() if variables.get(variable) == value)

    def line(self) -> str:
        """Return the most important properties, under systemd's names."""
        return (
            f"{self.name}: LoadState={self.load} ActiveState={self.active} SubState={self.sub} Result={self.result} "
            f"UnitFileState={self.enabled or '-'} NRestarts={self.restarts} ExecMainStatus={self.exit_status}"
        )


@dataclass(frozen=True)
class Units:
    """All units. `systemd` is False if another program, named by `pid1`, is PID 1."""

    systemd: bool
    units: tuple[Unit, ...] = ()
    failed: tuple[str, ...] = ()  # names of all failed units
    pid1: str = "systemd"
    uptime_s: float | None = None  # of the machine, when the units were read

    def get(self, name: str) -> Unit | None:
        """Return the unit of that name, or None if it is not installed."""
        return next((unit for unit in self.units if unit.name == name and unit.installed), None)


def parse(output: Output) -> Units:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    if sections.get("no-systemd"):
        return Units(systemd=False, pid1=sections.text("no-systemd"))
    section = sections.get("show")
    blocks: list[dict[str, str]] = [{}]
    for line in section.lines if section else ():
        key, equals, value = line.partition("=")
        if equals and (key not in blocks[-1]):
            blocks[-1][key] = value
        elif not line.strip():
            blocks.append({})
    assignments = _parse_assignments(sections.lines("assignments") if sections.get("assignments") else ())
    units = tuple(_unit(block, assignments) for block in blocks if block.get("Id"))
    if not units:
        raise ValueError(
            f"expected blocks of systemctl show, found {output.stdout[:80]!r}; stderr {output.stderr.strip()[:120]!r}"
        )
    # Older versions of systemd mark failed units with a dot even in plain mode.
    failed = tuple(line.lstrip("●* ").split()[0] for line in sections.lines("failed") if line.strip("●* "))
    uptime = sections.get("uptime")
    return Units(True, units, failed, uptime_s=number(uptime.text.split()[0], "an uptime") if uptime and uptime.text else None)


def _parse_assignments(lines: Iterable[str]) -> dict[str, dict[str, str]]:
    """Return the variables that each file sets, from lines of `systemctl cat`."""
    found: dict[str, dict[str, str]] = {}
    path = ""
    for line in lines:
        if line.startswith("# /"):
            path = line.removeprefix("# ").strip()
        else:
            found.setdefault(path, {}).update(_parse_environment(line.partition("=")[2]))
    return found


def _unit(block: dict[str, str], assignments: Mapping[str, Mapping[str, str]]) -> Unit:
    def whole(key: str) -> int:
        text = block.get(key, "")
        return int(text) if text.isdigit() else 0

    return Unit(
        name=block["Id"],
        load=block.get("LoadState", ""),
        active=block.get("ActiveState", ""),
        sub=block.get("SubState", ""),
        result=block.get("Result", ""),
        type=block.get("Type", ""),
        restarts=whole("NRestarts"),
        enabled=block.get("UnitFileState", ""),
        part_of=tuple(block.get("PartOf", "").split()),
        main_pid=whole("MainPID"),
        exit_status=whole("ExecMainStatus"),
        active_since_s=whole("ActiveEnterTimestampMonotonic") / 1e6,
        started_s=whole("InactiveExitTimestampMonotonic") / 1e6,
        needs_reload=block.get("NeedDaemonReload") == "yes",
        path=block.get("FragmentPath", ""),
        drop_ins=tuple(block.get("DropInPaths", "").split()),
        environment=_parse_environment(block.get("Environment", "")),
        assignments={
            file: assignments[file]
            for file in (block.get("FragmentPath", ""), *block.get("DropInPaths", "").split())
            if file in assignments
        },
        frozen=block.get("FreezerState", "") in ("frozen", "freezing"),
        network_limits=tuple(_network_limits(block)),
    )


def _network_limits(block: dict[str, str]) -> Iterator[str]:
    denied, allowed = block.get("IPAddressDeny", ""), block.get("IPAddressAllow", "")
    if denied and not ("0.0.0.0/0" in allowed or "::/0" in allowed):
        yield f"IPAddressDeny={denied}" + (f" IPAddressAllow={allowed}" if allowed else "")
    if block.get("PrivateNetwork") == "yes":
        yield "PrivateNetwork=yes"
    families = block.get("RestrictAddressFamilies", "")
    if families and not families.startswith("~") and "AF_INET" not in families.split():
        yield f"RestrictAddressFamilies={families}"
    if families.startswith("~") and "AF_INET" in families[1:].split():
        yield f"RestrictAddressFamilies={families}"


def admits(limit: str, address: str) -> bool:
    """Return whether one of a unit's `network_limits` lets it exchange packets with an IPv4 address: what is allowed wins."""
    denied, _, allowed = limit.removeprefix("IPAddressDeny=").partition(" IPAddressAllow=")
    if not limit.startswith("IPAddressDeny="):
        return False

    def names(text: str) -> bool:
        networks = [ip_network(word, strict=False) for word in text.split() if ":" not in word]
        return any(ip_address(address) in network for network in networks)

    try:
        return names(allowed) or not names(denied)
    except ValueError:  # a word that this version of systemd does not print as a network
        return False


def _parse_environment(text: str) -> dict[str, str]:
    try:
        words = shlex.split(text)  # systemd quotes assignments with spaces
    except ValueError:
        words = text.split()
    return dict(word.split("=", 1) for word in words if "=" in word)


UNIT_STATES = Fact("units", PROBE, parse)
