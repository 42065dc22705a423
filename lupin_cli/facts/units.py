"""The states of Lupin's and the vendor's systemd units, and all failed units."""

from __future__ import annotations

from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, parse_sections
from lupin_cli.systemd.units import LUPIN_UNITS

VENDOR = "mirte-ros.service"
UNITS = (VENDOR, *LUPIN_UNITS, "mirte-ap.service", "mirte-wifi-watchdog.service", "chrony.service")

PROPERTIES = (
    "Id,LoadState,ActiveState,SubState,Result,Type,NRestarts,UnitFileState,PartOf,MainPID,ExecMainStatus,"
    "ActiveEnterTimestampMonotonic,InactiveExitTimestampMonotonic,NeedDaemonReload,FragmentPath"
)

PROBE = (
    PRELUDE
    + f"""if [ ! -d /run/systemd/system ]; then echo '@@ no-systemd'; cat /proc/1/comm; exit 0; fi
echo '@@ show'; systemctl show --no-pager -p {PROPERTIES} {" ".join(UNITS)}
echo '@@ failed'; systemctl list-units --failed --plain --no-legend --no-pager
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

    @property
    def installed(self) -> bool:
        """Whether systemd found a unit file."""
        return self.load not in ("not-found", "")

    @property
    def running(self) -> bool:
        """Whether it is active or starting."""
        return self.active in ("active", "activating", "reloading")

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
    units = tuple(_unit(block) for block in blocks if block.get("Id"))
    if not units:
        raise ValueError(
            f"expected blocks of systemctl show, found {output.stdout[:80]!r}; stderr {output.stderr.strip()[:120]!r}"
        )
    # Older versions of systemd mark failed units with a dot even in plain mode.
    failed = tuple(line.lstrip("●* ").split()[0] for line in sections.lines("failed") if line.strip("●* "))
    return Units(True, units, failed)


def _unit(block: dict[str, str]) -> Unit:
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
    )


UNIT_STATES = Fact("units", PROBE, parse)
