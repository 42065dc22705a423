"""Port 8090, the one origin for browsers: the page, rosbridge at `/_ros`, video at `/_video` and the API at `/_api`.

Only paired browsers are served. A browser on this computer is paired automatically.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aiohttp import WSCloseCode, web

from lupin_runtime.atomic_file import MalformedFile
from lupin_runtime.console import run_files
from lupin_runtime.console.api_table import SESSION, Handler, Resource, add_resources, json_object
from lupin_runtime.console.approaches import Approaches
from lupin_runtime.console.authority import Refused, Role, Session
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.connection import Connection, Connections, Handoff
from lupin_runtime.console.control_resources import ControlResources
from lupin_runtime.console.description import network_urls, serves_only_this_computer, spoken
from lupin_runtime.console.doctor import Doctor, DoctorError
from lupin_runtime.console.doctor_resources import DoctorResources
from lupin_runtime.console.events import EventChannel
from lupin_runtime.console.maps import Maps
from lupin_runtime.console.page_files import KEEP_FOREVER, add_page_files, index_response, is_asset, page_version
from lupin_runtime.console.pairing import PairingCodes
from lupin_runtime.console.plays import Plays
from lupin_runtime.console.program import LupinProgram
from lupin_runtime.console.request_rules import (
    check_encryption,
    check_host,
    check_origin,
    device_kind,
    is_loopback,
    opens_page,
)
from lupin_runtime.console.rewind import Rewind
from lupin_runtime.console.rosbridge import RosbridgeClient
from lupin_runtime.console.sessions import SESSION_LIFETIME_S, Sessions
from lupin_runtime.console.settings import settings_file, stored_settings
from lupin_runtime.console.shared_data import SharedData
from lupin_runtime.console.video import VideoRelay
from lupin_runtime.console.voice_token import VoiceTokens
from lupin_runtime.stack.runs import Run

if TYPE_CHECKING:
    from lupin_runtime.console.voice import VoiceAgents

COOKIE = "lupin_session"
MAX_CLIENTS = 256
LOCAL_SESSION = Session("this computer", Role.OPERATOR)  # the session of programs on it, which keep no cookie
_ROOT_CERTIFICATE_PATH = "/authority.crt"
_WRONG_CODE_PAUSE_S = 1.0
_CLOSE_TIMEOUT_S = 1.0
_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; connect-src 'self' ws: wss:; frame-ancestors 'none'; base-uri 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


class Unpaired(Exception):
    """A request from a browser that is not paired."""


class Origin:
    """The routes of port 8090. Used on the event loop only."""

    def __init__(
        self,
        bridge: Bridge,
        handoff: Handoff,
        connections: Connections,
        sessions: Sessions,
        codes: PairingCodes,
        doctor_command: Sequence[str],
        video_target: str,
        run: Run,
        overrides_file: Path,
        host: str,
        root_certificate: Path | None = None,
    ) -> None:
        """`run` is the run that browsers see; `overrides_file` has the approach overrides of its mission. `host` is what the
        server listens on.

        `root_certificate` is the file that devices install; with one, browsers on other computers are sent to HTTPS."""
        program = LupinProgram(doctor_command)
        self.doctor = Doctor(program, lambda state: self._events.push("doctor", state))
        self._plays = Plays(program)
        self.video = VideoRelay(video_target, self._is_paired)
        self._bridge = bridge
        self._host = host
        self._root_certificate = root_certificate
        self._handoff = handoff
        self._connections = connections
        self._sessions = sessions
        self._codes = codes
        self._events = EventChannel()
        self._control = ControlResources(bridge, self.push_state)
        self._shared = SharedData(bridge, self._events, self._apply_settings)
        self._maps = Maps(bridge, run)
        self._approaches = Approaches(bridge, self._events, overrides_file)
        self._rewind = Rewind()
        self._settings: Mapping[str, Any] = {}  # those that were changed
        self._voice: VoiceAgents | None = None
        self.voice_tokens = VoiceTokens()
        self._open: dict[Connection, Session] = {}
        self._open_paths: set[str] = set()
        self._rosbridge_count = 0  # connections so far
        bridge.authority.on_change(self.push_state)
        bridge.history.on_event(lambda event: self._events.push("event", event))

    def application(self) -> web.Application:
        """Return the aiohttp application with all routes."""
        application = web.Application(middlewares=[self._guard])
        application.on_startup.append(self._apply_stored_settings)
        application.router.add_get("/", self._page)
        add_page_files(application)
        application.router.add_get("/_ros", self.serve_rosbridge)
        application.router.add_get(_ROOT_CERTIFICATE_PATH, self._send_root_certificate)
        resources = (
            Resource(
                "/_api/session",
                self._session,
                "This browser's session, who has control, why clients stop the robot, and the version of the page.",
                open=True,
            ),
            Resource("/_api/pair", self._pair, "Pair this browser with a code.", {"code": {"type": "string"}}, open=True),
            Resource(
                "/_api/access",
                self._access,
                "The page's URLs for other devices; for operators on this computer also the codes that pair one browser each.",
            ),
            Resource(
                "/_api/events",
                self._listen,
                "Who is connected; changes of control, stop, run, doctor, locations, approaches, settings; events (WebSocket).",
            ),
            Resource("/_api/voice", self._serve_voice, "The tools of the voice agent (WebSocket)."),
        )
        self._open_paths = {"/", _ROOT_CERTIFICATE_PATH, *(resource.path for resource in resources if resource.open)}
        add_resources(
            application,
            (
                *resources,
                *self._control.resources(),
                *run_files.resources(),
                *DoctorResources(self.doctor, self._bridge).resources(),
                *self._bridge.history.resources(),
                *self._rewind.resources(),
                *self._approaches.resources(),
                *self._maps.resources(),
                *self._shared.resources(),
                *self._plays.resources(),
                *self.voice_tokens.resources(),
                *self.video.resources(),
            ),
        )
        return application

    def push_state(self) -> None:
        """Push control, stop and who is connected to all browsers. To be called on changes and twice a second."""
        self._events.push("control", self._control.state())
        self._events.push("browsers", self._browsers())
        self._events.push("stop", self._bridge.manual.stops())

    def push_run(self, state: dict[str, Any]) -> None:
        """Push the state of the run (its stages, alarms and mission) to all browsers if it has changed."""
        self._events.push("run", state)

    def close_revoked(self) -> None:
        """Disconnect browsers whose pairing was revoked. To be called twice a second."""
        for connection, session in list(self._open.items()):
            if session is not LOCAL_SESSION and not self._sessions.is_valid(session):
                del self._open[connection]
                self._bridge.record(session.name, "pairing revoked")
                reason = b"this browser is no longer paired"
                task = asyncio.ensure_future(connection.close(WSCloseCode.POLICY_VIOLATION, reason, _CLOSE_TIMEOUT_S))
                task.add_done_callback(lambda done: done.exception())

    # -- access -------------------------------------------------------------------------------------------------------
    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        check_host(request)
        check_origin(request)
        if self._root_certificate is not None:
            check_encryption(request)
        session = None
        try:
            session = self.find_session(request)
            if session is None and is_loopback(request):
                session = LOCAL_SESSION
            if session is not None:
                request[SESSION] = session
            elif request.path not in self._open_paths and not request.path.startswith("/page/"):
                raise Unpaired
            response = await handler(request)
        except Unpaired:
            text = "this browser is not paired; open the page / and type the code that the terminal shows"
            response = web.json_response({"error": text}, status=401)
        except Refused as refusal:
            self._bridge.record(session.name if session else f"{request.remote}", request.path, refused=str(refusal))
            response = web.json_response({"error": str(refusal)}, status=403)
        except DoctorError as error:
            response = web.json_response({"error": str(error)}, status=409)
        except (MalformedFile, OSError) as error:  # from the files of paired browsers, locations or settings
            response = web.json_response({"error": str(error)}, status=503)
        if not response.prepared:
            if is_asset(request.path):
                response.headers.setdefault("Cache-Control", KEEP_FOREVER)
            for name, value in _HEADERS.items():
                response.headers.setdefault(name, value)
        return response

    def find_session(self, request: web.Request) -> Session | None:
        """Return the session that the cookie of a request names; None if there is none."""
        token = request.cookies.get(COOKIE, "")
        session = self._sessions.find(token)
        if session is not None and self._sessions.is_use_due(token):
            future = asyncio.ensure_future(asyncio.to_thread(self._sessions.note_use, token))
            # An error, for example of a full disk, is ignored: it must not keep the browser out.
            future.add_done_callback(lambda done: done.cancelled() or done.exception())
        return session

    # -- the page -----------------------------------------------------------------------------------------------------
    async def _page(self, request: web.Request) -> web.StreamResponse:
        response = index_response()
        if request.get(SESSION) is LOCAL_SESSION and opens_page(request):
            _, token = await self._pair_browser(request, Role.OPERATOR, by_itself=True)
            _set_cookie(request, response, token)
        return response

    async def _send_root_certificate(self, _: web.Request) -> web.StreamResponse:
        """Send the public certificate that a phone installs to trust this server."""
        if self._root_certificate is None or not self._root_certificate.is_file():
            raise web.HTTPNotFound(text="this console has no certificate\n")
        response = web.FileResponse(self._root_certificate)
        response.content_type = "application/x-x509-ca-cert"
        return response

    async def _pair(self, request: web.Request) -> web.StreamResponse:
        code = (await json_object(request)).get("code")
        if not isinstance(code, str) or len(code) > 100:
            raise web.HTTPBadRequest(text="expected a code\n")
        try:
            role = self._codes.redeem(code, time.monotonic_ns())
        except Refused:
            await asyncio.sleep(_WRONG_CODE_PAUSE_S)
            raise
        previous = self.find_session(request)
        session, token = await self._pair_browser(request, role)
        if previous is not None:
            await asyncio.to_thread(self._sessions.revoke, previous.name)
        self._bridge.record(session.name, f"paired as {role.value}", request.remote)
        response = web.json_response({"name": session.name, "role": role.value})
        _set_cookie(request, response, token)
        return response

    async def _access(self, request: web.Request) -> web.StreamResponse:
        """Describe how another device opens this console.

        Only an operator at this computer, whose terminal shows the codes, gets them: a paired phone must not pair others.
        """
        assert request.transport is not None  # the client is connected
        port = request.transport.get_extra_info("sockname")[1]
        urls = await asyncio.to_thread(network_urls, self._host, port, tls=self._root_certificate is not None)
        shows_codes = is_loopback(request) and request[SESSION].role is Role.OPERATOR
        codes = {role.value: spoken(self._codes.code(role)) for role in Role} if shows_codes else {}
        local_only = serves_only_this_computer(self._host)
        return web.json_response({"urls": urls, "codes": codes, "serves_only_this_computer": local_only})

    async def _pair_browser(self, request: web.Request, role: Role, *, by_itself: bool = False) -> tuple[Session, str]:
        kind = device_kind(request.headers.get("User-Agent", ""))
        return await asyncio.to_thread(self._sessions.add, kind, role, by_itself=by_itself)

    # -- rosbridge ----------------------------------------------------------------------------------------------------
    async def serve_rosbridge(self, request: web.Request) -> web.StreamResponse:
        """Serve rosbridge to the session of a request."""
        session = request[SESSION]
        self._rosbridge_count += 1
        if session is LOCAL_SESSION:
            session = Session(f"program {self._rosbridge_count} of this computer", Role.OPERATOR)
        async with self._accept(request) as connection:
            client = RosbridgeClient(session, self._bridge, lambda frame: self._handoff.put(connection, frame))
            try:
                await connection.serve(client.handle, lambda: self._bridge.is_overloaded(client))
            finally:
                client.close()
        return connection.socket

    # -- the API ------------------------------------------------------------------------------------------------------
    async def _session(self, request: web.Request) -> web.StreamResponse:
        session = request.get(SESSION)
        described = None if session is None else {"name": session.name, "role": session.role.value}
        page = await asyncio.to_thread(page_version)
        return web.json_response(
            {"session": described, "control": self._control.state(), "stop": self._bridge.manual.stops(), "page": page}
        )

    def _apply_settings(self, settings: Mapping[str, Any]) -> None:
        self._settings = settings
        self.video.point_at(settings.get("webVideoServerUrl", ""))

    async def _apply_stored_settings(self, _: web.Application) -> None:
        # A damaged file is named to whoever asks for the settings.
        with contextlib.suppress(MalformedFile, OSError):
            self._apply_settings(await asyncio.to_thread(stored_settings, settings_file()))

    async def _listen(self, request: web.Request) -> web.StreamResponse:
        session = request[SESSION]
        async with self._accept(request) as connection:
            self._events.join(connection)
            try:
                await connection.serve(lambda _: self._note_alive(session), lambda: False)
            finally:
                self._events.leave(connection)
        return connection.socket

    async def _serve_voice(self, request: web.Request) -> web.StreamResponse:
        if self._voice is None:
            from lupin_runtime.console.voice import VoiceAgents  # a console without a voice agent does without these modules

            self._voice = VoiceAgents(
                self._bridge, self._accept, self._note_alive, lambda: self._settings, self._shared.change_location
            )
        return await self._voice.serve(request)

    async def close_voice(self) -> None:
        """End what the voice agents have started."""
        if self._voice is not None:
            await self._voice.close()

    def _note_alive(self, session: Session) -> None:
        self._bridge.authority.note_alive(session, time.monotonic_ns())

    def _is_paired(self, request: web.Request) -> bool:
        """Return whether the browser that sent a request is still paired."""
        session = request[SESSION]
        return session is LOCAL_SESSION or self._sessions.is_valid(session)

    def _browsers(self) -> list[dict[str, str]]:
        """Return who is connected to this port: each session once, by name."""
        roles = {session.name: session.role.value for session in self._open.values()}
        return [{"name": name, "role": role} for name, role in sorted(roles.items())]

    @contextlib.asynccontextmanager
    async def _accept(self, request: web.Request) -> AsyncIterator[Connection]:
        if len(self._open) >= MAX_CLIENTS:
            raise web.HTTPServiceUnavailable(text=f"{MAX_CLIENTS} clients are connected\n")
        async with self._connections.accept(request) as connection:
            self._open[connection] = request[SESSION]
            try:
                yield connection
            finally:
                self._open.pop(connection, None)


def _set_cookie(request: web.Request, response: web.StreamResponse, token: str) -> None:
    lifetime_s = int(SESSION_LIFETIME_S)
    response.set_cookie(COOKIE, token, max_age=lifetime_s, httponly=True, secure=request.secure, samesite="Strict", path="/")
