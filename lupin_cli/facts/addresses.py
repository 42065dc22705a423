"""The IPv4 addresses of a machine, with the interface of each and whether it has a carrier."""

from __future__ import annotations

import re
from dataclasses import dataclass
from ipaddress import ip_address, ip_interface
from typing import Any

from lupin_cli.connection.base import Output
from lupin_cli.facts.base import Fact
from lupin_cli.facts.sections import PRELUDE
from lupin_runtime.json_text import parse_json

PROBE = PRELUDE + "ip -j address show\n"

# Names that programs give to interfaces: Docker, Podman, libvirt, LXC, VirtualBox and VMware to the bridges of their guests,
# VPNs and modems to their tunnels.
_GUEST_BRIDGE = re.compile(r"(br-[0-9a-f]{12}|docker|podman|cni|virbr|lxcbr|lxdbr|vboxnet|vmnet)\d*")
_TUNNEL = re.compile(r"(tun|tap|wg|tailscale|zt|ppp|ipsec|vti|gre|sit)\w*")
_VIRTUAL = ("br-", "docker", "veth", "virbr", "tap", "tun")


def is_guest_bridge(interface: str) -> bool:
    """Return whether containers or virtual machines of this machine are all that an interface leads to, by its name."""
    return bool(_GUEST_BRIDGE.fullmatch(interface))


def is_tunnel(interface: str) -> bool:
    """Return whether an interface is the end of a tunnel, which has no cable and an MTU of its own, by its name."""
    return bool(_TUNNEL.fullmatch(interface))


@dataclass(frozen=True)
class Address:
    """An IPv4 address of an interface. DDS announces it if the interface is up and has a carrier."""

    interface: str
    address: str
    prefix_length: int
    scope: str  # global, host, link
    up: bool
    carrier: bool

    def line(self) -> str:
        """Return the address as `ip -brief address` prints it."""
        state = "UP" if self.up and self.carrier else "NO-CARRIER" if self.up else "DOWN"
        return f"{self.interface} {state} {self.address}/{self.prefix_length}"

    def on_same_subnet(self, address: str) -> bool:
        """Return whether `address` is in the subnet of this one. Raises ValueError if it is not an IP address."""
        return ip_address(address) in ip_interface(f"{self.address}/{self.prefix_length}").network


@dataclass(frozen=True)
class Addresses:
    """All IPv4 addresses of a machine, in the kernel's order."""

    entries: tuple[Address, ...]
    unused: tuple[str, ...] = ()  # interfaces of networks that have a carrier and no address, and that no other one uses

    @property
    def announced(self) -> tuple[Address, ...]:
        """The addresses that a DDS participant started now would announce to other machines."""
        return tuple(each for each in self.entries if each.scope == "global" and each.up and each.carrier)

    def has(self, address: str) -> bool:
        """Return whether `address` is one of the machine's."""
        return any(each.address == address for each in self.entries)


def parse(output: Output) -> Addresses:
    """Parse the output of PROBE. Raises ValueError."""
    found, unused = [], []
    links = _link_objects(output)
    parents = {str(link["link"]) for link in links if "link" in link}  # of VLANs
    for link in links:
        flags, name = link.get("flags", []), str(link.get("ifname", "?"))
        if not any(info.get("family") == "inet" for info in link.get("addr_info", [])):
            is_network = link.get("link_type", "ether") == "ether" and not name.startswith(_VIRTUAL)
            is_network = is_network and "master" not in link and name not in parents and not is_guest_bridge(name)
            unused += [name] if is_network and "LOWER_UP" in flags and "LOOPBACK" not in flags else []
        for info in link.get("addr_info", []):
            if info.get("family") == "inet" and "local" in info:
                found.append(
                    Address(
                        interface=name,
                        address=str(info["local"]),
                        prefix_length=int(info.get("prefixlen", 32)),
                        scope=str(info.get("scope", "global")),
                        up="UP" in flags,
                        carrier="LOWER_UP" in flags and "NO-CARRIER" not in flags,
                    )
                )
    return Addresses(tuple(found), tuple(unused))


def _link_objects(output: Output) -> list[dict[str, Any]]:
    try:
        found = parse_json(output.stdout)
    except ValueError:
        found = None
    if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
        raise ValueError(f"expected JSON of ip(8), found {output.stdout[:80]!r}; stderr: {output.stderr.strip()[:120]!r}")
    return [each for each in found if each]  # some versions print empty objects for links that were filtered out


ADDRESSES = Fact("addresses", PROBE, parse, runs_in_shared_shell=True)
