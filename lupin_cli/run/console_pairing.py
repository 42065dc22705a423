"""Pairs with the console of another computer as a browser does: accepts its authority once, and gets a cookie for a code.

A code and a cookie are sent only over a connection that the accepted authority vouches for. The authority, not the server's
certificate, is accepted, because a console renews the latter by itself.
"""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import json
import socket
import ssl
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from lupin_cli.run.http_session import open_session
from lupin_cli.run.known_consoles import ConsoleAddress, KnownConsole, console_file, is_cookie, read_known, write_known
from lupin_cli.run.voice_connection import ConnectionLost, Console
from lupin_cli.terminal import echo
from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.json_text import parse_json

CONNECT_TIMEOUT_S = 10.0  # also for the look-up of the name
TLS_TIMEOUT_S = 10.0
ANSWER_TIMEOUT_S = 10.0  # the console waits 1 s after a wrong code
MAX_TRIES = 3  # of a person who types a code
MAX_CODE = 100  # letters that a console takes
_MAX_ANSWER = 100_000  # bytes
_ROOT_PATH, _SESSION_PATH, _PAIR_PATH = "/authority.crt", "/_api/session", "/_api/pair"

SHOW_CODE = "lupin console code"
SHOW_FINGERPRINT = "lupin console certificate"
_SEE_THERE = f"see there: {SHOW_CODE}"

_VALIDITY = (9, 10)  # X509_V_ERR_CERT_NOT_YET_VALID and X509_V_ERR_CERT_HAS_EXPIRED
_NAMES = (62, 64)  # X509_V_ERR_HOSTNAME_MISMATCH and X509_V_ERR_IP_ADDRESS_MISMATCH

Result = TypeVar("Result")


class AccessRefused(ConnectionLost):
    """A console that was reached, but is not trusted or does not let this computer in; the text says what to type."""


class CodeRefused(AccessRefused):
    """A code that is wrong, used or expired."""


@dataclass(frozen=True)
class Consent:
    """What the operator gave on the command line, and how to ask for the rest, if there is a terminal to ask at.

    `accept` is the SHA-256 of an authority to accept without asking.
    """

    code: str = field(default="", repr=False)
    accept: str = ""
    ask_trust: Callable[[str], bool] | None = None
    ask_code: Callable[[], str] | None = None


def reach_console(address: ConsoleAddress, consent: Consent) -> Console:
    """Return how to connect to a console, after pairing with it if that is needed.

    Raises ConnectionLost, MalformedFile and OSError, the last two for the file that keeps the pairing.
    """
    known = read_known(address)
    if known is None:
        known = KnownConsole(_accept_root(address, consent))
        write_known(address, known)
    try:
        trust = _trusting(known.root)
    except (ssl.SSLError, ValueError) as error:
        again = f"forget it, and pair again: {address.command('--forget')}"
        raise MalformedFile(console_file(address), None, f"the authority is no certificate; {again}") from error
    if consent.accept and _digits(consent.accept) != _digits(fingerprint(known.root)):
        raise AccessRefused(
            f"{address} is known by an authority with the SHA-256 {fingerprint(known.root)}, not {consent.accept[:200]}; "
            f"nothing was sent. If it has another one now, forget the old one: {address.command('--forget')}"
        )
    session = asyncio.run(_read_session(address, trust, known))
    if session is None:
        known = _pair(address, consent, trust, known)
        write_known(address, known)
    elif consent.code:
        again = address.command("--forget")
        echo(f"already paired with {address} as {_described(session)}; the code was not used. To pair anew: {again}", err=True)
    return Console(address.url("https"), trust, known.cookie, f"connect again with: {address.command()}")


def fingerprint(root: str) -> str:
    """Return the SHA-256 of a certificate in PEM, in the form that `lupin console certificate` shows."""
    return hashlib.sha256(ssl.PEM_cert_to_DER_cert(root)).digest().hex(":").upper()


# -- the authority -----------------------------------------------------------------------------------------------------
def _accept_root(address: ConsoleAddress, consent: Consent) -> str:
    """Get the authority of a console that is not known yet, and have the operator accept it."""
    root = asyncio.run(_fetch_root(address))
    shown = fingerprint(root)
    is_accepted = _digits(consent.accept) == _digits(shown)
    question = (
        f"{address} is not known yet. The authority of its certificate has the SHA-256\n  {shown}\n"
        f"Compare it with what this shows there: {SHOW_FINGERPRINT}\nIs it the same?"
    )
    if not consent.accept and consent.ask_trust is not None:
        is_accepted = consent.ask_trust(question)
    if not is_accepted:
        found = f", not {consent.accept[:200]}" if consent.accept else ", which was not accepted yet"
        raise AccessRefused(
            f"{address} shows an authority with the SHA-256 {shown}{found}; nothing was sent. "
            f"Compare it with what `{SHOW_FINGERPRINT}` shows there, then type: {address.command('--accept', shown)}"
        )
    return root


def _digits(shown: str) -> str:
    return shown.upper().removeprefix("SHA256:").replace(":", "").replace(" ", "")


async def _fetch_root(address: ConsoleAddress) -> str:
    """Get the authority that a console hands out, and check that its certificate is of that authority."""
    untrusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    untrusting.check_hostname, untrusting.verify_mode = False, ssl.VerifyMode.CERT_NONE
    await _check_tls(address, untrusting)
    status, content, _ = await _request(address, untrusting, KnownConsole(""), _ROOT_PATH)
    try:
        # Of several certificates all would be trusted, and only one be shown: what is not the first is dropped.
        root = ssl.DER_cert_to_PEM_cert(ssl.PEM_cert_to_DER_cert(content.decode(errors="replace")))
        trust = _trusting(root)
    except (ssl.SSLError, ValueError) as error:
        raise AccessRefused(_other_version(address, f"it answers {status} for the certificate of its authority")) from error
    try:
        await _check_tls(address, trust)
    except ssl.SSLCertVerificationError as error:
        raise AccessRefused(_certificate_problem(address, error, fingerprint(root))) from error
    return root


def _trusting(root: str) -> ssl.SSLContext:
    """Return a TLS context that trusts one authority. Raises ssl.SSLError and ValueError."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.load_verify_locations(cadata=root)
    return context


# -- the code ----------------------------------------------------------------------------------------------------------
def _pair(address: ConsoleAddress, consent: Consent, trust: ssl.SSLContext, known: KnownConsole) -> KnownConsole:
    """Exchange a code for a cookie; a person may type another one after a wrong one."""
    if not consent.code and consent.ask_code is None:
        raise AccessRefused(
            f"{address} does not know this computer. Show a code there with: {SHOW_CODE}, and give it to the standard "
            f"input of: {address.command('--code', '-')}"
        )
    for number in range(1, MAX_TRIES + 1):
        code = consent.code
        if not code and consent.ask_code is not None:
            try:
                code = consent.ask_code()
            except EOFError:
                raise AccessRefused(f"no code was given; pair with: {address.command()}") from None
        try:
            paired, described = asyncio.run(_redeem(address, trust, known, code))
        except CodeRefused as error:
            if consent.code or number == MAX_TRIES:
                raise
            echo(str(error), err=True)
            continue
        echo(f"paired with {address} as {described}", err=True)
        return paired
    raise AssertionError("the last try returns or raises")


async def _redeem(address: ConsoleAddress, trust: ssl.SSLContext, known: KnownConsole, code: str) -> tuple[KnownConsole, str]:
    """Send a code; return the console with its cookie, and what it calls this computer. Raises CodeRefused."""
    another = f"show the present one there with: {SHOW_CODE}, and type: {address.command()}"
    if not 0 < len(code) <= MAX_CODE:
        raise CodeRefused(f"a code has 8 letters and digits; {another}")
    status, content, headers = await _request(address, trust, known, _PAIR_PATH, {"code": code})
    if status in (400, 403):
        raise CodeRefused(f"{address} does not take this code: it is wrong, used or expired; {another}")
    if status == 429:
        raise AccessRefused(f"{address} takes no more codes for now; wait a minute, then {another}")
    if status == 503:
        raise AccessRefused(f"{address} cannot store the pairing; see why there with: lupin console sessions")
    cookie = headers.get("Set-Cookie", "").partition(";")[0]
    session = _object(content)
    if status != 200 or not is_cookie(cookie) or session is None:
        raise AccessRefused(_other_version(address, f"it answers {status} to a code"))
    return replace(known, cookie=cookie), _described(session)


async def _read_session(address: ConsoleAddress, trust: ssl.SSLContext, known: KnownConsole) -> Mapping[str, Any] | None:
    """Return the session that a console has for this computer; None if it is not paired."""
    try:
        await _check_tls(address, trust)
    except ssl.SSLCertVerificationError as error:
        raise AccessRefused(_certificate_problem(address, error, fingerprint(known.root))) from error
    status, content, _ = await _request(address, trust, known, _SESSION_PATH)
    answer = _object(content)
    if status == 421:
        raise AccessRefused(f"{address} does not answer to this name; use one that this shows there: {SHOW_CODE}")
    if status != 200 or answer is None or "control" not in answer:
        raise AccessRefused(_other_version(address, f"it answers {status} for {_SESSION_PATH}"))
    session = answer.get("session")
    return session if isinstance(session, dict) else None


def _described(session: Mapping[str, Any]) -> str:
    return f"{str(session.get('name'))[:60]}, {str(session.get('role'))[:20]}"


def _object(content: bytes) -> Mapping[str, Any] | None:
    with contextlib.suppress(ValueError):
        value = parse_json(content)
        return value if isinstance(value, dict) else None
    return None


# -- connections -------------------------------------------------------------------------------------------------------
async def _check_tls(address: ConsoleAddress, context: ssl.SSLContext) -> None:
    """Connect, and make a TLS handshake. Raises ssl.SSLCertVerificationError, and ConnectionLost for all else."""
    ping = f"reach its computer first: ping {address.host}"
    try:
        opening = asyncio.open_connection(address.host, address.port)
        _, writer = await _within(CONNECT_TIMEOUT_S, f"no connection to {address}", ping, opening)
        await _abort(writer)
    except ConnectionLost:
        raise
    except (socket.gaierror, UnicodeError) as error:
        raise ConnectionLost(f"the name {address.host} is not known here ({error}); {ping}") from error
    except OSError as error:
        reason = error.strerror or error
        raise ConnectionLost(f"no console at {address}: {reason}; start one there with: lupin up") from error
    opening = asyncio.open_connection(address.host, address.port, ssl=context, server_hostname=address.host)
    try:
        _, writer = await _within(TLS_TIMEOUT_S, f"no end of the TLS handshake with {address}", _SEE_THERE, opening)
        await _abort(writer)
    except (ConnectionLost, ssl.SSLCertVerificationError):
        raise
    except OSError as error:  # also ssl.SSLError
        reason = getattr(error, "reason", None) or error.strerror or error
        raise AccessRefused(
            f"{address} does not speak HTTPS ({reason}), and a code must not cross the network unencrypted; "
            "serve it there with: lupin console --tls"
        ) from error


async def _abort(writer: asyncio.StreamWriter) -> None:
    """Close a connection over which nothing was sent."""
    writer.transport.abort()
    with contextlib.suppress(OSError):
        await writer.wait_closed()


async def _within(seconds: float, problem: str, next_step: str, awaited: Awaitable[Result]) -> Result:
    """Wait for something, but not for ever. Raises ConnectionLost, which names what was waited for."""
    try:
        return await asyncio.wait_for(awaited, seconds)
    except asyncio.TimeoutError as error:
        raise ConnectionLost(f"{problem} within {seconds:g} s; {next_step}") from error


async def _request(
    address: ConsoleAddress, trust: ssl.SSLContext, known: KnownConsole, path: str, body: Any = None
) -> tuple[int, bytes, Mapping[str, str]]:
    """Send a request with the cookie, a POST if it has a body; return the status, the content and the headers."""
    import aiohttp

    headers = {"Cookie": known.cookie} if known.cookie else {}
    data = None
    if body is not None:
        headers["Content-Type"], data = "application/json", json.dumps(body)
    url, method = f"{address.url('https')}{path}", "GET" if body is None else "POST"

    async def answer() -> tuple[int, bytes, Mapping[str, str]]:
        async with (
            open_session() as session,
            session.request(method, url, data=data, headers=headers, ssl=trust, allow_redirects=False) as response,
        ):
            content = b""
            while chunk := await response.content.read(_MAX_ANSWER + 1 - len(content)):
                content += chunk
                if len(content) > _MAX_ANSWER:
                    raise AccessRefused(_other_version(address, f"it answers more than {_MAX_ANSWER} bytes for {path}"))
            return response.status, content, response.headers

    try:
        return await _within(ANSWER_TIMEOUT_S, f"no answer of {address} for {path}", _SEE_THERE, answer())
    except ConnectionLost:
        raise
    except (aiohttp.ClientError, OSError) as error:
        raise ConnectionLost(f"{address} ended the connection for {path}: {error}; {_SEE_THERE}") from error


# -- problems ----------------------------------------------------------------------------------------------------------
def _certificate_problem(address: ConsoleAddress, error: ssl.SSLCertVerificationError, accepted: str) -> str:
    """Return what a certificate that the accepted authority does not vouch for may mean, and what to type."""
    if error.verify_code in _VALIDITY:
        return f"the certificate of {address} is not valid at the time here ({error.verify_message}); compare both clocks: date"
    if error.verify_code in _NAMES:
        return f"the certificate of {address} is for other names; use one that this shows there: {SHOW_CODE}"
    return (
        f"{address} shows a certificate of another authority than the accepted one, SHA-256 {accepted} "
        f"({error.verify_message}); nothing was sent. Either its authority was made anew, or this is not that console. Compare "
        f"with what `{SHOW_FINGERPRINT}` shows there; to accept another one: {address.command('--forget')}"
    )


def _other_version(address: ConsoleAddress, found: str) -> str:
    return f"{address} is no console of Lupin, or one of another version: {found}. Compare here and there: lupin --version"
