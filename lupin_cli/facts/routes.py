"""Where this machine's packets go: its routes, and the one that leads to the robot."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import field
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE, answers
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

# The doctor sets the variable where a robot was asked for, to all of its addresses; names are looked up here.
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
class Route:
    """One line of the main table."""

    destination: str  # a network, an address, or "default"
    device: str
    gateway: str = ""
    source: str = ""  # the address that packets leave with
    dead: bool = False  # no carrier

    def line(self) -> str:
        """As `ip route` would say it."""
        via = f" via {self.gateway}" if self.gateway else ""
        source = f" src {self.source}" if self.source else ""
        return f"{self.destination}{via} dev {self.device}{source}{' linkdown' if self.dead else ''}"

    def covers(self, address: str) -> int | None:
        """The prefix length with which it covers `address`; None where it doesn't."""
        if self.destination == "default":
            return 0
        network = _network(self.destination)
        try:
            return network.prefixlen if network and ip_address(address) in network else None
        except ValueError:
            return None


@functools.cache  # a fleet asks of every address which of the same few routes lead there
def _network(text: str) -> IPv4Network | IPv6Network | None:
    try:
        return ip_network(text, strict=False)
    except ValueError:
        return None


@dataclass(frozen=True)
class Routes:
    """The main table, which interfaces are radios, and what `ip route get` said of the robot."""

    main: tuple[Route, ...]
    wireless: frozenset[str] = frozenset()
    to_robot: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # by address
    names: Mapping[str, str] = field(default_factory=dict)  # the addresses that names of the robot stand for

    def best(self, address: str) -> Route | None:
        """The live route of the longest prefix to `address`."""
        found = [(length, route) for route in self.main if (length := route.covers(address)) is not None and not route.dead]
        return max(found, key=lambda pair: pair[0])[1] if found else None

    def leads_to(self, address: str) -> bool:
        """Whether a route of its own leads to `address`: the default route of a laptop ends in the internet."""
        route = self.best(address)
        return route is not None and route.destination != "default"


def parse(output: Output) -> Routes:
    """Pure parser of PROBE. Raises ValueError."""
    said = answers(output)
    text = "\n".join(said.lines("routes"))
    try:
        rows = json.loads(text or "[]")
    except ValueError:
        raise ValueError(f"expected JSON of ip(8), found {text[:80]!r}; it said {output.stderr.strip()[:120]!r}") from None
    main = tuple(
        Route(
            str(row["dst"]),
            str(row["dev"]),
            str(row.get("gateway", "")),
            str(row.get("prefsrc", "")),
            bool({"dead", "linkdown"} & set(row.get("flags", []))),
        )
        for row in rows
        if isinstance(row, dict) and "dst" in row and "dev" in row
    )
    asked = {section.argument: section.lines for section in said.every("robot") if " " in section.argument}
    return Routes(
        main=main,
        wireless=frozenset(said.lines("wireless")),
        to_robot={
            name.split()[1]: tuple(line.strip() for line in lines if line.strip() not in ("", "cache"))
            for name, lines in asked.items()
        },
        names=dict(name.split() for name in asked),
    )


ROUTES = Fact("routes", PROBE, parse)
