"""`/_api/voice/token`: a token with which one browser opens one connection to the voice service.

The key stays on this computer (https://ai.google.dev/gemini-api/docs/ephemeral-tokens). A token is good for one session of one
model, which must begin within a minute.
"""

from __future__ import annotations

import asyncio
import os
import re
from collections.abc import Mapping
from datetime import datetime, timedelta, timezone
from typing import Any
from urllib.parse import urlsplit

import aiohttp
from aiohttp import web

from lupin_runtime.console.api_table import SESSION, Resource, json_object
from lupin_runtime.console.authority import Refused, Role
from lupin_runtime.console.voice_key import SET_KEY, key_file, read_key
from lupin_runtime.json_text import parse_json

SERVICE_VARIABLE = "LUPIN_VOICE_SERVICE"  # another address of the service, as of one for tests
SERVICE_URL = "https://generativelanguage.googleapis.com"
SOCKET_PATH = "/ws/google.ai.generativelanguage.v1alpha.GenerativeService.BidiGenerateContentConstrained"
TOKEN_PATH = "/v1alpha/auth_tokens"  # noqa: S105 -- no secret
TIMEOUT_S = 8.0
BEGINS_WITHIN_S = 60.0
LASTS_S = 30 * 60.0  # as long as messages are accepted; the service ends a connection, or the page replaces it
MAX_MINTING = 4  # at once
_MAX_ANSWER_BYTES = 100_000
_MODEL = re.compile(r"models/[A-Za-z0-9._-]{1,100}")
_BODY: dict[str, dict[str, Any]] = {"model": {"type": "string", "description": "the model that the token is good for"}}

NO_KEY = f"there is no key for the Gemini API; on the computer of the console type: {SET_KEY}"
BAD_KEY = f"Google does not accept the key; make one at aistudio.google.com, and store it with: {SET_KEY}"
NO_QUOTA = "the quota of the key is used up; wait a minute, or see its limits at aistudio.google.com"
UNREACHABLE = (
    "the computer of the console cannot reach Google; it needs the internet, which the robot's network alone does not have"
)
SILENT = f"Google has not answered within {TIMEOUT_S:g} s; try again"
MALFORMED = "Google's answer has no token; try again"
BUSY = "other browsers are asking for a token; try again"


class TokenFailed(Exception):
    """No token was made; the text says why and what to do, and `status` is the HTTP status to answer with."""

    def __init__(self, status: int, reason: str) -> None:
        super().__init__(reason)
        self.status = status


class VoiceTokens:
    """Mints tokens at the service. Used on the event loop."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        self._environment = environment
        self._http: aiohttp.ClientSession | None = None
        self._minting = 0

    def resources(self) -> tuple[Resource, ...]:
        """Return the routes."""
        return (
            Resource("/_api/voice/key", self._describe, "Whether a key for the voice service is stored; never the key itself."),
            Resource(
                "/_api/voice/token", self._answer, "A token for one connection to the voice service. For operators.", _BODY
            ),
        )

    async def close(self) -> None:
        """Close the connections to the service."""
        if self._http is not None:
            await self._http.close()

    async def _describe(self, _: web.Request) -> web.StreamResponse:
        return web.json_response({"stored": await asyncio.to_thread(read_key, key_file()) is not None})

    async def _answer(self, request: web.Request) -> web.StreamResponse:
        session = request[SESSION]
        if session.role is not Role.OPERATOR:
            raise Refused(f"{session.name} is a viewer; to speak with the robot, pair this browser as operator")
        model = (await json_object(request)).get("model")
        if not isinstance(model, str) or not _MODEL.fullmatch(model):
            raise web.HTTPBadRequest(text="model must be the name of a model, such as models/gemini-3.8-live\n")
        try:
            return web.json_response({"token": await self.mint(model), "url": socket_url(service_url(self._environment))})
        except TokenFailed as error:
            return web.json_response({"error": str(error)}, status=error.status)

    async def mint(self, model: str) -> str:
        """Return a new token for a model. Raises TokenFailed, MalformedFile and OSError."""
        key = await asyncio.to_thread(read_key, key_file())
        if key is None:
            raise TokenFailed(409, NO_KEY)
        if self._minting >= MAX_MINTING:
            raise TokenFailed(503, BUSY)
        self._minting += 1
        try:
            return await self._request(key, token_request(model, datetime.now(timezone.utc)))
        except asyncio.TimeoutError:
            raise TokenFailed(504, SILENT) from None
        except aiohttp.ClientError:
            # Its text may hold the request, with the key.
            raise TokenFailed(502, UNREACHABLE) from None
        finally:
            self._minting -= 1

    async def _request(self, key: str, body: dict[str, Any]) -> str:
        if self._http is None:
            self._http = aiohttp.ClientSession(cookie_jar=aiohttp.DummyCookieJar())
        # The key is in a header, since addresses are logged; a redirection could carry it elsewhere.
        async with self._http.post(
            service_url(self._environment) + TOKEN_PATH,
            json=body,
            headers={"x-goog-api-key": key},
            allow_redirects=False,
            timeout=aiohttp.ClientTimeout(total=TIMEOUT_S),
        ) as response:
            content = await response.content.read(_MAX_ANSWER_BYTES)
            return token_of(response.status, content)


def token_request(model: str, now: datetime) -> dict[str, Any]:
    """Return the request for a token, which locks the model; the page chooses the rest of the setup."""
    return {
        "uses": 1,
        "newSessionExpireTime": _stamp(now + timedelta(seconds=BEGINS_WITHIN_S)),
        "expireTime": _stamp(now + timedelta(seconds=LASTS_S)),
        "bidiGenerateContentSetup": {"model": model},
        "fieldMask": "model",
    }


def token_of(status: int, content: bytes) -> str:
    """Return the token in an answer of the service. Raises TokenFailed."""
    try:
        answer = parse_json(content)
    except ValueError:
        answer = None
    fields = answer if isinstance(answer, dict) else {}
    name = fields.get("name")
    if status == 200 and isinstance(name, str) and 0 < len(name) <= 2000 and name.isprintable():
        return name
    error = fields.get("error")
    reason = str(error.get("message", "")) if isinstance(error, dict) else ""
    if status in (401, 403) or (status == 400 and "api key" in reason.lower()):
        raise TokenFailed(409, BAD_KEY)
    if status == 429:
        raise TokenFailed(429, NO_QUOTA)
    raise TokenFailed(502, MALFORMED if status == 200 else f"Google answered with status {status}; try again")


def service_url(environment: Mapping[str, str]) -> str:
    """Return the address of the service. Raises TokenFailed if that of the environment would send the key unencrypted."""
    url = environment.get(SERVICE_VARIABLE, "").rstrip("/") or SERVICE_URL
    parts = urlsplit(url)
    if parts.scheme != "https" and (parts.scheme, parts.hostname) not in (("http", "127.0.0.1"), ("http", "localhost")):
        raise TokenFailed(409, f"{SERVICE_VARIABLE} must begin with https://, or with http://127.0.0.1, not {url[:100]!r}")
    return url


def socket_url(url: str) -> str:
    """Return the address of the service's WebSocket."""
    return f"ws{url.removeprefix('http')}{SOCKET_PATH}"


def _stamp(moment: datetime) -> str:
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")
