"""Checks of the `Host` and `Origin` headers, and parsing of `Host` and `User-Agent`."""

from __future__ import annotations

import socket

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from lupin_runtime.console.request_rules import check_host, check_origin, device_kind, host_name


def request(method: str = "GET", **headers: str) -> web.Request:
    made: web.Request = make_mocked_request(
        method, "/", headers={key.replace("_", "-"): value for key, value in headers.items()}
    )
    return made


@pytest.mark.parametrize(
    "host",
    ["localhost:8090", "127.0.0.1", "[::1]:8090", "192.168.1.7:8090", "[fe80::1]:8090", socket.gethostname(), "a.localhost"],
)
def test_ip_addresses_and_own_names_are_accepted(host: str) -> None:
    check_host(request(Host=host))


@pytest.mark.parametrize(
    "host", ["evil.example", "localhost.evil.example:8090", "127.0.0.1.evil.example", "", "[", ":8090", "a:b:c"]
)
def test_unknown_or_malformed_hosts_are_refused(host: str) -> None:
    with pytest.raises(web.HTTPMisdirectedRequest):
        check_host(request(Host=host))


def test_page_of_this_origin_and_programs_are_accepted() -> None:
    check_origin(request("POST", Host="robot:8090", Origin="http://robot:8090", Sec_Fetch_Site="same-origin"))
    check_origin(request("POST", Host="robot:8090"))


def test_cross_site_navigation_is_accepted() -> None:
    check_origin(request("GET", Host="robot:8090", Sec_Fetch_Site="cross-site"))


@pytest.mark.parametrize(
    ("method", "headers"),
    [
        ("POST", {"Origin": "http://evil.example"}),
        ("POST", {"Origin": "null"}),
        ("POST", {"Origin": "https://robot:8090"}),
        ("POST", {"Origin": "http://robot:8091"}),
        ("POST", {"Sec_Fetch_Site": "cross-site"}),
        ("DELETE", {"Sec_Fetch_Site": "same-site"}),
        ("GET", {"Upgrade": "websocket", "Sec_Fetch_Site": "cross-site"}),
        ("GET", {"Upgrade": "websocket", "Origin": "http://evil.example"}),
    ],
)
def test_page_of_another_origin_is_refused(method: str, headers: dict[str, str]) -> None:
    with pytest.raises(web.HTTPForbidden):
        check_origin(request(method, Host="robot:8090", **headers))


@pytest.mark.parametrize(
    ("agent", "kind"),
    [
        ("Mozilla/5.0 (iPhone; CPU iPhone OS 18_0 like Mac OS X) Mobile/15E148 Safari/604.1", "phone"),
        ("Mozilla/5.0 (Linux; Android 15; Pixel 9) Chrome/140.0 Mobile Safari/537.36", "phone"),
        ("Mozilla/5.0 (Linux; Android 14; SM-X710) Chrome/140.0 Safari/537.36", "tablet"),
        ("Mozilla/5.0 (iPad; CPU OS 18_0 like Mac OS X) Mobile/15E148", "tablet"),
        ("Mozilla/5.0 (X11; Linux x86_64) Chrome/140.0", "computer"),
        ("", "computer"),
    ],
)
def test_device_kind_is_read_from_user_agent(agent: str, kind: str) -> None:
    assert device_kind(agent) == kind


@pytest.mark.parametrize(
    ("host", "name"),
    [
        ("robot", "robot"),
        ("Robot:8090", "robot"),
        ("[::1]:8090", "::1"),
        ("[::1]", "::1"),
        ("::1", "::1"),
        ("10.0.0.1:1", "10.0.0.1"),
    ],
)
def test_host_name_is_split_from_its_port(host: str, name: str) -> None:
    assert host_name(host) == name
