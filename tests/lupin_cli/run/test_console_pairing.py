"""A console of another computer is trusted once, by its authority, and pairs this computer by a code; each problem is named."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from lupin_cli.run import console_pairing
from lupin_cli.run.console_pairing import AccessRefused, CodeRefused, Consent, fingerprint, reach_console
from lupin_cli.run.known_consoles import ConsoleAddress, KnownConsole, console_file, read_known, write_known
from lupin_cli.run.voice_connection import ConnectionLost, Console
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.console.certificate import CertificateStore
from tests.support.certificates import HostStore, utc
from tests.support.fake_console import CODE, COOKIE, FakeConsole, serve_console

TRUSTING = Consent(ask_trust=lambda _: True)
PAIRING = replace(TRUSTING, code="k7q2-mxpa")


@pytest.fixture(autouse=True)
def _state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def console(tmp_path: Path) -> Iterator[FakeConsole]:
    with serve_console(tmp_path / "certificate") as served:
        yield served


def address_of(console: FakeConsole) -> ConsoleAddress:
    return ConsoleAddress("127.0.0.1", console.port)


def refuse(_: str) -> bool:
    raise AssertionError("nobody needs to be asked")


# -- the authority -----------------------------------------------------------------------------------------------------
def test_authority_is_shown_as_its_own_computer_shows_it(console: FakeConsole, tmp_path: Path) -> None:
    asked: list[str] = []

    def ask(question: str) -> bool:
        asked.append(question)
        return True

    reach_console(address_of(console), replace(PAIRING, ask_trust=ask))
    expected = CertificateStore(tmp_path / "certificate").ensure().authority.sha256
    assert len(asked) == 1 and expected in asked[0] and "lupin console certificate" in asked[0]
    assert fingerprint(console.root) == expected


def test_authority_that_nobody_accepts_gets_nothing(console: FakeConsole) -> None:
    for consent in (Consent(CODE), Consent(CODE, ask_trust=lambda _: False), Consent(CODE, accept="AB:CD", ask_trust=refuse)):
        with pytest.raises(AccessRefused, match="nothing was sent") as raised:
            reach_console(address_of(console), consent)
    command = f"lupin voice --console 127.0.0.1:{console.port} --accept {fingerprint(console.root)}"
    assert str(raised.value).endswith(command) and "not AB:CD" in str(raised.value)
    assert {path for path, *_ in console.requests} == {"/authority.crt"} and read_known(address_of(console)) is None


@pytest.mark.parametrize("form", ["{}", "sha256:{}", " {} "])
def test_fingerprint_on_the_command_line_is_accepted(console: FakeConsole, form: str) -> None:
    given = form.format(fingerprint(console.root).lower())
    assert reach_console(address_of(console), Consent(CODE, given)).cookie == COOKIE


def test_changed_authority_is_refused_with_the_next_command(console: FakeConsole, tmp_path: Path) -> None:
    other = CertificateStore(tmp_path / "other").ensure().authority
    with serve_console(tmp_path / "other") as before:
        known = KnownConsole(before.root, COOKIE)
    write_known(address_of(console), known)
    with pytest.raises(AccessRefused, match="another authority than the accepted one") as raised:
        reach_console(address_of(console), replace(PAIRING, ask_trust=refuse))
    assert other.sha256 in str(raised.value) and console.requests == []
    assert str(raised.value).endswith(f"lupin voice --console 127.0.0.1:{console.port} --forget")


def test_known_console_is_refused_if_another_is_accepted(console: FakeConsole) -> None:
    reach_console(address_of(console), PAIRING)
    count = len(console.requests)
    with pytest.raises(AccessRefused, match="not AB:CD") as raised:
        reach_console(address_of(console), replace(PAIRING, accept="AB:CD"))
    assert len(console.requests) == count and str(raised.value).endswith("--forget")


def test_renewed_server_certificate_is_of_the_same_authority(tmp_path: Path) -> None:
    with serve_console(tmp_path / "certificate") as console:
        reach_console(address_of(console), PAIRING)
        known = read_known(address_of(console))
    assert known is not None
    (tmp_path / "certificate" / "server.pem").unlink()
    with serve_console(tmp_path / "certificate") as console:
        console.cookies.add(COOKIE)
        write_known(address_of(console), known)
        assert reach_console(address_of(console), Consent()).cookie == COOKIE


@pytest.mark.parametrize("extra", ["before", "after"])
def test_second_authority_in_the_file_is_not_trusted(console: FakeConsole, tmp_path: Path, extra: str) -> None:
    own = console.root
    other = CertificateStore(tmp_path / "other")
    other.ensure()
    genuine = other.root_path.read_text()
    console.root = genuine + own if extra == "after" else own + genuine
    with pytest.raises(AccessRefused):
        reach_console(address_of(console), Consent(CODE, fingerprint(genuine), ask_trust=refuse))
    assert "/_api/pair" not in {path for path, *_ in console.requests}


def test_certificate_for_other_names_is_refused(console: FakeConsole, monkeypatch: pytest.MonkeyPatch) -> None:
    look_up = socket.getaddrinfo
    monkeypatch.setattr(socket, "getaddrinfo", lambda _, *others, **more: look_up("127.0.0.1", *others, **more))
    with pytest.raises(AccessRefused, match="is for other names; use one that this shows there: lupin console code"):
        reach_console(ConsoleAddress("alias.test", console.port), PAIRING)


def test_certificate_of_another_time_names_the_clocks(tmp_path: Path) -> None:
    store = HostStore(tmp_path / "certificate", now=utc(2031))  # the clock of its computer is ahead
    refused = pytest.raises(AccessRefused, match=r"is not valid at the time here .*; compare both clocks: date")
    with serve_console(tmp_path / "certificate", store=store) as console, refused:
        reach_console(address_of(console), PAIRING)


# -- the code ----------------------------------------------------------------------------------------------------------
def test_code_pairs_once_and_the_cookie_is_kept(console: FakeConsole, capsys: pytest.CaptureFixture[str]) -> None:
    first = reach_console(address_of(console), PAIRING)
    again = reach_console(address_of(console), Consent())
    assert first.cookie == again.cookie == COOKIE and again.url == f"https://127.0.0.1:{console.port}"
    assert [path for path, *_ in console.requests].count("/_api/pair") == 1
    output = capsys.readouterr()
    assert "paired with" in output.err and "computer-1, operator" in output.err
    for secret in ("k7q2-mxpa", COOKIE, "abcdefgh"):
        assert secret not in output.err + output.out


def test_code_of_a_paired_console_is_not_used(console: FakeConsole, capsys: pytest.CaptureFixture[str]) -> None:
    reach_console(address_of(console), PAIRING)
    reach_console(address_of(console), PAIRING)
    assert [path for path, *_ in console.requests].count("/_api/pair") == 1
    assert "the code was not used" in capsys.readouterr().err


def test_revoked_pairing_asks_for_another_code(console: FakeConsole) -> None:
    reach_console(address_of(console), PAIRING)
    console.cookies.clear()
    with pytest.raises(AccessRefused, match=r"does not know this computer. Show a code there with: lupin console code"):
        reach_console(address_of(console), Consent())
    assert reach_console(address_of(console), Consent(ask_code=lambda: CODE)).cookie == COOKIE


@pytest.mark.parametrize("code", ["WRONG", "x" * 101])
def test_wrong_code_names_the_next_command(console: FakeConsole, code: str) -> None:
    with pytest.raises(CodeRefused, match="show the present one there with: lupin console code, and type: lupin voice"):
        reach_console(address_of(console), replace(TRUSTING, code=code))
    known = read_known(address_of(console))
    assert known is not None and known.cookie == ""


def test_person_may_type_another_code_a_few_times(console: FakeConsole) -> None:
    typed = ["WRONG", "", CODE]
    assert reach_console(address_of(console), replace(TRUSTING, ask_code=lambda: typed.pop(0))).cookie == COOKIE
    console.cookies.clear()
    typed = ["1", "2", "3", CODE]
    with pytest.raises(CodeRefused):
        reach_console(address_of(console), Consent(ask_code=lambda: typed.pop(0)))
    assert typed == [CODE]


def test_no_code_at_the_prompt_ends_it(console: FakeConsole) -> None:
    def end() -> str:
        raise EOFError

    with pytest.raises(AccessRefused, match="no code was given"):
        reach_console(address_of(console), replace(TRUSTING, ask_code=end))


@pytest.mark.parametrize(
    ("path", "answer", "message"),
    [
        ("/authority.crt", (404, "no"), "one of another version: it answers 404"),
        ("/authority.crt", (200, "x" * 200_000), "it answers more than 100000 bytes"),
        ("/_api/session", (404, "no"), "one of another version: it answers 404"),
        ("/_api/session", (200, "<html>"), "another version.*lupin --version"),
        ("/_api/session", (200, "[]"), "another version"),
        ("/_api/session", (421, "this server is not x"), "does not answer to this name"),
        ("/_api/pair", (404, "no"), "another version"),
        ("/_api/pair", (200, "{}"), "another version"),  # without a cookie
        ("/_api/pair", (403, "no"), "it is wrong, used or expired"),
        ("/_api/pair", (429, "no"), "takes no more codes for now; wait a minute"),
        ("/_api/pair", (503, "no"), "cannot store the pairing"),
    ],
)
def test_answer_of_another_kind_is_named(console: FakeConsole, path: str, answer: tuple[int, str], message: str) -> None:
    console.answers[path] = answer
    with pytest.raises(AccessRefused, match=message):
        reach_console(address_of(console), PAIRING)


@pytest.mark.parametrize("path", ["/authority.crt", "/_api/session", "/_api/pair"])
def test_wait_for_an_answer_is_bounded_and_named(console: FakeConsole, monkeypatch: pytest.MonkeyPatch, path: str) -> None:
    monkeypatch.setattr(console_pairing, "ANSWER_TIMEOUT_S", 0.3)
    console.answers[path] = (0, "")
    with pytest.raises(ConnectionLost, match=f"no answer of 127.0.0.1:{console.port} for {path} within 0.3 s; see there"):
        reach_console(address_of(console), PAIRING)


# -- connections -------------------------------------------------------------------------------------------------------
def test_no_console_there_names_the_next_command() -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = ConsoleAddress("127.0.0.1", unused.getsockname()[1])
    with pytest.raises(ConnectionLost, match=r"no console at 127.0.0.1:.*start one there with: lupin up"):
        reach_console(address, PAIRING)


@pytest.mark.parametrize("host", ["robot.invalid", "a..b"])
def test_unknown_name_is_named(host: str) -> None:
    with pytest.raises(ConnectionLost, match=f"the name {host} is not known here"):
        reach_console(ConsoleAddress(host), PAIRING)


def test_console_without_https_gets_no_code(tmp_path: Path) -> None:
    with serve_console(tmp_path, tls=False) as console:
        with pytest.raises(AccessRefused, match=r"does not speak HTTPS .* a code must not cross the network unencrypted"):
            reach_console(address_of(console), PAIRING)
        assert console.requests == []


def test_silent_server_ends_the_wait_for_tls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console_pairing, "TLS_TIMEOUT_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = ConsoleAddress("127.0.0.1", silent.getsockname()[1])
        with pytest.raises(ConnectionLost, match=r"no end of the TLS handshake with .* within 0.3 s; see there: lupin console"):
            reach_console(address, PAIRING)


def test_computer_that_does_not_answer_ends_the_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    async def never(*_: object, **__: object) -> None:
        await asyncio.sleep(3600.0)

    monkeypatch.setattr(console_pairing, "CONNECT_TIMEOUT_S", 0.3)
    monkeypatch.setattr(asyncio, "open_connection", never)
    with pytest.raises(ConnectionLost, match=r"no connection to robot within 0.3 s; reach its computer first: ping robot"):
        reach_console(ConsoleAddress("robot"), PAIRING)


def test_damaged_authority_in_the_file_says_what_to_type(console: FakeConsole) -> None:
    write_known(address_of(console), KnownConsole("no certificate"))
    with pytest.raises(MalformedFile, match="--forget"):
        reach_console(address_of(console), PAIRING)
    assert console_file(address_of(console)).exists()


def test_console_says_how_to_connect_again(console: FakeConsole) -> None:
    reached = reach_console(address_of(console), PAIRING)
    assert isinstance(reached, Console) and reached.next_step.endswith(f"lupin voice --console 127.0.0.1:{console.port}")
