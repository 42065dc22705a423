"""The route from one machine to the other: interface, source address, gateway, and the radio if there is one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Any

from lupin_cli.connection.base import Output
from lupin_cli.facts.sections import PRELUDE, parse_sections
from lupin_runtime.json_text import parse_json

_NO_ROUTE = 3  # exit status of the probe


def route_probe(address: str) -> str:
    """Return the probe of the route to `address`. Raises ValueError unless `address` is an IP address."""
    ip_address(address)
    return (
        PRELUDE
        + f"""route=$(ip -4 -j route get {address}) || exit {_NO_ROUTE}
echo '@@ route'; echo "$route"
dev=$(ip -4 -o route get {address} | sed -n 's/.* dev \\([^ ]*\\).*/\\1/p')
echo '@@ link'; ip -j -s link show dev "$dev"
if [ -d "/sys/class/net/$dev/wireless" ] || [ -d "/sys/class/net/$dev/phy80211" ]; then
  echo '@@ radio'
  command -v iw >/dev/null && {{ iw dev "$dev" link; iw dev "$dev" get power_save; }}
fi
echo '@@ end'
"""
    )


@dataclass(frozen=True)
class Radio:
    """A wireless interface as `iw` reports it; None for each value that it does not report."""

    ssid: str | None = None
    frequency_mhz: float | None = None
    signal_dbm: float | None = None
    rate_mbps: float | None = None
    power_save: bool | None = None


@dataclass(frozen=True)
class Route:
    """The route from one machine to the other."""

    interface: str
    source: str  # address that packets leave with
    gateway: str  # empty if both machines are on the same network
    mtu: int
    multicast: bool
    up: bool
    errors: int  # frames lost or corrupt since the interface came up, in both directions
    radio: Radio | None  # None: a cable


def parse_route(output: Output) -> Route:
    """Pure parser of `route_probe`. Raises ValueError."""
    if output.status == _NO_ROUTE:
        raise ValueError(f"no route: {output.stderr.strip()}")
    sections = parse_sections(output)
    if sections.get("end") is None:
        raise ValueError("the probe ended before its last line")
    route, link = _first_object(sections.lines("route")), _first_object(sections.lines("link"))
    counters = link.get("stats64", {})
    errors = sum(
        int(counters.get(side, {}).get(kind, 0)) for side in ("rx", "tx") for kind in ("errors", "dropped", "carrier_errors")
    )
    flags = link.get("flags", [])
    radio = sections.get("radio")
    return Route(
        interface=str(route.get("dev", "")),
        source=str(route.get("prefsrc", "")),
        gateway=str(route.get("gateway", "")),
        mtu=int(link.get("mtu", 0)),
        multicast="MULTICAST" in flags,
        up="LOWER_UP" in flags,
        errors=errors,
        radio=None if radio is None else parse_radio("\n".join(radio.lines)),
    )


def _first_object(lines: Sequence[str]) -> dict[str, Any]:
    found = parse_json("\n".join(lines))
    if not (isinstance(found, list) and found and isinstance(found[0], dict)):
        raise ValueError(f"expected the output of `ip -j`, found {str(found)[:80]!r}")
    return found[0]


def parse_radio(text: str) -> Radio:
    """Parse the output of `iw dev IF link` and `iw dev IF get power_save`."""

    def number(pattern: str) -> float | None:
        found = re.search(pattern, text)
        return float(found[1]) if found else None

    ssid = re.search(r"^\s*SSID: (.*)$", text, re.MULTILINE)
    power_save = re.search(r"^Power save: (on|off)", text, re.MULTILINE)
    return Radio(
        ssid[1].strip() if ssid else None,
        number(r"freq: ([\d.]+)"),
        number(r"signal: (-?[\d.]+)"),
        number(r"tx bitrate: ([\d.]+)"),
        power_save[1] == "on" if power_save else None,
    )
