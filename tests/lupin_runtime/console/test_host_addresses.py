"""Finds the names and addresses that other devices can use."""

from __future__ import annotations

import ipaddress
import socket
from typing import NamedTuple

import psutil
import pytest

from lupin_runtime.console.host_addresses import host_addresses, is_dns_name, lan_addresses, names_of


class Entry(NamedTuple):
    """An interface's address, as psutil returns it."""

    family: int
    address: str


def interface(*addresses: str) -> list[Entry]:
    return [Entry(socket.AF_INET6 if ":" in address else socket.AF_INET, address) for address in addresses]


def test_lan_addresses_are_found_default_route_first() -> None:
    interfaces = {
        "lo": interface("127.0.0.1", "::1"),
        "eth0": [*interface("10.42.0.2", "fe80::1%eth0"), Entry(psutil.AF_LINK, "02:fc:00:00:00:01")],
        "wlan0": interface("fd00::7", "192.168.1.20", "2001:db8::7"),
        "docker0": interface("172.17.0.1"),
        "br-0a1b2c": interface("172.18.0.1"),
        "br0": interface("192.168.1.20"),
    }
    found = lan_addresses(interfaces, "192.168.1.20")
    assert tuple(map(str, found)) == ("192.168.1.20", "10.42.0.2", "fd00::7")
    assert tuple(map(str, lan_addresses(interfaces))) == ("10.42.0.2", "192.168.1.20", "fd00::7")


def test_tunnels_and_link_local_addresses_come_last() -> None:
    interfaces = {
        "wg0": interface("10.8.0.2"),
        "tailscale0": interface("100.101.1.2"),
        "eth0": interface("169.254.3.4"),
        "wlan0": interface("192.168.1.20"),
    }
    found = [str(each) for each in lan_addresses(interfaces, "10.8.0.2")]
    assert found == ["192.168.1.20", "10.8.0.2", "100.101.1.2", "169.254.3.4"], "the tunnel is the default route"


def test_machine_without_network_has_no_addresses() -> None:
    assert lan_addresses({"lo": interface("127.0.0.1", "::1")}) == ()


@pytest.mark.parametrize(
    ("host", "names"),
    [
        ("Mirte-247264", ("mirte-247264.local", "mirte-247264")),
        ("pc.lab.example.nl", ("pc.local", "pc.lab.example.nl")),
        ("pc.local", ("pc.local",)),
        ("pc.", ("pc.local", "pc")),
        ("localhost", ()),
        ("my_laptop", ()),
        ("192.168.1.20", ()),
        ("", ()),
        ("kas-ü", ()),
        ("a" * 64, ()),
        ("a..b", ()),
        ("x" + ".y" * 130, ()),
    ],
)
def test_host_names_are_valid_in_certificates(host: str, names: tuple[str, ...]) -> None:
    assert names_of(host) == names


def test_name_with_line_break_is_refused() -> None:
    assert not is_dns_name("pc\n")


def test_host_addresses_of_this_machine_are_valid() -> None:
    here = host_addresses()
    own = {entry.address for entries in psutil.net_if_addrs().values() for entry in entries}
    assert {str(address) for address in here.addresses} <= own
    assert not any(ipaddress.ip_address(str(address)).is_loopback for address in here.addresses)
    assert all(is_dns_name(name) for name in here.names)
