"""The connection to a console ends a session at once when it is lost, and says what to type; its waits are bounded."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from aiohttp import web

from lupin_cli.run import voice_connection, voice_session
from lupin_cli.run.voice_connection import ConnectionLost, Console, connect
from lupin_cli.run.voice_session import Options, run_session
from lupin_runtime.voice.dialog import Turn
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.speech import SpeechUnavailable
from tests.support.fake_console import FakeConsole, answer_calls, serve_console

AGAIN = "connect again with: lupin voice --console robot"


@pytest.fixture
def served(tmp_path: Path) -> Iterator[FakeConsole]:
    with serve_console(tmp_path, tls=False) as console:
        yield console


def at(served: FakeConsole) -> Console:
    return Console(f"http://127.0.0.1:{served.port}", next_step=AGAIN)


def run(served: FakeConsole, sentence: str | None = None) -> bool:
    return run_session(Options(sentence, True, None, ENGLISH, False, False, at(served)))


def test_sentence_is_done(served: FakeConsole) -> None:
    assert run(served, "lights blue")


@pytest.mark.parametrize(
    ("status", "message"),
    [
        (401, "does not know this computer any more; connect again with"),
        (404, "has no voice service .404.; it may be of another version; compare here and there: lupin --version"),
        (503, "serves no more clients, or cannot read its files"),
    ],
)
def test_refused_connection_says_why(served: FakeConsole, status: int, message: str) -> None:
    served.answers["/_api/voice"] = (status, "no")
    with pytest.raises(ConnectionLost, match=message):
        run(served, "stop")


def test_wait_for_the_voice_service_is_bounded(served: FakeConsole, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(voice_connection, "CONNECT_TIMEOUT_S", 0.5)
    served.answers["/_api/voice"] = (0, "")
    with pytest.raises(ConnectionLost, match=f"no answer of the voice service at http://127.0.0.1:{served.port}; {AGAIN}"):
        run(served, "stop")


@pytest.mark.parametrize(
    ("message", "problem"),
    [
        ({"error": "unknown message"}, "it answers: unknown message"),
        ({"state": 5}, "TypeError"),
        ({"result": {"name": "x"}}, "KeyError"),
        ([1], "AttributeError"),
    ],
)
def test_console_of_another_version_is_named(served: FakeConsole, message: Any, problem: str) -> None:
    async def answer(socket: web.WebSocketResponse, _: dict[str, Any]) -> None:
        await socket.send_json(message)

    served.voice = answer
    with pytest.raises(ConnectionLost, match=f"{problem}.*compare here and there: lupin --version"):
        run(served, "lights blue")


def test_reason_of_the_console_is_shown(served: FakeConsole) -> None:
    async def close(socket: web.WebSocketResponse, _: dict[str, Any]) -> None:
        await socket.close(code=1008, message=b"this browser is no longer paired")

    served.voice = close
    with pytest.raises(ConnectionLost, match=f"the console closed the connection: this browser is no longer paired; {AGAIN}"):
        run(served, "lights blue")


class Silence:
    """A source of sentences from which none comes any more."""

    def __init__(self, *sentences: str) -> None:
        self.sentences = sentences

    async def __call__(self, *_: object) -> Any:
        for number, sentence in enumerate(self.sentences):
            yield Turn(sentence, "text", str(number))
        await asyncio.sleep(3600.0)


def test_lost_link_ends_a_session_in_which_nobody_speaks(served: FakeConsole, monkeypatch: pytest.MonkeyPatch) -> None:
    async def vanish(socket: web.WebSocketResponse, message: dict[str, Any]) -> None:
        if message.get("call", {}).get("name") == "set_light":
            assert socket._req is not None and socket._req.transport is not None
            socket._req.transport.abort()
        else:
            await answer_calls(socket, message)

    served.voice = vanish
    monkeypatch.setattr(voice_session, "read_lines", Silence("lights blue"))
    with pytest.raises(ConnectionLost, match=f"the connection to the console is lost.*; {AGAIN}"):
        run(served)


def test_lost_microphone_ends_control_before_all_else(served: FakeConsole, monkeypatch: pytest.MonkeyPatch) -> None:
    called, order = asyncio.Event(), list[str]()

    async def never_answer(socket: web.WebSocketResponse, message: dict[str, Any]) -> None:
        if message.get("call", {}).get("name") == "set_light":
            called.set()
        else:
            await answer_calls(socket, message)

    async def lose(*_: object) -> Any:
        yield Turn("lights blue", "speech", "1")
        while not called.is_set():
            await asyncio.sleep(0.01)
        raise SpeechUnavailable("the microphone is lost")

    def source(_: Any, stack: Any) -> Any:
        stack.callback(order.append, "microphone closed")
        return lose()

    async def close(connection: Any) -> Any:
        order.append("connection closed")
        return await real_close(connection)

    from aiohttp import ClientWebSocketResponse

    real_close = ClientWebSocketResponse.close
    monkeypatch.setattr(ClientWebSocketResponse, "close", close)
    monkeypatch.setattr(voice_session._Session, "_source", source)
    served.voice = never_answer
    with pytest.raises(SpeechUnavailable, match="the microphone is lost"):
        run(served)  # although a call waits for its answer
    assert order == ["connection closed", "microphone closed"]


def test_loss_while_a_call_waits_is_raised(served: FakeConsole) -> None:
    async def test() -> None:
        async with connect(at(served)) as connection:
            call = asyncio.ensure_future(connection.call("set_light", {}))
            with pytest.raises(ConnectionLost, match=AGAIN):
                await call

    async def close(socket: web.WebSocketResponse, _: dict[str, Any]) -> None:
        await socket.close()

    served.voice = close
    asyncio.run(test())
