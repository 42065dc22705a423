"""The API's resources about the doctor: its state, an examination, and the fix of a finding."""

from __future__ import annotations

import time
from typing import Any

from aiohttp import web

from lupin_runtime.console.api_table import SESSION, Resource, json_object
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.doctor import Doctor

_FIX_BODY: dict[str, dict[str, Any]] = {
    "finding": {"type": "string"},
    "confirmed": {"type": "boolean", "description": "false: only preview what would be changed"},
}
_BAD_FIX = "finding must be the id of a finding; confirmed must be true to play its fix, or false to preview it\n"


class DoctorResources:
    """The routes of one doctor."""

    def __init__(self, doctor: Doctor, bridge: Bridge) -> None:
        self._doctor = doctor
        self._bridge = bridge

    def resources(self) -> tuple[Resource, ...]:
        """Return the routes, each with a summary of its answer."""
        return (
            Resource("/_api/doctor", self._state, "The last diagnosis, its time, and what the doctor is doing now."),
            Resource("/_api/doctor/examination", self._examine, "Examine this computer and its graph; changes nothing.", {}),
            Resource("/_api/doctor/fix", self._fix, "Play the fix of a finding, or preview it. Needs control.", _FIX_BODY),
        )

    async def _state(self, _: web.Request) -> web.StreamResponse:
        return web.json_response(self._doctor.state)

    async def _examine(self, request: web.Request) -> web.StreamResponse:
        await json_object(request)
        self._doctor.start_examination()
        return web.json_response(self._doctor.state)

    async def _fix(self, request: web.Request) -> web.StreamResponse:
        body = await json_object(request)
        finding, confirmed = body.get("finding"), body.get("confirmed")
        if not isinstance(finding, str) or not isinstance(confirmed, bool):
            raise web.HTTPBadRequest(text=_BAD_FIX)
        session = request[SESSION]
        self._bridge.authority.take(session, time.monotonic_ns())
        self._bridge.record(session.name, f"{'fix' if confirmed else 'preview the fix of'} {finding[:100]}")
        return web.json_response(await self._doctor.fix(finding, dry_run=not confirmed))
