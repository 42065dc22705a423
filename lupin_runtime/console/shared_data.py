"""The API's resources that all browsers share: maps, named locations, settings and the arm's library."""

from __future__ import annotations

import asyncio
import time
from typing import Any

from aiohttp import web

from lupin_runtime import graph
from lupin_runtime.console.api_table import SESSION, Resource, json_object
from lupin_runtime.console.bridge import Bridge, ServiceFailed
from lupin_runtime.console.events import EventChannel
from lupin_runtime.console.locations import (
    BadLocation,
    all_locations,
    checked_pose,
    locations_file,
    remove_location,
    save_location,
)
from lupin_runtime.console.map_names import BadMapName, pose_graph_problem, with_map_path
from lupin_runtime.console.settings import (
    VERSION,
    BadSetting,
    change_settings,
    describe_settings,
    settings_file,
    stored_settings,
)
from lupin_runtime.json_text import parse_json

# Constants of slam_toolbox/srv/DeserializePoseGraph.
_START_AT_FIRST_NODE = 1
_START_AT_GIVEN_POSE = 2
_NUMBER = {"type": "number"}
_MAP_BODY: dict[str, dict[str, Any]] = {"name": {"type": "string"}}
_ROBOT_POSE: dict[str, Any] = {
    "type": "object",
    "properties": {"x": _NUMBER, "y": _NUMBER, "yaw": _NUMBER},
    "description": "where the robot stands on the map, in m and rad",
}
_LOCATION_BODY: dict[str, dict[str, Any]] = {
    "name": {"type": "string"},
    "pose": {
        "type": ["object", "null"],
        "properties": {"x": _NUMBER, "y": _NUMBER, "yaw": _NUMBER},
        "description": "null removes it",
    },
}
_SETTINGS_BODY: dict[str, dict[str, Any]] = {
    "version": {"type": "integer", "description": f"version of the page that stored the settings [{VERSION}]"},
    "settings": {"type": "object"},
}


class SharedData:
    """The resources' handlers. Used on the event loop only; files are read and written on other threads."""

    def __init__(self, bridge: Bridge, events: EventChannel) -> None:
        self._bridge = bridge
        self._events = events

    def resources(self) -> tuple[Resource, ...]:
        """Return the routes, each with a summary of its answer."""
        return (
            Resource("/_api/maps", self._save_map, "Save the current SLAM map. Needs control.", _MAP_BODY),
            Resource(
                "/_api/maps/load",
                self._load_map,
                "Go on mapping in a saved map, at whose start the robot must stand. Needs control.",
                _MAP_BODY,
            ),
            Resource(
                "/_api/maps/relocate",
                self._relocate,
                "Tell SLAM where the robot stands on the present map. Needs control.",
                {"pose": _ROBOT_POSE},
            ),
            Resource("/_api/locations", self._locations, "The named locations on the map: x and y in m, yaw in rad."),
            Resource("/_api/locations", self._change_location, "Save or remove a location. Needs control.", _LOCATION_BODY),
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

    async def _save_map(self, request: web.Request) -> web.StreamResponse:
        name = (await json_object(request)).get("name")
        try:
            arguments = with_map_path(graph.SLAM_SAVE_MAP.name, {"name": {"data": name}})
        except BadMapName as error:
            raise web.HTTPBadRequest(text=f"{error}\n") from error
        response = await self._call(request, graph.SLAM_SAVE_MAP, arguments)
        self._bridge.record(request[SESSION].name, f"save map {name}")
        if response["result"] != 0:
            return web.json_response({"error": "no map was saved: SLAM has not published one yet"}, status=409)
        pose_graph = with_map_path(graph.SLAM_SERIALIZE.name, {"filename": name})
        try:
            loadable = (await self._call(request, graph.SLAM_SERIALIZE, pose_graph))["result"] == 0
        except web.HTTPServiceUnavailable:
            loadable = False
        return web.json_response({"saved": name, "loadable": loadable})

    async def _load_map(self, request: web.Request) -> web.StreamResponse:
        name = (await json_object(request)).get("name")
        self._take_control(request)
        try:
            arguments = with_map_path(graph.SLAM_DESERIALIZE.name, {"filename": name, "match_type": _START_AT_FIRST_NODE})
        except BadMapName as error:
            raise web.HTTPBadRequest(text=f"{error}\n") from error
        problem = await asyncio.to_thread(pose_graph_problem, arguments["filename"])
        if problem:
            return web.json_response({"error": f"{name} was not loaded: {problem}"}, status=409)
        self._bridge.record(request[SESSION].name, f"load map {name}")
        await self._call_own(graph.SLAM_DESERIALIZE, arguments)
        return web.json_response({"loaded": name})

    async def _relocate(self, request: web.Request) -> web.StreamResponse:
        """Have SLAM save its pose graph and load it again with the robot elsewhere: it has no other service for this."""
        pose = (await json_object(request)).get("pose")
        try:
            start = checked_pose(pose)
        except BadLocation as error:
            raise web.HTTPBadRequest(text=f"{error}\n") from error
        self._take_control(request)
        path = locations_file().with_name("relocation")
        await asyncio.to_thread(path.parent.mkdir, parents=True, exist_ok=True)
        if (await self._call_own(graph.SLAM_SERIALIZE, {"filename": str(path)}))["result"] != 0:
            return web.json_response({"error": "the robot was not relocated: SLAM has no map yet"}, status=409)
        self._bridge.record(request[SESSION].name, "relocate", pose)
        initial = {"x": start["x"], "y": start["y"], "theta": start["yaw"]}
        arguments = {"filename": str(path), "match_type": _START_AT_GIVEN_POSE, "initial_pose": initial}
        await self._call_own(graph.SLAM_DESERIALIZE, arguments)
        return web.json_response({"relocated": True})

    async def _arm_library(self, request: web.Request) -> web.StreamResponse:
        response = await self._call(request, graph.ARM_LIBRARY_LIST, {})
        try:
            return web.json_response(parse_json(response["json"]))
        except ValueError as error:
            raise web.HTTPBadGateway(text=f"the arm's library is damaged: {error}\n") from error

    async def _call(self, request: web.Request, service: graph.Service, arguments: dict[str, Any]) -> Any:
        try:
            return await asyncio.wrap_future(self._bridge.request_service(request[SESSION], service.name, arguments))
        except ServiceFailed as error:
            raise web.HTTPServiceUnavailable(text=f"{error}\n") from error

    async def _call_own(self, service: graph.Service, arguments: dict[str, Any]) -> Any:
        """Call a service with arguments that a client could not choose."""
        try:
            return await asyncio.wrap_future(self._bridge.request_own_service(service.name, arguments))
        except ServiceFailed as error:
            raise web.HTTPServiceUnavailable(text=f"{error}\n") from error

    async def _locations(self, _: web.Request) -> web.StreamResponse:
        return web.json_response(await asyncio.to_thread(all_locations, locations_file()))

    async def _change_location(self, request: web.Request) -> web.StreamResponse:
        body = await json_object(request)
        name, pose = body.get("name"), body.get("pose")
        self._take_control(request)
        try:
            if pose is None:
                changed = await asyncio.to_thread(remove_location, locations_file(), name)
            else:
                changed = await asyncio.to_thread(save_location, locations_file(), name, pose)
        except BadLocation as error:
            raise web.HTTPBadRequest(text=f"{error}\n") from error
        self._bridge.record(request[SESSION].name, f"{'remove' if pose is None else 'save'} location {name}", pose)
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
        self._bridge.record(request[SESSION].name, "change settings", changes)
        self._events.push("settings", settings)
        return web.json_response({"version": VERSION, "settings": settings})

    def _take_control(self, request: web.Request) -> None:
        """Take control if it is free: only the session in control may change shared data. Raises Refused."""
        self._bridge.authority.take(request[SESSION], time.monotonic_ns())
