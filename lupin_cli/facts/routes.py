"""The routes of a machine, its wireless interfaces, and the route to each address of the robot."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from typing import Any

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, parse_sections
from lupin_runtime.json_text import parse_json

# The doctor sets this variable to all addresses of the robot that it examines; the probe resolves host names.
ROBOT_ADDRESSES = "LUPIN_ROBOT_ADDRESSES"
PROBE = (
    PRELUDE
    + f"""echo '@@ routes'; ip -j -4 route show table main; echo
echo '@@ all-routes'; ip -j -4 route show table all; echo
echo '@@ rules'; ip -4 rule show
echo '@@ wireless'; for each in /sys/class/net/*/wireless /sys/class/net/*/phy80211; do
  [ -e "$each" ] && basename "$(dirname "$each")"; done
for name in ${ROBOT_ADDRESSES}; do
  case $name in *[!0-9.]*) address=$(getent ahostsv4 "$name" | awk 'NR == 1 {{ print $1 }}') ;; *) address=$name ;; esac
  [ -z "$address" ] || {{ echo "@@ robot $name $address"; ip -4 route get "$address" 2>&1; }}
done
exit 0
"""
)
# A rule of ip(8) by which packets of any program look for their route in a table. VPNs mark only their own packets.
_LOOKUP = re.compile(r"\d+:\s+(?:from all|not from all fwmark \S+)(?: to \S+)? lookup (\S+)")


@dataclass(frozen=True)
class RouteEntry:
    """One line of a routing table."""

    destination: str  # a network, an address, or "default"
    device: str
    gateway: str = ""
    source: str = ""  # source address of the packets
    dead: bool = False  # no carrier

    def line(self) -> str:
        """Return the entry as `ip route` prints it."""
        via = f" via {self.gateway}" if self.gateway else ""
        source = f" src {self.source}" if self.source else ""
        return f"{self.destination}{via} dev {self.device}{source}{' linkdown' if self.dead else ''}"

    def covers(self, address: str) -> int | None:
        """Return the prefix length with which it matches `address`; None if it does not match."""
        if self.destination == "default":
            return 0
        network = _network(self.destination)
        try:
            return network.prefixlen if network and ip_address(address) in network else None
        except ValueError:
            return None


@functools.cache  # with a fleet, every address is matched against the same few entries
def _network(text: str) -> IPv4Network | IPv6Network | None:
    try:
        return ip_network(text, strict=False)
    except ValueError:
        return None


@dataclass(frozen=True)
class RoutingTable:
    """The main routing table, the wireless interfaces, and the output of `ip route get` for the robot's addresses.

    `others` are the routes of further tables that all programs use: a VPN has its own.
    """

    main: tuple[RouteEntry, ...]
    wireless: frozenset[str] = frozenset()
    to_robot: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # by address
    names: Mapping[str, str] = field(default_factory=dict)  # addresses that the robot's host names resolve to, by name
    others: tuple[RouteEntry, ...] = ()

    def best(self, address: str) -> RouteEntry | None:
        """Return the entry with carrier that matches `address` with the longest prefix, or None."""
        matching = ((route.covers(address), route) for route in (*self.main, *self.others) if not route.dead)
        found = [(length, route) for length, route in matching if length is not None]
        return max(found, key=lambda pair: pair[0])[1] if found else None

    def leads_to(self, address: str) -> bool:
        """Return whether a specific route leads to `address`. The default route does not count: it leads to the Internet."""
        route = self.best(address)
        return route is not None and route.destination != "default"

    def refuses(self, address: str) -> bool:
        """Return whether the kernel has said that no route leads to `address`, not even the default route."""
        lines = self.to_robot.get(address, ())
        return bool(lines) and not any(" dev " in line for line in lines)


def parse(output: Output) -> RoutingTable:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    main = tuple(_entry(row) for row in _rows(sections.lines("routes"), output))
    others: tuple[RouteEntry, ...] = ()
    if sections.get("all-routes") is not None and sections.get("rules") is not None:
        used = {found[1] for line in sections.lines("rules") if (found := _LOOKUP.match(line))} - {"local", "main", "default"}
        others = tuple(
            _entry(row)
            for row in _rows(sections.lines("all-routes"), output)
            if str(row.get("table", "main")) in used and row.get("type", "unicast") == "unicast"
        )
    lookups = {section.argument: section.lines for section in sections.all("robot") if " " in section.argument}
    return RoutingTable(
        main=main,
        wireless=frozenset(sections.lines("wireless")),
        to_robot={
            name.split()[1]: tuple(line.strip() for line in lines if line.strip() not in ("", "cache"))
            for name, lines in lookups.items()
        },
        names=dict(name.split() for name in lookups),
        others=others,
    )


def _rows(lines: Sequence[str], output: Output) -> list[dict[str, Any]]:
    """Return the routes in the JSON of ip(8), which prints an empty list if there are none. Raises ValueError."""
    text = "\n".join(lines)
    try:
        rows = parse_json(text)
    except ValueError:
        rows = None
    if not isinstance(rows, list):
        raise ValueError(f"expected JSON of ip(8), found {text[:80]!r}; stderr: {output.stderr.strip()[:120]!r}")
    return [row for row in rows if isinstance(row, dict) and "dst" in row and "dev" in row]


def _entry(row: Mapping[str, Any]) -> RouteEntry:
    return RouteEntry(
        str(row["dst"]),
        str(row["dev"]),
        str(row.get("gateway", "")),
        str(row.get("prefsrc", "")),
        bool({"dead", "linkdown"} & set(row.get("flags", []))),
    )


ROUTES = Fact("routes", PROBE, parse)
