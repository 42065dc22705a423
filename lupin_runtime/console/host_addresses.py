"""Under which names and addresses other devices can reach this machine."""

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

# Interfaces that lead to containers and virtual machines of this host only.
_INTERNAL_INTERFACES = ("docker", "br-", "veth", "virbr", "vmnet", "vboxnet", "lxc", "lxdbr", "cni", "flannel", "podman")
_UNIQUE_LOCAL = ipaddress.IPv6Network("fc00::/7")  # RFC 4193
_ROUTED = ("192.0.2.1", 9)  # RFC 5737: stands for any address beyond the network; nothing is sent there
_LABEL = re.compile(r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?")  # RFC 1123, 2.1


class InterfaceAddress(Protocol):
    """An address of an interface, as psutil describes it."""

    @property
    def family(self) -> int:
        """Of the socket module."""

    @property
    def address(self) -> str:
        """In text; a link-local IPv6 address with its interface."""


@dataclass(frozen=True)
class HostAddresses:
    """Names without their final dot, in lower case; addresses of the network, that of the default route first."""

    names: tuple[str, ...]
    addresses: tuple[Address, ...]


def host_addresses() -> HostAddresses:
    """This machine's names and addresses besides localhost, at this moment. Asks no name server."""
    return HostAddresses(names_of(socket.gethostname()), lan_addresses(psutil.net_if_addrs(), _default_source()))


def names_of(host: str) -> tuple[str, ...]:
    """The names that devices may use for a host of this name: its own, and that of multicast DNS (RFC 6762).

    Empty where it is no valid DNS name.
    """
    full = host.lower().rstrip(".")
    if not is_dns_name(full) or full == "localhost" or full.rpartition(".")[2].isdigit():
        return ()
    return tuple(dict.fromkeys((f"{full.split('.')[0]}.local", full)))


def is_dns_name(text: str) -> bool:
    """Whether `text` is a name of letters, digits and hyphens (RFC 1123, 2.1), in lower case."""
    return 0 < len(text) <= 253 and all(_LABEL.fullmatch(label) for label in text.split("."))


def lan_addresses(interfaces: Mapping[str, Sequence[InterfaceAddress]], first: str | None = None) -> tuple[Address, ...]:
    """The addresses among those of psutil's `net_if_addrs` that other devices of the network can use, `first` first.

    Link-local IPv6 addresses are left out: a URL cannot name the interface that they need. So are public IPv6 addresses, most
    of which are replaced every day (RFC 8981).
    """
    found: list[Address] = []
    for name, entries in interfaces.items():
        if not name.startswith(_INTERNAL_INTERFACES):
            found += [address for entry in entries if (address := _usable(entry)) is not None and address not in found]
    return tuple(sorted(found, key=lambda address: (str(address) != first, address.version)))


def _usable(entry: InterfaceAddress) -> Address | None:
    if entry.family not in (socket.AF_INET, socket.AF_INET6):
        return None
    try:
        address = ipaddress.ip_address(entry.address)
    except ValueError:  # an IPv6 address with its interface
        return None
    if address.is_loopback or address.is_unspecified or address.is_multicast:
        return None
    return address if address.version == 4 or address in _UNIQUE_LOCAL else None


def _default_source() -> str | None:
    """The address from which packets leave this network; None where there is no default route."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(_ROUTED)
        except OSError:
            return None
        return str(probe.getsockname()[0])
