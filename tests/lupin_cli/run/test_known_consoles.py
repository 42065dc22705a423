"""Addresses of consoles are read as people write them; what is known of each is kept where only its owner reads it."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_cli.run.known_consoles import (
    BadAddress,
    ConsoleAddress,
    KnownConsole,
    console_file,
    forget_known,
    is_cookie,
    parse_address,
    read_known,
    write_known,
)
from lupin_runtime.atomic_file import MalformedFile

ADDRESS = ConsoleAddress("robot.local", 8090)
KNOWN = KnownConsole("a certificate", "lupin_session=abc")


@pytest.fixture(autouse=True)
def _state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("robot.local", "robot.local", 8090),
        ("Robot.local:9000", "robot.local", 9000),
        ("https://192.168.1.20:8090/", "192.168.1.20", 8090),
        ("http://127.0.0.1:8090", "127.0.0.1", 8090),
        ("[fe80::1%wlan0]:81", "fe80::1%wlan0", 81),
        ("fe80::1", "fe80::1", 8090),
        ("::1", "::1", 8090),
    ],
)
def test_address_is_read_as_people_write_it(text: str, host: str, port: int) -> None:
    assert parse_address(text) == ConsoleAddress(host, port)
    assert parse_address(str(parse_address(text))) == parse_address(text)


@pytest.mark.parametrize("text", ["", ":8090", "host:0", "host:65536", "host:http", "-o", "a b", "host/path", "a" * 254, "é"])
def test_other_texts_are_refused(text: str) -> None:
    with pytest.raises(BadAddress, match=r"is not HOST or HOST:PORT of a console, for example robot.local:8090"):
        parse_address(text)


@given(st.text(max_size=30))
def test_any_text_is_an_address_or_refused(text: str) -> None:
    try:
        address = parse_address(text)
    except BadAddress:
        return
    assert console_file(address).parent.name == "paired" and parse_address(str(address)) == address


@pytest.mark.parametrize(("host", "expected"), [("localhost", True), ("127.0.0.1", True), ("::1", True), ("robot", False)])
def test_only_this_computer_needs_no_pairing(host: str, expected: bool) -> None:
    assert ConsoleAddress(host).is_of_this_computer is expected


def test_command_names_the_console() -> None:
    assert ADDRESS.command("--forget") == "lupin voice --console robot.local --forget"
    assert ConsoleAddress("fe80::1", 81).command() == "lupin voice --console '[fe80::1]:81'"


def test_only_the_owner_may_read_what_is_kept(tmp_path: Path) -> None:
    assert read_known(ADDRESS) is None and not forget_known(ADDRESS)
    write_known(ADDRESS, KNOWN)
    path = console_file(ADDRESS)
    assert path.is_relative_to(tmp_path) and stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert read_known(ADDRESS) == KNOWN and read_known(ConsoleAddress("robot.local", 1)) is None
    assert forget_known(ADDRESS) and read_known(ADDRESS) is None


def test_file_that_others_may_read_is_refused() -> None:
    write_known(ADDRESS, KNOWN)
    console_file(ADDRESS).chmod(0o644)
    with pytest.raises(MalformedFile, match="others on this computer may read it; forget it, and pair again: lupin voice"):
        read_known(ADDRESS)


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"root": 1}', '{"root": "", "cookie": "a=b\\r\\nX: y"}', '{"x": ""}'])
def test_damaged_file_says_what_to_type(content: str) -> None:
    write_known(ADDRESS, KNOWN)
    console_file(ADDRESS).write_text(content)
    with pytest.raises(MalformedFile, match=r"lupin voice --console robot\.local --forget"):
        read_known(ADDRESS)


@pytest.mark.parametrize(
    ("text", "expected"), [("a=b", True), ("a=", False), ("a=b; c=d", False), ("a=b c", False), ("a=\n", False)]
)
def test_cookie_is_one_name_and_one_value(text: str, expected: bool) -> None:
    assert is_cookie(text) is expected
