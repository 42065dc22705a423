"""A server on this computer that speaks the protocol of the Live API (https://ai.google.dev/api/live), for tests.

    python -m tests.support.live_server --port 8765 --heard "where are you"

It does not recognize speech: what an utterance means is the next of the given sentences, or of those that were posted since, to
`/heard` as a JSON list. It is strict where the service is: an order of messages that the service refuses with 1007 is refused
here too.
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import contextlib
import math
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from aiohttp import WSMsgType, web

from lupin_runtime.console.voice_token import SOCKET_PATH, TOKEN_PATH
from lupin_runtime.json_text import parse_json
from tests.support.live_minds import Answer, Call, GrammarMind, Mind

KEY = "a-made-up-key-for-tests-0123456789"
MODELS = ("models/gemini-3.1-flash-live-preview", "models/gemini-3.8-live")
HEARD_PATH = "/heard"
KEY_SOCKET_PATH = "/ws/google.ai.generativelanguage.v1beta.GenerativeService.BidiGenerateContent"
QUOTA = (1011, "You exceeded your current quota, please check your plan and billing details.")
_RATE_HZ = 24_000
_TONE_S = 0.4
_MAX_AUDIO_BYTES = 64_000


class Refusal(Exception):
    """The connection is closed with a code and a reason."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code, self.reason = code, reason


@dataclass
class Conversation:
    """What outlasts a connection: the mind, and what happened."""

    mind: Mind
    utterances: list[bytes] = field(default_factory=list)  # the audio of each turn in speech
    turns: list[str] = field(default_factory=list)
    responses: list[dict[str, Any]] = field(default_factory=list)
    interruptions: int = 0


@dataclass
class _Token:
    model: str
    expires_s: float
    uses: int = 1


class LiveServer:
    """The server. `make_mind` makes the mind of each conversation; `heard` are the sentences of the utterances in speech."""

    def __init__(self, make_mind: Callable[[], Mind] = GrammarMind, heard: Sequence[str] = ()) -> None:
        self._make_mind = make_mind
        self._heard = list(heard)
        self._tokens: dict[str, _Token] = {}
        self._handles: dict[str, Conversation] = {}
        self._connections: list[_Connection] = []
        self._refusals: list[tuple[int, str]] = []  # of the next connections
        self.conversations: list[Conversation] = []
        self.setups: list[dict[str, Any]] = []
        self.key_status = 200  # of the next requests for a token
        self._runner: web.AppRunner | None = None
        self.url = ""

    async def start(self, port: int = 0) -> str:
        """Listen on this computer, and return the address."""
        application = web.Application()
        application.router.add_post(TOKEN_PATH, self._mint)
        application.router.add_post(HEARD_PATH, self._replace_heard)
        application.router.add_get(SOCKET_PATH, self._serve)
        application.router.add_get(KEY_SOCKET_PATH, self._serve)
        self._runner = web.AppRunner(application, access_log=None, shutdown_timeout=0.2)
        await self._runner.setup()
        await web.TCPSite(self._runner, "127.0.0.1", port).start()
        self.url = f"http://127.0.0.1:{self._runner.addresses[0][1]}"
        return self.url

    async def stop(self) -> None:
        """Close all connections."""
        if self._runner is not None:
            await self._runner.cleanup()

    def refuse_next(self, code: int, reason: str) -> None:
        """Close the next connection after its setup."""
        self._refusals.append((code, reason))

    async def announce_end(self, time_left_s: float) -> None:
        """Announce to all connections that they end."""
        for connection in self._connections:
            await connection.send({"goAway": {"timeLeft": f"{time_left_s:g}s"}})

    async def end(self, code: int, reason: str) -> None:
        """Close all connections."""
        for connection in list(self._connections):
            await connection.close(code, reason)

    # -- tokens -------------------------------------------------------------------------------------------------------
    async def _mint(self, request: web.Request) -> web.Response:
        if self.key_status != 200 or request.headers.get("x-goog-api-key") != KEY:
            status = self.key_status if self.key_status != 200 else 400
            return web.json_response(
                {"error": {"code": status, "message": "API key not valid. Please pass one."}}, status=status
            )
        body = parse_json(await request.text())
        token = f"auth_tokens/{len(self._tokens)}"
        self._tokens[token] = _Token(body["bidiGenerateContentSetup"]["model"], time.monotonic() + 60.0, body["uses"])
        return web.json_response({"name": token})

    def check_token(self, token: str, setup: dict[str, Any]) -> None:
        """Use a token for a connection. Raises Refusal."""
        found = self._tokens.get(token)
        if found is None or time.monotonic() > found.expires_s:
            raise Refusal(1008, "token has expired or is invalid")
        if not setup.get("sessionResumption", {}).get("handle"):
            found.uses -= 1
            if found.uses < 0:
                raise Refusal(1008, "token was used before")
        if setup["model"] != found.model:
            raise Refusal(1008, "the token is for another model")

    async def _replace_heard(self, request: web.Request) -> web.Response:
        self._heard = [str(sentence) for sentence in parse_json(await request.text())]
        return web.Response()

    # -- conversations ------------------------------------------------------------------------------------------------
    async def _serve(self, request: web.Request) -> web.StreamResponse:
        socket = web.WebSocketResponse(max_msg_size=1 << 20)
        await socket.prepare(request)
        connection = _Connection(self, socket)
        self._connections.append(connection)
        try:
            await connection.serve(request.query.get("key"), request.query.get("access_token", ""))
        except Refusal as refusal:
            await connection.close(refusal.code, refusal.reason)
        finally:
            self._connections.remove(connection)
            connection.cancel()
        return socket

    def begin(self, setup: dict[str, Any], key: str | None, token: str) -> Conversation:
        """Return the conversation of a new connection. Raises Refusal."""
        self.setups.append(setup)
        if setup.get("model") not in MODELS:
            raise Refusal(1008, f"{setup.get('model')} is not found for API version v1alpha, or is no model for this")
        if key is None:
            self.check_token(token, setup)
        elif key != KEY:
            raise Refusal(1007, "API key not valid. Please pass a valid API key.")
        if self._refusals:
            raise Refusal(*self._refusals.pop(0))
        handle = setup.get("sessionResumption", {}).get("handle")
        if handle is None:
            self.conversations.append(Conversation(self._make_mind()))
            return self.conversations[-1]
        if handle not in self._handles:
            raise Refusal(1007, "Request contains an invalid argument.")
        return self._handles[handle]

    def new_handle(self, conversation: Conversation) -> str:
        """Return a handle by which another connection goes on with a conversation."""
        handle = f"handle-{len(self._handles)}"
        self._handles[handle] = conversation
        return handle

    def transcribe(self) -> str:
        """Return what the next utterance means."""
        return self._heard.pop(0) if self._heard else ""


class _Connection:
    """One connection of a client."""

    def __init__(self, server: LiveServer, socket: web.WebSocketResponse) -> None:
        self._server = server
        self._socket = socket
        self._conversation: Conversation | None = None
        self._speech: bytearray | None = None  # of the utterance that goes on
        self._answer: asyncio.Task[None] | None = None
        self._pending: dict[str, asyncio.Future[dict[str, Any]]] = {}
        self._calls = 0

    async def serve(self, key: str | None, token: str) -> None:
        """Handle messages until the client is gone. Raises Refusal."""
        async for message in self._socket:
            if message.type not in (WSMsgType.TEXT, WSMsgType.BINARY):
                continue
            try:
                content = parse_json(message.data)
            except ValueError:
                raise Refusal(1007, "invalid JSON payload received") from None
            if self._conversation is None:
                if "setup" not in content:
                    raise Refusal(1007, "setup must be the first message and only the first")
                await self._begin(content["setup"], key, token)
            else:
                await self._handle(self._conversation, content)

    async def _begin(self, setup: dict[str, Any], key: str | None, token: str) -> None:
        if not setup.get("realtimeInputConfig", {}).get("automaticActivityDetection", {}).get("disabled"):
            raise Refusal(1007, "this server detects no speech: automaticActivityDetection must be disabled")
        self._conversation = self._server.begin(setup, key, token)
        await self.send({"setupComplete": {}})
        await self._renew_handle(self._conversation)

    async def _renew_handle(self, conversation: Conversation) -> None:
        handle = self._server.new_handle(conversation)
        await self.send({"sessionResumptionUpdate": {"newHandle": handle, "resumable": True}})

    async def _handle(self, conversation: Conversation, content: dict[str, Any]) -> None:
        if "realtimeInput" in content:
            await self._hear(conversation, content["realtimeInput"])
        elif "clientContent" in content:
            await self._interrupt(conversation)
            turns = content["clientContent"]["turns"]
            if content["clientContent"].get("turnComplete"):
                self._begin_answer(conversation, turns[-1]["parts"][0]["text"])
        elif "toolResponse" in content:
            for response in content["toolResponse"]["functionResponses"]:
                pending = self._pending.pop(response["id"], None)
                if pending is None:
                    raise Refusal(1007, f"there is no function call {response['id']}")
                conversation.responses.append(response)
                pending.set_result(response["response"])
        else:
            raise Refusal(1007, "setup must be the first message and only the first")

    async def _hear(self, conversation: Conversation, content: dict[str, Any]) -> None:
        if "activityStart" in content:
            if self._speech is not None:
                raise Refusal(1007, "activityStart in an activity")
            self._speech = bytearray()
            await self._interrupt(conversation)
        elif "activityEnd" in content:
            if self._speech is None:
                raise Refusal(1007, "activityEnd without activityStart")
            conversation.utterances.append(bytes(self._speech))
            self._speech = None
            heard = self._server.transcribe()
            await self.send({"serverContent": {"inputTranscription": {"text": heard}}})
            self._begin_answer(conversation, heard)
        elif "audio" in content:
            audio = base64.b64decode(content["audio"]["data"], validate=True)
            if content["audio"]["mimeType"] != "audio/pcm;rate=16000" or len(audio) % 2 or len(audio) > _MAX_AUDIO_BYTES:
                raise Refusal(1007, "audio must be PCM of 16 bits at 16 kHz")
            if self._speech is not None:
                self._speech += audio

    # -- answers ------------------------------------------------------------------------------------------------------
    def _begin_answer(self, conversation: Conversation, heard: str) -> None:
        conversation.turns.append(heard)
        self._answer = asyncio.ensure_future(self._carry_out(conversation, conversation.mind.answer(heard)))

    async def _carry_out(self, conversation: Conversation, answer: Answer) -> None:
        response: dict[str, Any] = {}
        with contextlib.suppress(StopIteration):
            action = next(answer)
            while True:
                if isinstance(action, Call):
                    response = await self._call(action)
                else:
                    await self._say(action.text)
                action = answer.send(response)
        await self.send({"serverContent": {"turnComplete": True}})
        await self._renew_handle(conversation)

    async def _call(self, call: Call) -> dict[str, Any]:
        self._calls += 1
        identifier = f"call-{id(self)}-{self._calls}"
        self._pending[identifier] = asyncio.get_running_loop().create_future()
        await self.send({"toolCall": {"functionCalls": [{"id": identifier, "name": call.name, "args": call.arguments}]}})
        return await self._pending[identifier]

    async def _say(self, text: str) -> None:
        data = base64.b64encode(tone(_TONE_S)).decode()
        parts = [{"inlineData": {"mimeType": f"audio/pcm;rate={_RATE_HZ}", "data": data}}]
        for word in text.split():
            await self.send({"serverContent": {"modelTurn": {"parts": parts}, "outputTranscription": {"text": f"{word} "}}})
            parts = []
            await asyncio.sleep(0.02)  # so that an interruption may come between two words

    async def _interrupt(self, conversation: Conversation) -> None:
        if self._answer is None or self._answer.done():
            return
        self.cancel()
        conversation.interruptions += 1
        if self._pending:
            await self.send({"toolCallCancellation": {"ids": list(self._pending)}})
            self._pending.clear()
        await self.send({"serverContent": {"interrupted": True}})

    def cancel(self) -> None:
        """Drop the answer."""
        if self._answer is not None:
            self._answer.cancel()

    async def send(self, message: dict[str, Any]) -> None:
        """Send a message, as bytes like the service."""
        with contextlib.suppress(ConnectionError):
            await self._socket.send_bytes(web.json_response(message).body or b"")  # type: ignore[arg-type]

    async def close(self, code: int, reason: str) -> None:
        """Close the connection from this end."""
        self.cancel()
        await self._socket.close(code=code, message=reason.encode())


def tone(seconds: float, frequency_hz: float = 330.0) -> bytes:
    """Return a soft tone as PCM of 16 bits at 24 kHz."""
    count = int(_RATE_HZ * seconds)
    samples = (round(3000 * math.sin(2 * math.pi * frequency_hz * each / _RATE_HZ)) for each in range(count))
    return struct.pack(f"<{count}h", *samples)


async def _run(port: int, heard: Sequence[str]) -> None:
    server = LiveServer(heard=heard)
    print(await server.start(port), flush=True)
    await asyncio.Event().wait()


def main() -> None:
    """Serve until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--heard", action="append", default=[], help="what the next utterance in speech means")
    arguments = parser.parse_args()
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_run(arguments.port, arguments.heard))


if __name__ == "__main__":
    main()
