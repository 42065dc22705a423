"""Tokens for the voice service: how they are asked for, who gets one, and what is said when there is none."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Awaitable, Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import aiohttp
import pytest
from aiohttp import web

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.console import voice_token
from lupin_runtime.console.api_table import SESSION, add_resources
from lupin_runtime.console.authority import Refused, Role, Session
from lupin_runtime.console.voice_key import BadKey, check_key, forget_key, key_file, read_key, write_key
from lupin_runtime.console.voice_token import (
    SERVICE_VARIABLE,
    TokenFailed,
    VoiceTokens,
    service_url,
    socket_url,
    token_of,
    token_request,
)
from tests.support.live_server import KEY, LiveServer

MODEL = "models/gemini-3.8-live"
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def mint(server: LiveServer) -> Any:
    """Start the server, and mint a token at it: the token, or the reason and the status."""

    async def run() -> Any:
        tokens = VoiceTokens({SERVICE_VARIABLE: await server.start()})
        try:
            return await tokens.mint(MODEL)
        except TokenFailed as error:
            return str(error), error.status
        finally:
            await tokens.close()
            await server.stop()

    return asyncio.run(run())


def ask(role: Role, body: Any, path: str = "/_api/voice/token") -> tuple[int, Any]:
    """Send a request as a browser of this role, with a console whose service is the server of tests."""

    async def run() -> tuple[int, Any]:
        server = LiveServer()
        tokens = VoiceTokens({SERVICE_VARIABLE: await server.start()})

        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            request[SESSION] = Session("phone-1", role)
            try:
                return await handler(request)
            except Refused as refusal:
                return web.json_response({"error": str(refusal)}, status=403)

        application = web.Application(middlewares=[guard])
        add_resources(application, tokens.resources())
        runner = web.AppRunner(application, access_log=None)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        url = f"http://127.0.0.1:{runner.addresses[0][1]}{path}"
        try:
            async with aiohttp.ClientSession() as http:
                sent = http.get(url) if body is None else http.post(url, json=body)
                async with sent as response:
                    text = await response.text()
                    return response.status, json.loads(text) if "json" in response.content_type else text
        finally:
            await tokens.close()
            await runner.cleanup()
            await server.stop()

    return asyncio.run(run())


def test_key_is_stored_for_this_user_only() -> None:
    path = key_file()
    assert read_key(path) is None and forget_key(path) is False
    write_key(path, check_key(f" {KEY}\n"))
    assert read_key(path) == KEY
    assert path.stat().st_mode & 0o777 == 0o600 and path.parent.stat().st_mode & 0o077 == 0
    assert forget_key(path) is True and read_key(path) is None


def test_key_that_others_may_read_is_not_used() -> None:
    path = key_file()
    write_key(path, KEY)
    path.chmod(0o644)
    with pytest.raises(MalformedFile, match="others on this computer may read it") as caught:
        read_key(path)
    assert KEY not in str(caught.value)


@pytest.mark.parametrize("text", ["", "short", "with a space in its middle of it", "ü" * 30, "x" * 401])
def test_text_that_is_no_key_is_refused_without_being_shown(text: str) -> None:
    with pytest.raises(BadKey) as caught:
        check_key(text)
    assert not text or text not in str(caught.value)


def test_token_is_minted_with_the_stored_key() -> None:
    write_key(key_file(), KEY)
    assert mint(LiveServer()) == "auth_tokens/0"


def test_token_is_for_one_session_of_one_model() -> None:
    body = token_request(MODEL, datetime(2026, 11, 27, 12, tzinfo=timezone.utc))
    assert body == {
        "uses": 1,
        "newSessionExpireTime": "2026-11-27T12:01:00Z",
        "expireTime": "2026-11-27T12:30:00Z",
        "bidiGenerateContentSetup": {"model": MODEL},
        "fieldMask": "model",
    }


def test_missing_key_names_the_command() -> None:
    assert mint(LiveServer()) == (voice_token.NO_KEY, 409)


@pytest.mark.parametrize(
    ("status", "expected"), [(400, voice_token.BAD_KEY), (403, voice_token.BAD_KEY), (429, voice_token.NO_QUOTA)]
)
def test_refusal_of_the_service_says_what_to_do(status: int, expected: str) -> None:
    write_key(key_file(), KEY)
    server = LiveServer()
    server.key_status = status
    assert mint(server)[0] == expected


def test_service_that_is_away_needs_the_internet() -> None:
    write_key(key_file(), KEY)

    async def run() -> str:
        server = LiveServer()
        url = await server.start()
        await server.stop()
        tokens = VoiceTokens({SERVICE_VARIABLE: url})
        with pytest.raises(TokenFailed) as caught:
            await tokens.mint(MODEL)
        await tokens.close()
        return str(caught.value)

    assert asyncio.run(run()) == voice_token.UNREACHABLE


def test_silent_service_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    write_key(key_file(), KEY)
    monkeypatch.setattr(voice_token, "TIMEOUT_S", 0.05)

    async def run(port: int) -> int:
        tokens = VoiceTokens({SERVICE_VARIABLE: f"http://127.0.0.1:{port}"})
        with pytest.raises(TokenFailed) as caught:
            await tokens.mint(MODEL)
        await tokens.close()
        return caught.value.status

    with socket.create_server(("127.0.0.1", 0)) as silent:
        assert asyncio.run(run(silent.getsockname()[1])) == 504


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"name": 5}', b'{"name": ""}', b'{"name": "a\\nb"}'])
def test_answer_without_a_token_is_no_token(content: bytes) -> None:
    with pytest.raises(TokenFailed, match="has no token"):
        token_of(200, content)


def test_key_is_sent_encrypted_or_to_this_computer_only() -> None:
    assert service_url({}) == voice_token.SERVICE_URL
    assert socket_url(service_url({})).startswith("wss://generativelanguage.googleapis.com/ws/")
    for url in ("http://10.0.0.1", "ftp://127.0.0.1", "http://127.0.0.1.example.com", "nonsense"):
        with pytest.raises(TokenFailed, match=SERVICE_VARIABLE):
            service_url({SERVICE_VARIABLE: url})


def test_operator_gets_a_token_and_the_address_of_the_service() -> None:
    write_key(key_file(), KEY)
    status, answer = ask(Role.OPERATOR, {"model": MODEL})
    assert status == 200 and answer["token"] == "auth_tokens/0"
    assert answer["url"].startswith("ws://127.0.0.1:") and KEY not in json.dumps(answer)
    assert ask(Role.VIEWER, None, "/_api/voice/key") == (200, {"stored": True})


def test_viewer_gets_no_token() -> None:
    write_key(key_file(), KEY)
    status, answer = ask(Role.VIEWER, {"model": MODEL})
    assert status == 403 and "is a viewer" in answer["error"]


@pytest.mark.parametrize("body", [{}, {"model": 5}, {"model": "gemini"}, {"model": "models/../x"}])
def test_token_is_for_a_model_that_is_named(body: Any) -> None:
    assert ask(Role.OPERATOR, body)[0] == 400
