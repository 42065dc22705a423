"""A console for its clients: it pairs them by a code, and answers each call of the voice agent; tests change what it does."""

from __future__ import annotations

import asyncio
import functools
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web

from lupin_runtime.console.certificate import CertificateStore, ServerCertificate
from lupin_runtime.console.dual_port import DualPort
from lupin_runtime.console.runner import Runner
from lupin_runtime.json_text import parse_json

CODE = "K7Q2MXPA"
COOKIE = "lupin_session=abcdefgh-1234"


class FakeConsole:
    """Serves on 127.0.0.1. `answers` has by path the status and the text of an answer in place of the usual one; 0: none."""

    port: int

    def __init__(self) -> None:
        self.answers: dict[str, tuple[int, str]] = {}
        self.requests: list[tuple[str, str, Any]] = []  # path, cookie and body
        self.cookies: set[str] = set()
        self.root = ""
        self.voice: Callable[[web.WebSocketResponse, dict[str, Any]], Awaitable[None]] = answer_calls

    def application(self) -> web.Application:
        """Return the routes."""
        application = web.Application(middlewares=[self._note])
        application.router.add_get("/authority.crt", self._send_root)
        application.router.add_get("/_api/session", self._session)
        application.router.add_post("/_api/pair", self._pair)
        application.router.add_get("/_api/voice", self._serve_voice)
        return application

    @web.middleware
    async def _note(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        self.requests.append((request.path, request.headers.get("Cookie", ""), await request.text()))
        if request.path in self.answers:
            status, text = self.answers[request.path]
            if status == 0:
                await asyncio.sleep(3600.0)
            return web.Response(status=status, text=text)
        return await handler(request)

    async def _send_root(self, _: web.Request) -> web.StreamResponse:
        return web.Response(text=self.root)

    async def _session(self, request: web.Request) -> web.StreamResponse:
        is_paired = request.headers.get("Cookie", "") in self.cookies
        described = {"name": "computer-1", "role": "operator"} if is_paired else None
        return web.json_response({"session": described, "control": {}, "stop": []})

    async def _pair(self, request: web.Request) -> web.StreamResponse:
        if (await request.json(loads=parse_json))["code"].replace("-", "").upper() != CODE:
            return web.json_response({"error": "this code is wrong"}, status=403)
        self.cookies.add(COOKIE)
        headers = {"Set-Cookie": f"{COOKIE}; HttpOnly; Secure"}
        return web.json_response({"name": "computer-1", "role": "operator"}, headers=headers)

    async def _serve_voice(self, request: web.Request) -> web.StreamResponse:
        if request.secure and request.headers.get("Cookie", "") not in self.cookies:
            return web.json_response({"error": "not paired"}, status=401)
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        await socket.send_json({"state": {"speed_cap": 1.0, "is_driving": False, "waiting": 0}})
        async for message in socket:
            if message.type is WSMsgType.TEXT:
                await self.voice(socket, parse_json(message.data))
        return socket


async def answer_calls(socket: web.WebSocketResponse, message: dict[str, Any]) -> None:
    """Answer a call as one that was done."""
    if "call" in message:
        call = message["call"]
        await socket.send_json({"result": {"id": call["id"], "name": call["name"], "response": {"ok": True}}})


@contextmanager
def serve_console(folder: Path, *, tls: bool = True, store: CertificateStore | None = None) -> Iterator[FakeConsole]:
    """Serve a console whose certificates are in a folder."""
    console = FakeConsole()
    certificate = ServerCertificate(store or CertificateStore(folder)) if tls else None
    if certificate is not None:
        console.root = certificate.store.root_path.read_text()
    ends: list[Callable[[], object]] = []
    ready = threading.Event()

    async def main() -> None:
        ended = asyncio.Event()
        ends.append(functools.partial(asyncio.get_running_loop().call_soon_threadsafe, ended.set))
        runner = Runner(console.application(), shutdown_timeout=0.2)
        await runner.setup()
        assert runner.server is not None
        port = DualPort(runner.server, certificate.context if certificate else None)
        console.port = port.open("127.0.0.1", 0)
        ready.set()
        await ended.wait()
        await port.close()
        await runner.cleanup()

    thread = threading.Thread(target=lambda: asyncio.run(main()), name="fake-console")
    thread.start()
    try:
        assert ready.wait(60)
        yield console
    finally:
        for end in ends:
            end()
        thread.join()
