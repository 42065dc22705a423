"""What NetworkManager does with the radios: which profile is up on which device, and which it would rather have."""

from __future__ import annotations

import re

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, answers
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

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
    """An interface as NetworkManager sees it."""

    name: str
    type: str  # wifi, ethernet, ...
    state: str  # connected, disconnected, unavailable, unmanaged, connecting (...)
    connection: str
    raw: str


@dataclass(frozen=True)
class Profile:
    """A saved connection."""

    name: str
    wireless: bool
    autoconnect: bool
    priority: int
    active: bool
    raw: str


@dataclass(frozen=True)
class NetworkManager:
    """Devices and profiles; `running` is False where there is no NetworkManager at work."""

    running: bool
    devices: tuple[Device, ...] = ()
    profiles: tuple[Profile, ...] = ()


def parse(output: Output) -> NetworkManager:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    if said.maybe("absent"):
        return NetworkManager(running=False)
    devices = []
    for line in said.lines("devices"):
        name, kind, state, connection = _fields(line, 4)
        devices.append(Device(name, kind, state, connection, line))
    profiles = []
    for line in said.lines("profiles"):
        name, kind, autoconnect, priority, active = _fields(line, 5)
        if not re.fullmatch(r"-?\d+", priority):
            raise ValueError(f"expected a whole number for the priority, found {line[:80]!r}")
        profiles.append(Profile(name, "wireless" in kind, autoconnect == "yes", int(priority), active == "yes", line))
    return NetworkManager(True, tuple(devices), tuple(profiles))


def _fields(line: str, count: int) -> list[str]:
    """Fields of terse output: separated by colons, and a colon or backslash inside is escaped by a backslash."""
    fields = [re.sub(r"\\(.)", r"\1", field) for field in re.findall(r"(?:^|:)((?:[^:\\]|\\.)*)", line)]
    if len(fields) != count:
        raise ValueError(f"expected {count} fields of nmcli(1), found {line[:80]!r}")
    return fields


NETWORK_MANAGER = Fact("network-manager", PROBE, parse)
