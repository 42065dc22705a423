"""The routing table of a machine, its wireless interfaces, and the route to each address of the robot."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, parse_sections

# The doctor sets this variable to all addresses of the robot that it examines; the probe resolves host names.
ROBOT_ADDRESSES = "LUPIN_ROBOT_ADDRESSES"
PROBE = (
    PRELUDE
    + f"""echo '@@ routes'; ip -j -4 route show table main; echo
echo '@@ wireless'; for each in /sys/class/net/*/wireless /sys/class/net/*/phy80211; do
  [ -e "$each" ] && basename "$(dirname "$each")"; done
for name in ${ROBOT_ADDRESSES}; do
  case $name in *[!0-9.]*) address=$(getent ahostsv4 "$name" | awk 'NR == 1 {{ print $1 }}') ;; *) address=$name ;; esac
  [ -z "$address" ] || {{ echo "@@ robot $name $address"; ip -4 route get "$address" 2>&1; }}
done
exit 0
"""
)


@dataclass(frozen=True)
class RouteEntry:
    """One line of the main routing table."""

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
    """The main routing table, the wireless interfaces, and the output of `ip route get` for the robot's addresses."""

    main: tuple[RouteEntry, ...]
    wireless: frozenset[str] = frozenset()
    to_robot: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # by address
    names: Mapping[str, str] = field(default_factory=dict)  # addresses that the robot's host names resolve to, by name

    def best(self, address: str) -> RouteEntry | None:
        """Return the entry with carrier that matches `address` with the longest prefix, or None."""
        found = [(length, route) for route in self.main if (length := route.covers(address)) is not None and not route.dead]
        return max(found, key=lambda pair: pair[0])[1] if found else None

    def leads_to(self, address: str) -> bool:
        """Return whether a specific route leads to `address`. The default route does not count: it leads to the Internet."""
        route = self.best(address)
        return route is not None and route.destination != "default"


def parse(output: Output) -> RoutingTable:
    """Parse the output of PROBE. Raises ValueError."""
    sections = parse_sections(output)
    text = "\n".join(sections.lines("routes"))
    try:
        rows = json.loads(text or "[]")
    except ValueError:
        raise ValueError(f"expected JSON of ip(8), found {text[:80]!r}; stderr: {output.stderr.strip()[:120]!r}") from None
    main = tuple(
        RouteEntry(
            str(row["dst"]),
            str(row["dev"]),
            str(row.get("gateway", "")),
            str(row.get("prefsrc", "")),
            bool({"dead", "linkdown"} & set(row.get("flags", []))),
        )
        for row in rows
        if isinstance(row, dict) and "dst" in row and "dev" in row
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
    )


ROUTES = Fact("routes", PROBE, parse)
