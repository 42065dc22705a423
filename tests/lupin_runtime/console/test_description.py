"""The URLs of a console for browsers on other devices."""

from __future__ import annotations

import ipaddress

import pytest

from lupin_runtime.console import description
from lupin_runtime.console.description import network_urls, serves_only_this_computer
from lupin_runtime.console.host_addresses import HostAddresses

MACHINE = HostAddresses(("pc.local", "pc"), (ipaddress.ip_address("192.168.1.20"), ipaddress.ip_address("fd00::7")))


@pytest.mark.parametrize(
    ("host", "urls"),
    [
        ("", ("https://192.168.1.20:8090", "https://[fd00::7]:8090", "https://pc.local:8090")),
        ("::", ("https://192.168.1.20:8090", "https://[fd00::7]:8090", "https://pc.local:8090")),
        ("0.0.0.0", ("https://192.168.1.20:8090", "https://pc.local:8090")),
        ("10.0.0.3", ("https://10.0.0.3:8090",)),
        ("fd00::7", ("https://[fd00::7]:8090",)),
        ("pc.local", ("https://pc.local:8090",)),
        ("pc.lab.example.nl", ("https://pc.lab.example.nl:8090",)),
        ("127.0.0.1", ()),
        ("127.0.1.1", ()),
        ("::1", ()),
        ("localhost", ()),
    ],
)
def test_urls_are_those_on_which_the_console_listens(host: str, urls: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(description, "host_addresses", lambda: MACHINE)
    assert network_urls(host, 8090, tls=True) == urls
    assert serves_only_this_computer(host) == (not urls)


def test_console_without_https_has_http_urls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(description, "host_addresses", lambda: MACHINE)
    assert network_urls("0.0.0.0", 80, tls=False)[0] == "http://192.168.1.20"


def test_machine_without_a_network_has_no_urls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(description, "host_addresses", lambda: HostAddresses(("pc.local",), ()))
    assert network_urls("", 8090, tls=True) == () and not serves_only_this_computer("")
