"""The banner has working URLs and a readable QR code, and fits the terminal."""

from __future__ import annotations

import io
import ipaddress
import os
import pty
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import segno
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.console.banner import QUIET_ZONE, ConsoleUrls, Screen, banner, console_urls, qr_lines, screen_of
from lupin_runtime.console.host_addresses import HostAddresses
from lupin_runtime.stack.dds import DiscoveryMode

HOME = HostAddresses(("lab-7.local", "lab-7"), tuple(map(ipaddress.ip_address, ("192.168.1.20", "10.42.0.2", "fd00::2"))))
URLS = console_urls(HOME, https_port=8443, http_port=8090)
SERVER = DiscoveryMode("discovery server 10.42.0.1:11811, domain 0")
MULTICAST = DiscoveryMode("multicast, domain 0: no discovery server", "The robot stays unseen. Type: lupin dds setup")
TERMINAL = Screen(columns=80, interactive=True, unicode=True, color=True)
PAIRING = "https://192.168.1.20:8443/#code=K7QM-2XWP"
MODULES = {" ": (0, 0), "▄": (0, 1), "▀": (1, 0), "█": (1, 1)}
STYLE = re.compile(r"\x1b\[[0-9;]*m")


def modules_of(text: str, *, inverted: bool) -> list[list[int]]:
    """Return the modules in a banner's half blocks, 1 for dark ones, without the lines of text."""
    lines = [plain for line in text.splitlines() if (plain := STYLE.sub("", line)) and set(plain) <= set(MODULES)]
    return [[MODULES[character][half] ^ inverted for character in line] for line in lines for half in (0, 1)]


def read_qr(text: str, *, inverted: bool = False) -> str:
    """Draw a banner's half blocks as a picture, and read the code in it."""
    dark = np.array(modules_of(text, inverted=inverted), np.uint8)
    picture = np.kron(255 * (1 - dark), np.ones((8, 8))).astype(np.uint8)
    return str(cv2.QRCodeDetector().detectAndDecode(picture)[0])


def test_urls_are_listed_preferred_scheme_first() -> None:
    assert URLS.network == (
        *("https://192.168.1.20:8443", "https://10.42.0.2:8443", "https://[fd00::2]:8443", "https://lab-7.local:8443"),
        *("http://192.168.1.20:8090", "http://10.42.0.2:8090", "http://[fd00::2]:8090", "http://lab-7.local:8090"),
    )
    assert URLS.local == ("http://localhost:8090", "https://localhost:8443")
    assert console_urls(HostAddresses((), ()), https_port=443, http_port=None) == ConsoleUrls((), ("https://localhost",))


def test_qr_code_leads_to_the_first_network_url() -> None:
    text = banner(URLS, SERVER, TERMINAL)
    assert read_qr(text) == URLS.network[0]
    assert all(url in text for url in (*URLS.network, *URLS.local))
    assert "discovery server 10.42.0.1:11811" in text and "!" not in text


def test_qr_code_leads_to_the_pairing_url_if_given() -> None:
    text = banner(URLS, SERVER, TERMINAL, pairing_url=PAIRING)
    assert read_qr(text) == PAIRING and PAIRING in text


def test_qr_code_without_color_is_light_on_dark() -> None:
    text = banner(URLS, SERVER, Screen(80, True, True, False), pairing_url=PAIRING)
    assert "\x1b" not in text
    assert read_qr(text, inverted=True) == PAIRING


@pytest.mark.parametrize(
    "screen", [Screen(80, False, True, False), Screen(30, True, True, True), Screen(80, True, False, True)]
)
def test_output_without_qr_code_still_has_the_urls(screen: Screen) -> None:
    text = banner(URLS, SERVER, screen)
    assert not set(text) & set("▄▀█\x1b")
    assert all(url in text for url in (*URLS.network, *URLS.local))


def test_one_time_code_is_never_written_to_a_log() -> None:
    text = banner(URLS, MULTICAST, Screen(80, False, True, False), pairing_url=PAIRING)
    assert "K7QM" not in text and "pair" not in text


def test_machine_without_a_network_gets_no_qr_code() -> None:
    text = banner(console_urls(HostAddresses((), ()), https_port=8443, http_port=8090), SERVER, TERMINAL)
    assert "network" not in text and "▀" not in text and "http://localhost:8090" in text


@pytest.mark.parametrize("columns", [10, 30, 45, 60, 80, 200])
def test_lines_fit_and_no_url_is_broken(columns: int) -> None:
    notes = ("the certificate authority was replaced; devices need the new one: lupin console certificate",)
    text = banner(URLS, MULTICAST, Screen(columns, True, True, False), pairing_url=PAIRING, notes=notes)
    whole = {*URLS.network, *URLS.local, PAIRING, MULTICAST.sentence}
    for line in text.splitlines():
        if columns >= 30:
            assert len(line) <= columns or line.strip() in whole
    assert all(url in text for url in whole)
    assert " ".join(text.split()).count("lupin console certificate") == 1


def test_discovery_by_multicast_is_a_warning() -> None:
    assert "! The robot stays unseen. Type: lupin dds setup" in banner(URLS, MULTICAST, TERMINAL)


def test_control_characters_do_not_reach_the_terminal() -> None:
    text = banner(URLS, DiscoveryMode("discovery server \x1b[2J\x9b1"), Screen(80, True, True, False), notes=["a\x07\nb"])
    assert not set(text) & set("\x1b\x9b\x07")


def test_ascii_terminal_gets_only_ascii() -> None:
    assert banner(URLS, DiscoveryMode("domäne"), Screen(80, False, False, False)).isascii()


@given(st.text(min_size=1, max_size=120))
def test_half_blocks_match_the_modules_of_the_code(text: str) -> None:
    modules = [list(row) for row in segno.make_qr(text, error="l").matrix_iter(border=QUIET_ZONE)]
    for color in (True, False):
        drawn = modules_of("\n".join(qr_lines(text, Screen(200, True, True, color))), inverted=not color)
        assert drawn[: len(modules)] == modules
        assert not any(map(any, drawn[len(modules) :]))


@pytest.mark.parametrize(
    ("environment", "unicode", "color"),
    [
        ({"LANG": "nl_NL.UTF-8", "TERM": "xterm"}, True, True),
        ({"LANG": "C.utf8", "NO_COLOR": "1"}, True, False),
        ({"LC_ALL": "nl_NL.ISO-8859-1", "LANG": "nl_NL.UTF-8", "TERM": "dumb"}, False, False),
        ({"LC_ALL": "de_DE.UTF-8@euro"}, True, True),
        ({"LANG": "C"}, False, True),
        ({}, True, True),
    ],
)
def test_terminal_is_described_by_its_environment(environment: dict[str, str], unicode: bool, color: bool) -> None:
    leader, follower = pty.openpty()
    try:
        with os.fdopen(follower, "w", encoding="utf-8") as stream:
            screen = screen_of(stream, environment)
    finally:
        os.close(leader)
    assert (screen.interactive, screen.unicode, screen.color, screen.columns) == (True, unicode, color, 80)


def test_file_is_not_interactive(tmp_path: Path) -> None:
    with (tmp_path / "log").open("w", encoding="latin-1") as stream:
        assert screen_of(stream, {"LANG": "nl_NL.UTF-8"}) == Screen(80, False, False, False)
    assert not screen_of(io.StringIO(), {}).interactive
