"""The API's resources that all browsers share: named locations, settings and the arm's library."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

from aiohttp import web

from lupin_runtime import graph
from lupin_runtime.console.api_table import SESSION, Resource, json_object
from lupin_runtime.console.authority import Session
from lupin_runtime.console.bridge import Bridge, ServiceFailed
from lupin_runtime.console.events import EventChannel
from lupin_runtime.console.locations import (
    BadLocation,
    all_locations,
    import_locations,
    locations_file,
    remove_location,
    save_location,
)
from lupin_runtime.console.settings import (
    VERSION,
    BadSetting,
    change_settings,
    describe_settings,
    settings_file,
    stored_settings,
)
from lupin_runtime.json_text import parse_json

_NUMBER = {"type": "number"}
_LOCATION_BODY: dict[str, dict[str, Any]] = {
    "name": {"type": "string"},
    "pose": {
        "type": ["object", "null"],
        "properties": {"x": _NUMBER, "y": _NUMBER, "yaw": _NUMBER},
        "description": "null removes it",
    },
}
_IMPORT_BODY: dict[str, dict[str, Any]] = {"locations": {"type": "object", "description": "a pose for each name"}}
_SETTINGS_BODY: dict[str, dict[str, Any]] = {
    "version": {"type": "integer", "description": f"version of the page that stored the settings [{VERSION}]"},
    "settings": {"type": "object"},
}


class SharedData:
    """The resources' handlers. Used on the event loop only; files are read and written on other threads."""

    def __init__(self, bridge: Bridge, events: EventChannel, apply: Callable[[dict[str, Any]], None]) -> None:
        """`apply` is told the settings after each change."""
        self._bridge = bridge
        self._events = events
        self._apply = apply

    def resources(self) -> tuple[Resource, ...]:
        """Return the routes, each with a summary of its answer."""
        return (
            Resource("/_api/locations", self._locations, "The named locations on the map: x and y in m, yaw in rad."),
            Resource("/_api/locations", self._change_location, "Save or remove a location. Needs control.", _LOCATION_BODY),
            Resource(
                "/_api/locations/import",
                self._import_locations,
                "Add the locations that a browser kept before the console did. Refused while another session has control.",
                _IMPORT_BODY,
            ),
            Resource(
                "/_api/settings",
                self._settings,
                "The page's settings that were changed, and the table of all with defaults and allowed values.",
            ),
            Resource(
                "/_api/settings",
                self._change_settings,
                "Change settings for all browsers. Refused while another session has control.",
                _SETTINGS_BODY,
            ),
            Resource("/_api/arm/library", self._arm_library, "The arm's stored poses and sequences."),
        )

    async def _arm_library(self, request: web.Request) -> web.StreamResponse:
        call = self._bridge.request_service(request[SESSION], graph.ARM_LIBRARY_LIST.name, {})
        try:
            response = await asyncio.wrap_future(call)
        except ServiceFailed as error:
            raise web.HTTPServiceUnavailable(text=f"{error}\n") from error
        try:
            return web.json_response(parse_json(response["json"]))
        except ValueError as error:
            raise web.HTTPBadGateway(text=f"the arm's library is damaged: {error}\n") from error

    async def _locations(self, _: web.Request) -> web.StreamResponse:
        return web.json_response(await asyncio.to_thread(all_locations, locations_file()))

    async def _change_location(self, request: web.Request) -> web.StreamResponse:
        body = await json_object(request)
        try:
            return web.json_response(await self.change_location(request[SESSION], body.get("name"), body.get("pose")))
        except BadLocation as error:
            raise web.HTTPBadRequest(text=f"{error}\n") from error

    async def change_location(self, session: Session, name: Any, pose: Any) -> dict[str, dict[str, float]]:
        """Save or replace a location for a session, or remove it if `pose` is None; returns all locations.

        Control is taken if it is free: only the session in control may change shared data. Raises Refused, BadLocation,
        MalformedFile and OSError.
        """
        self._bridge.authority.take(session, time.monotonic_ns())
        if pose is None:
            changed = await asyncio.to_thread(remove_location, locations_file(), name)
        else:
            changed = await asyncio.to_thread(save_location, locations_file(), name, pose)
        self._bridge.record(session.name, f"{'remove' if pose is None else 'save'} location {name}", pose)
        self._events.push("locations", changed)
        return changed

    async def _import_locations(self, request: web.Request) -> web.StreamResponse:
        found = (await json_object(request)).get("locations")
        # Control is not taken: a page sends this by itself when it is opened.
        self._bridge.authority.check_take(request[SESSION], time.monotonic_ns())
        try:
            changed = await asyncio.to_thread(import_locations, locations_file(), found)
        except BadLocation as error:
            raise web.HTTPBadRequest(text=f"{error}\n") from error
        self._bridge.record(request[SESSION].name, "import locations", found)
        self._events.push("locations", changed)
        return web.json_response(changed)

    async def _settings(self, _: web.Request) -> web.StreamResponse:
        settings = await asyncio.to_thread(stored_settings, settings_file())
        return web.json_response({"version": VERSION, "settings": settings, "table": describe_settings()})

    async def _change_settings(self, request: web.Request) -> web.StreamResponse:
        body = await json_object(request)
        # Control is not taken: a page in control states stops and holds the wheels, which nobody asked for by a setting.
        self._bridge.authority.check_take(request[SESSION], time.monotonic_ns())
        changes, version = body.get("settings"), body.get("version", VERSION)
        try:
            settings = await asyncio.to_thread(change_settings, settings_file(), changes, version)
        except BadSetting as error:
            raise web.HTTPBadRequest(text=f"{error}\n") from error
        self._apply(settings)
        self._bridge.record(request[SESSION].name, "change settings", changes)
        self._events.push("settings", settings)
        return web.json_response({"version": VERSION, "settings": settings})
