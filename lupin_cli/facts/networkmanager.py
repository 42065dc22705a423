"""NetworkManager: its devices, its saved profiles, their autoconnect priorities, and which profile is active."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, parse_sections

PROBE = (
    PRELUDE
    + """command -v nmcli >/dev/null || { echo '@@ absent'; exit 0; }
[ "$(nmcli -t -f RUNNING general 2>/dev/null)" = running ] || { echo '@@ absent'; exit 0; }
echo '@@ devices'; nmcli -t -f DEVICE,TYPE,STATE,CONNECTION device status
echo '@@ profiles'; nmcli -t -f NAME,TYPE,AUTOCONNECT,AUTOCONNECT-PRIORITY,ACTIVE connection show
"""
)


@dataclass(frozen=True)
class Device:
    """An interface that NetworkManager knows."""

    name: str
    type: str  # wifi, ethernet, ...
    state: str  # connected, disconnected, unavailable, unmanaged, connecting (...)
    connection: str
    raw: str


@dataclass(frozen=True)
class Profile:
    """A saved connection profile."""

    name: str
    wireless: bool
    autoconnect: bool
    priority: int
    active: bool
    raw: str


@dataclass(frozen=True)
class NetworkManager:
    """Devices and profiles; `running` is False if NetworkManager is not running."""

    running: bool
    devices: tuple[Device, ...] = ()
    profiles: tuple[Profile, ...] = ()


def parse(output: Output) -> NetworkManager:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    if sections.get("absent"):
        return NetworkManager(running=False)
    devices = []
    for line in sections.lines("devices"):
        name, kind, state, connection = _fields(line, 4)
        devices.append(Device(name, kind, state, connection, line))
    profiles = []
    for line in sections.lines("profiles"):
        name, kind, autoconnect, priority, active = _fields(line, 5)
        if not re.fullmatch(r"-?\d+", priority):
            raise ValueError(f"expected a whole number for the priority, found {line[:80]!r}")
        profiles.append(Profile(name, "wireless" in kind, autoconnect == "yes", int(priority), active == "yes", line))
    return NetworkManager(True, tuple(devices), tuple(profiles))


def _fields(line: str, count: int) -> list[str]:
    """Split a line of terse output at colons; a colon or backslash in a field is escaped by a backslash."""
    fields = [re.sub(r"\\(.)", r"\1", field) for field in re.findall(r"(?:^|:)((?:[^:\\]|\\.)*)", line)]
    if len(fields) != count:
        raise ValueError(f"expected {count} fields of nmcli(1), found {line[:80]!r}")
    return fields


NETWORK_MANAGER = Fact("network-manager", PROBE, parse)
