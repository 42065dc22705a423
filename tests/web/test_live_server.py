"""The Live server of tests: the order of messages that it accepts, interruption, resumption, tokens and its grammar."""

from __future__ import annotations

import asyncio
import base64
import json
from collections.abc import Callable, Coroutine
from typing import Any

import aiohttp
import pytest

from tests.support.live_minds import Call, GrammarMind, Mind, Say, ScriptedMind
from tests.support.live_server import HEARD_PATH, KEY, KEY_SOCKET_PATH, QUOTA, LiveServer

SETUP: dict[str, Any] = {
    "model": "models/gemini-3.8-live",
    "realtimeInputConfig": {"automaticActivityDetection": {"disabled": True}},
    "sessionResumption": {},
}
AUDIO = {"realtimeInput": {"audio": {"mimeType": "audio/pcm;rate=16000", "data": base64.b64encode(bytes(1600)).decode()}}}
START: dict[str, Any] = {"realtimeInput": {"activityStart": {}}}
END: dict[str, Any] = {"realtimeInput": {"activityEnd": {}}}


class Client:
    """A client of the server."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self.socket = socket
        self.handle = ""

    async def send(self, *messages: dict[str, Any]) -> None:
        for message in messages:
            await self.socket.send_json(message)

    async def until(self, condition: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
        """Receive until a message fits, and return it."""
        while True:
            received = await self.socket.receive(10)
            assert received.type is aiohttp.WSMsgType.BINARY, (received, self.socket.close_code)
            message: dict[str, Any] = json.loads(received.data)
            self.handle = message.get("sessionResumptionUpdate", {}).get("newHandle", self.handle)
            if condition(message):
                return message

    async def done(self) -> None:
        await self.until(lambda message: message.get("serverContent", {}).get("turnComplete"))
        await self.until(lambda message: "sessionResumptionUpdate" in message)

    async def close_code(self) -> int | None:
        while (await self.socket.receive(10)).type is aiohttp.WSMsgType.BINARY:
            pass
        return self.socket.close_code


def say(text: str) -> dict[str, Any]:
    return {"clientContent": {"turns": [{"role": "user", "parts": [{"text": text}]}], "turnComplete": True}}


def answer(call: dict[str, Any], response: dict[str, Any]) -> dict[str, Any]:
    [made] = call["toolCall"]["functionCalls"]
    return {"toolResponse": {"functionResponses": [{"id": made["id"], "name": made["name"], "response": response}]}}


def is_call(message: dict[str, Any]) -> bool:
    return "toolCall" in message


Steps = Callable[[LiveServer, Callable[..., Coroutine[Any, Any, Client]]], Coroutine[Any, Any, None]]


def play(steps: Steps, make_mind: Callable[[], Mind] = GrammarMind, heard: tuple[str, ...] = ()) -> LiveServer:
    """Run steps with a server and a function that opens connections to it."""

    async def run() -> LiveServer:
        server = LiveServer(make_mind, heard)
        url = await server.start()
        async with aiohttp.ClientSession() as http:

            async def connect(setup: dict[str, Any] | None = SETUP, key: str = KEY) -> Client:
                client = Client(await http.ws_connect(f"{url}{KEY_SOCKET_PATH}?key={key}"))
                if setup is not None:
                    await client.send({"setup": setup})
                return client

            try:
                await steps(server, connect)
            finally:
                await server.stop()
        return server

    return asyncio.run(asyncio.wait_for(run(), 30))


def test_turn_in_speech_is_heard_called_and_answered() -> None:
    async def steps(_: LiveServer, connect: Any) -> None:
        client = await connect()
        await client.until(lambda message: "setupComplete" in message)
        await client.send(AUDIO, START, AUDIO, AUDIO, END)
        heard = await client.until(lambda message: "inputTranscription" in message.get("serverContent", {}))
        assert heard["serverContent"]["inputTranscription"]["text"] == "where are you"
        call = await client.until(is_call)
        assert call["toolCall"]["functionCalls"][0]["name"] == "query_state"
        await client.send(answer(call, {"ok": True}))
        sound = await client.until(lambda message: message.get("serverContent", {}).get("modelTurn", {}).get("parts"))
        assert sound["serverContent"]["modelTurn"]["parts"][0]["inlineData"]["mimeType"] == "audio/pcm;rate=24000"
        await client.done()

    server = play(steps, heard=("where are you",))
    assert [len(each) for each in server.conversations[0].utterances] == [3200]


def test_posted_sentences_are_heard_next() -> None:
    async def steps(server: LiveServer, connect: Any) -> None:
        async with aiohttp.ClientSession() as http:
            (await http.post(f"{server.url}{HEARD_PATH}", json=["what is the battery", "yes"])).raise_for_status()
        client = await connect()
        await client.send(START, END)
        call = await client.until(is_call)
        assert call["toolCall"]["functionCalls"][0]["args"] == {"fields": ["battery"]}
        await client.send(answer(call, {"ok": True, "battery": {"voltage": 12.04, "percentage": 0.9}}))
        await client.done()

    server = play(steps, heard=("lights blue",))
    assert server.conversations[0].turns == ["what is the battery"] and server.transcribe() == "yes"


def test_mind_says_the_number_of_the_battery() -> None:
    said = GrammarMind().answer("what is the battery")
    assert next(said) == Call("query_state", {"fields": ["battery"]})
    response = {"ok": True, "battery": {"voltage": 12.04, "percentage": 0.9}}
    assert said.send(response) == Say("The battery is at 90 percent, 12.0 volts.")


@pytest.mark.parametrize(
    ("sentence", "call"),
    [
        ("save here as sink", Call("save_named_location", {"name": "sink"})),
        ("run the sequence water", Call("arm_run_sequence", {"name": "water"})),
    ],
)
def test_mind_calls_with_the_name_that_was_said(sentence: str, call: Call) -> None:
    assert next(GrammarMind().answer(sentence)) == call


@pytest.mark.parametrize(
    "messages",
    [
        [say("hello")],
        [{"setup": {**SETUP, "realtimeInputConfig": {}}}],
        [{"setup": SETUP}, END],
        [{"setup": SETUP}, START, START],
        [{"setup": SETUP}, {"setup": SETUP}],
        [{"setup": SETUP}, {"toolResponse": {"functionResponses": [{"id": "1", "response": {}}]}}],
        [{"setup": SETUP}, START, {"realtimeInput": {"audio": {"mimeType": "audio/pcm;rate=48000", "data": "AAA="}}}],
        [{"setup": {**SETUP, "sessionResumption": {"handle": "unknown"}}}],
    ],
)
def test_message_out_of_order_closes_the_connection(messages: list[dict[str, Any]]) -> None:
    async def steps(_: LiveServer, connect: Any) -> None:
        client = await connect(None)
        await client.send(*messages)
        assert await client.close_code() == 1007

    play(steps)


def test_interruption_cancels_the_call_and_the_answer() -> None:
    async def steps(_: LiveServer, connect: Any) -> None:
        client = await connect()
        await client.send(say("where are you"))
        call = await client.until(is_call)
        await client.send(START)
        cancelled = await client.until(lambda message: "toolCallCancellation" in message)
        assert cancelled["toolCallCancellation"]["ids"] == [call["toolCall"]["functionCalls"][0]["id"]]
        await client.until(lambda message: message.get("serverContent", {}).get("interrupted"))

    assert play(steps).conversations[0].interruptions == 1


def test_conversation_goes_on_by_its_handle() -> None:
    async def steps(server: LiveServer, connect: Any) -> None:
        client = await connect()
        await client.send(say("hello"))
        await client.done()
        await server.announce_end(9.5)
        assert (await client.until(lambda message: "goAway" in message))["goAway"] == {"timeLeft": "9.5s"}
        again = await connect({**SETUP, "sessionResumption": {"handle": client.handle}})
        await again.send(say("again"))
        await again.done()

    mind = ScriptedMind([Say("One")], [Say("Two")])
    server = play(steps, lambda: mind)
    assert len(server.conversations) == 1 and mind.heard == ["hello", "again"]


def test_read_back_is_confirmed_in_the_next_turn_only() -> None:
    async def steps(_: LiveServer, connect: Any) -> None:
        client = await connect()
        for reply, token in (("yes", "abcd"), ("no", None)):
            await client.send(say("go to the dock"))
            await client.send(answer(await client.until(is_call), {"ok": False, "confirm": "go there", "confirmation": "abcd"}))
            await client.done()
            await client.send(say(reply))
            if token is not None:
                call = await client.until(is_call)
                assert call["toolCall"]["functionCalls"][0]["args"] == {"name": "the dock", "confirmation": token}
                await client.send(answer(call, {"ok": True}))
            await client.done()

    assert len(play(steps).conversations[0].responses) == 3


def test_limits_and_bad_keys_close_with_a_reason() -> None:
    async def steps(server: LiveServer, connect: Any) -> None:
        server.refuse_next(*QUOTA)
        assert await (await connect()).close_code() == 1011
        assert await (await connect(key="another")).close_code() == 1007
        assert await (await connect({**SETUP, "model": "models/unknown"})).close_code() == 1008

    play(steps)


def test_scripted_mind_repeats_its_last_turn() -> None:
    mind = ScriptedMind([Call("stop")], [Say("Yes.")])
    assert list(mind.answer("a")) == [Call("stop")]
    assert list(mind.answer("b")) == list(mind.answer("c")) == [Say("Yes.")]
