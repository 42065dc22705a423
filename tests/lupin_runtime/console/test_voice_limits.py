"""What a client of the voice endpoint may send, keep waiting and leave behind has limits, each of which is reached here."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, cast

import pytest
from aiohttp import WSMessage, WSMsgType, web

from lupin_runtime.console import voice_offline, voice_session, voice_token
from lupin_runtime.console.authority import Role, Session
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.connection import Connection
from lupin_runtime.console.voice import MAX_ENVELOPES, VoiceAgents
from lupin_runtime.console.voice_hearing import MAX_NAMES
from lupin_runtime.console.voice_key import key_file, write_key
from lupin_runtime.console.voice_session import MAX_WAITING, VoiceSession
from lupin_runtime.console.voice_token import BUSY, MAX_MINTING, SERVICE_VARIABLE, TOKEN_PATH, TokenFailed, VoiceTokens
from lupin_runtime.voice.listener_protocol import Kind
from lupin_runtime.voice.slots import Names
from tests.support.live_server import KEY
from tests.support.voice_rig import FakeBridge, Rig, run, settle

MODEL = "models/gemini-3.8-live"


@pytest.mark.parametrize("excess", [0, 1])
def test_message_has_a_greatest_length(excess: int) -> None:
    async def test(rig: Rig) -> None:
        text = json.dumps({"call": {"id": "a", "name": "stop"}})
        rig.session.handle(text.ljust(voice_session._MAX_MESSAGE + excess))
        await settle()

    rig = run(test)
    assert (list(rig.responses()), len(rig.messages("error"))) == ((["a"], 0) if excess == 0 else ([], 1))


@pytest.mark.parametrize("excess", [0, 1])
def test_id_has_a_greatest_length(excess: int) -> None:
    async def test(rig: Rig) -> None:
        rig.call("a" * (voice_session._MAX_ID + excess), "stop")
        await settle()

    rig = run(test)
    assert (len(rig.responses()), len(rig.messages("error"))) == ((1, 0) if excess == 0 else (0, 1))


def test_session_with_many_calls_that_wait_is_overloaded() -> None:
    async def test(rig: Rig) -> None:
        for number in range(MAX_WAITING):
            assert not rig.session.is_overloaded
            rig.call(f"a{number}", "stop")
        assert rig.session.is_overloaded
        await settle()
        assert not rig.session.is_overloaded and len(rig.responses()) == MAX_WAITING

    run(test)


class FakeSocket:
    """A WebSocket whose client has sent some messages, and then closes it."""

    closed = False

    def __init__(self, texts: list[str]) -> None:
        self._texts = texts

    async def __aiter__(self) -> AsyncIterator[WSMessage]:
        for text in self._texts:
            yield WSMessage(WSMsgType.TEXT, text, None)

    def exception(self) -> None:
        """Nothing went wrong."""


def test_nothing_is_read_from_a_client_that_overloads() -> None:
    handled: list[Any] = []
    asked: list[int] = []

    def is_overloaded() -> bool:
        asked.append(len(handled))
        return len(asked) < 5

    async def test() -> None:
        await Connection(cast(web.WebSocketResponse, FakeSocket(["a", "b"])), None).serve(handled.append, is_overloaded)

    asyncio.run(test())
    assert handled == ["a", "b"] and asked[:5] == [1] * 5


def agents() -> VoiceAgents:
    async def change_location(*_: Any) -> None:
        raise AssertionError("no location is changed here")

    return VoiceAgents(cast(Bridge, FakeBridge()), cast(Any, None), lambda _: None, dict, change_location)


@pytest.mark.parametrize("connected", [0, 1, MAX_ENVELOPES])
def test_envelopes_of_sessions_that_left_are_bounded(connected: int) -> None:
    voice = agents()
    sessions = [Session(f"phone-{number}", Role.OPERATOR) for number in range(MAX_ENVELOPES + 10)]
    kept = {session: voice._envelope(session) for session in sessions[:connected]}
    voice._connections.update(dict.fromkeys(kept, cast(Connection, None)))
    for session in sessions[connected:]:
        voice._envelope(session)
    assert len(voice._envelopes) == max(MAX_ENVELOPES, connected + 1)
    assert all(voice._envelope(session) is envelope for session, envelope in kept.items())


def test_names_that_the_listener_expects_are_bounded() -> None:
    half = "x" * (MAX_NAMES // 2)

    async def test(rig: Rig) -> None:
        rig.listen("commands")
        rig.session._hearing.expect(Names((f"{half}a", "b", f"{half}c"), ("d",), ()))
        [*_, (kind, payload)] = rig.listener.sent
        assert kind is Kind.SETUP
        assert json.loads(payload)["names"] == {"locations": [f"{half}a", "b"], "poses": ["d"], "sequences": []}

    run(test)


def test_sentence_does_not_wait_long_for_names(monkeypatch: pytest.MonkeyPatch) -> None:
    async def wait_for_ever(_: VoiceSession) -> Names:
        await asyncio.Event().wait()
        return Names()

    monkeypatch.setattr(VoiceSession, "read_names", wait_for_ever)
    monkeypatch.setattr(voice_offline, "_NAMES_TIMEOUT_S", 0.01)

    async def test(rig: Rig) -> None:
        replied = asyncio.Event()
        send = rig.session._send

        def note(message: dict[str, Any]) -> None:
            send(message)
            replied.set()

        monkeypatch.setattr(rig.session._offline, "_send", note)
        rig.send(say={"id": "a", "text": "who is there"})
        await asyncio.wait_for(replied.wait(), 20.0)
        rig.session.close()

    assert [reply["id"] for reply in run(test).messages("reply")] == ["a"]


def test_tokens_are_minted_a_few_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    write_key(key_file(), KEY)

    async def test() -> None:
        answered, asked = asyncio.Event(), asyncio.Semaphore(0)

        async def request(*_: Any) -> str:
            asked.release()
            await answered.wait()
            return "a token"

        tokens = VoiceTokens({})
        monkeypatch.setattr(tokens, "_request", request)
        minting = [asyncio.ensure_future(tokens.mint(MODEL)) for _ in range(MAX_MINTING)]
        for _ in minting:
            await asked.acquire()
        with pytest.raises(TokenFailed, match=BUSY):
            await tokens.mint(MODEL)
        answered.set()
        assert await asyncio.gather(*minting, tokens.mint(MODEL)) == ["a token"] * (MAX_MINTING + 1)

    asyncio.run(test())


@pytest.mark.parametrize("excess", [-1000, 1000])
def test_long_answer_of_the_service_is_no_token(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, excess: int) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(voice_token, "_MAX_ANSWER_BYTES", 2000)
    write_key(key_file(), KEY)

    async def answer(_: web.Request) -> web.Response:
        return web.json_response({"name": "a token", "more": "x" * (2000 + excess)})

    async def test() -> str:
        application = web.Application()
        application.router.add_post(TOKEN_PATH, answer)
        runner = web.AppRunner(application, access_log=None)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", 0).start()
        tokens = VoiceTokens({SERVICE_VARIABLE: f"http://127.0.0.1:{runner.addresses[0][1]}"})
        try:
            return await tokens.mint(MODEL)
        except TokenFailed as error:
            return str(error)
        finally:
            await tokens.close()
            await runner.cleanup()

    found = asyncio.run(test())
    assert found == "a token" if excess < 0 else "has no token" in found
