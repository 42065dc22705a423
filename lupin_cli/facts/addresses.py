"""Which addresses a machine has, on which interfaces, and whether anything is plugged in there."""

from __future__ import annotations

import json
from ipaddress import ip_address, ip_interface

from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE
from lupin_cli.quick_dataclass import dataclass
from lupin_cli.target.base import Output

PROBE = PRELUDE + "ip -j -4 address show\n"


@dataclass(frozen=True)
class Address:
    """An IPv4 address of an interface. DDS announces it where the interface is up and carries."""

    interface: str
    address: str
    prefix_length: int
    scope: str  # global, host, link
    up: bool
    carrier: bool

    def line(self) -> str:
        """As `ip -brief` would say it."""
        state = "UP" if self.up and self.carrier else "NO-CARRIER" if self.up else "DOWN"
        return f"{self.interface} {state} {self.address}/{self.prefix_length}"

    def has_neighbour(self, address: str) -> bool:
        """Whether `address` lies in this interface's network. Raises ValueError where it is no address."""
        return ip_address(address) in ip_interface(f"{self.address}/{self.prefix_length}").network


@dataclass(frozen=True)
class Addresses:
    """All IPv4 addresses of a machine, in the kernel's order."""

    every: tuple[Address, ...]

    @property
    def announced(self) -> tuple[Address, ...]:
        """Those that a DDS participant started now would announce to other machines."""
        return tuple(each for each in self.every if each.scope == "global" and each.up and each.carrier)

    def has(self, address: str) -> bool:
        """Whether `address` is one of them."""
        return any(each.address == address for each in self.every)


def parse(output: Output) -> Addresses:
    """Pure parser of PROBE. Raises ValueError."""
    found = []
    for link in _documents(output):
        flags = link.get("flags", [])
        for info in link.get("addr_info", []):
            if info.get("family") == "inet" and "local" in info:
                found.append(
                    Address(
                        interface=str(link.get("ifname", "?")),
                        address=str(info["local"]),
                        prefix_length=int(info.get("prefixlen", 32)),
                        scope=str(info.get("scope", "global")),
                        up="UP" in flags,
                        carrier="LOWER_UP" in flags and "NO-CARRIER" not in flags,
                    )
                )
    return Addresses(tuple(found))


def _documents(output: Output) -> list[dict]:
    try:
        found = json.loads(output.stdout)
    except ValueError:
        found = None
    if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
        raise ValueError(f"expected JSON of ip(8), found {output.stdout[:80]!r}; it said {output.stderr.strip()[:120]!r}")
    return [each for each in found if each]  # some versions leave empty objects in place of filtered links


ADDRESSES = Fact("addresses", PROBE, parse, at_once=True)
