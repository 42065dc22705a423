"""The names and addresses by which other devices can reach this machine."""

from __future__ import annotations

import ipaddress
import re
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import psutil

Address = ipaddress.IPv4Address | ipaddress.IPv6Address

LOOPBACK: tuple[Address, ...] = (ipaddress.IPv4Address("127.0.0.1"), ipaddress.IPv6Address("::1"))

# Prefixes of interfaces that only connect this host with its own containers and virtual machines.
_INTERNAL_INTERFACES = ("docker", "br-", "veth", "virbr", "vmnet", "vboxnet", "lxc", "lxdbr", "cni", "flannel", "podman")
# Prefixes of tunnels: devices on the same WiFi can't use their addresses, even if the default route goes through one.
_TUNNELS = ("tun", "tap", "wg", "tailscale", "zt", "ppp", "ipsec", "nordlynx")
_UNIQUE_LOCAL = ipaddress.IPv6Network("fc00::/7")  # RFC 4193
_REMOTE_ADDRESS = ("192.0.2.1", 9)  # reserved for documentation (RFC 5737), so outside the local network; nothing is sent
_LABEL = re.compile(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?")  # RFC 1123, 2.1


class InterfaceAddress(Protocol):
    """An address of an interface, as psutil describes it."""

    @property
    def family(self) -> int:
        """The address family, a constant of the socket module."""

    @property
    def address(self) -> str:
        """The address as text; that of a link-local IPv6 address ends with `%` and the interface."""


@dataclass(frozen=True)
class HostAddresses:
    """Names in lower case without a final dot, and addresses, that of the local network first."""

    names: tuple[str, ...]
    addresses: tuple[Address, ...]


def host_addresses() -> HostAddresses:
    """Return this machine's current names and addresses, without localhost. Queries no name server."""
    states = psutil.net_if_stats()
    up = {name: entries for name, entries in psutil.net_if_addrs().items() if name in states and states[name].isup}
    return HostAddresses(names_of(socket.gethostname()), lan_addresses(up, _default_source()))


def names_of(host: str) -> tuple[str, ...]:
    """Return the names by which other devices may reach a host: its host name and its multicast DNS name (RFC 6762).

    Empty if `host` is not a valid DNS name.
    """
    full = host.lower().rstrip(".")
    if not is_dns_name(full) or full == "localhost" or full.rpartition(".")[2].isdigit():
        return ()
    return tuple(dict.fromkeys((f"{full.split('.')[0]}.local", full)))


def is_dns_name(text: str) -> bool:
    """Return whether `text` is a host name of lower-case letters, digits, hyphens and dots (RFC 1123, 2.1)."""
    return 0 < len(text) <= 253 and all(_LABEL.fullmatch(label) for label in text.split("."))


def lan_addresses(interfaces: Mapping[str, Sequence[InterfaceAddress]], preferred: str | None = None) -> tuple[Address, ...]:
    """Return those of psutil's `net_if_addrs` that other devices on the network can use, beginning with `preferred`.

    Those of tunnels and link-local ones come last: they reach only devices in the tunnel, or without a DHCP server.
    Link-local IPv6 addresses are left out, because a URL cannot name the interface that they need; public IPv6 addresses,
    because most of them are replaced every day (RFC 8981).
    """
    found: dict[Address, bool] = {}  # with whether it is a tunnel's
    for name, entries in interfaces.items():
        if not name.startswith(_INTERNAL_INTERFACES):
            for entry in entries:
                if (address := _usable(entry)) is not None:
                    found.setdefault(address, name.startswith(_TUNNELS))

    def rank(address: Address) -> tuple[bool, bool, int]:
        return found[address] or address.is_link_local, str(address) != preferred, address.version

    return tuple(sorted(found, key=rank))


def _usable(entry: InterfaceAddress) -> Address | None:
    if entry.family not in (socket.AF_INET, socket.AF_INET6):
        return None
    try:
        address = ipaddress.ip_address(entry.address)
    except ValueError:
        return None
    if address.is_loopback or address.is_unspecified or address.is_multicast:
        return None
    return address if address.version == 4 or address in _UNIQUE_LOCAL else None


def _default_source() -> str | None:
    """Return the IPv4 source address that the default route uses; None if there is no default route."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.connect(_REMOTE_ADDRESS)
        except OSError:
            return None
        return str(sock.getsockname()[0])
