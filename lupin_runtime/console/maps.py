"""The API's saved maps: list, save, load and delete them, and tell SLAM where the robot stands."""

from __future__ import annotations

import asyncio
import json
import shlex
import time
from typing import Any

from aiohttp import web

from lupin_runtime import graph
from lupin_runtime.atomic_file import read_json_object, write_atomically
from lupin_runtime.console.api_table import SESSION, Resource, json_object
from lupin_runtime.console.bridge import Bridge, ServiceFailed
from lupin_runtime.console.locations import BadLocation, checked_pose, locations_file
from lupin_runtime.console.map_names import (
    BadMapName,
    delete_map,
    maps_folder,
    pose_graph_problem,
    saved_maps,
    with_map_path,
)
from lupin_runtime.stack.options import Options
from lupin_runtime.stack.runs import Run

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
# Reasons of refusals.
MAP_EXISTS = "there is a map {name} already; choose another name, or replace it"
NO_MAP_SAVED = "no map was saved: SLAM has not published one yet"
NOT_LOADED = "{name} was not loaded: {problem}"
NOT_DELETED = "{name} was not deleted: {problem}"
IS_LOADED = "it is the loaded map of this run"
NO_SUCH_MAP = "there is no such map"
NOT_RELOCATED = "the robot was not relocated: SLAM has no map yet"
_LOADED = "loaded_map.json"  # in the run's folder, so that a console that was restarted still knows it


class Maps:
    """The resources' handlers. Used on the event loop only; files are read, written and deleted on other threads."""

    def __init__(self, bridge: Bridge, run: Run) -> None:
        """`run` is the run whose map can be replaced."""
        self._bridge = bridge
        self._run = run

    def resources(self) -> tuple[Resource, ...]:
        """Return the routes, each with a summary of its answer."""
        return (
            Resource("/_api/maps", self._list, "The saved maps and their folder, and which one this run has loaded."),
            Resource(
                "/_api/maps",
                self._save,
                "Save the current SLAM map; one of this name only with `replace`. Needs control.",
                {**_MAP_BODY, "replace": {"type": "boolean"}},
            ),
            Resource(
                "/_api/maps/load",
                self._load,
                "Go on mapping in a saved map, at whose start the robot must stand. Needs control; the robot must neither "
                "have a mission nor drive to a goal.",
                _MAP_BODY,
            ),
            Resource(
                "/_api/maps/delete", self._delete, "Delete a saved map, but not the loaded one. Needs control.", _MAP_BODY
            ),
            Resource(
                "/_api/maps/relocate",
                self._relocate,
                "Tell SLAM where the robot stands on the present map. Needs control.",
                {"pose": _ROBOT_POSE},
            ),
        )

    async def _list(self, _: web.Request) -> web.StreamResponse:
        return web.json_response(await asyncio.to_thread(self._describe))

    async def _save(self, request: web.Request) -> web.StreamResponse:
        body = await json_object(request)
        name = body.get("name")
        arguments = _with_path(graph.SLAM_SAVE_MAP, {"name": {"data": name}})
        if body.get("replace") is not True and name in [each.name for each in await asyncio.to_thread(saved_maps)]:
            return self._refuse(request, f"save map {name}", MAP_EXISTS.format(name=name))
        response = await self._call(request, graph.SLAM_SAVE_MAP, arguments)
        self._bridge.record(request[SESSION].name, f"save map {name}")
        if response["result"] != 0:
            return web.json_response({"error": NO_MAP_SAVED}, status=409)
        pose_graph = _with_path(graph.SLAM_SERIALIZE, {"filename": name})
        try:
            loadable = (await self._call(request, graph.SLAM_SERIALIZE, pose_graph))["result"] == 0
        except web.HTTPServiceUnavailable:
            loadable = False
        return web.json_response({"saved": name, "loadable": loadable})

    async def _load(self, request: web.Request) -> web.StreamResponse:
        name = (await json_object(request)).get("name")
        self._take_control(request)
        arguments = _with_path(graph.SLAM_DESERIALIZE, {"filename": name, "match_type": _START_AT_FIRST_NODE})
        what = f"load map {name}"
        problem = self._bridge.map_refusal() or await asyncio.to_thread(pose_graph_problem, arguments["filename"])
        if problem:
            return self._refuse(request, what, NOT_LOADED.format(name=name, problem=problem))
        self._bridge.record(request[SESSION].name, what)
        await self._call_own(graph.SLAM_DESERIALIZE, arguments)
        await asyncio.to_thread(write_atomically, self._run.path / _LOADED, json.dumps({"name": name}))
        return web.json_response({"loaded": name})

    async def _delete(self, request: web.Request) -> web.StreamResponse:
        name = (await json_object(request)).get("name")
        self._take_control(request)
        what = f"delete map {name}"
        if name is not None and name == await asyncio.to_thread(self._loaded):
            return self._refuse(request, what, NOT_DELETED.format(name=name, problem=IS_LOADED))
        try:
            await asyncio.to_thread(delete_map, name)
        except BadMapName as error:
            raise web.HTTPBadRequest(text=f"{error}\n") from error
        except FileNotFoundError:
            return self._refuse(request, what, NOT_DELETED.format(name=name, problem=NO_SUCH_MAP))
        except OSError as error:
            return self._refuse(request, what, NOT_DELETED.format(name=name, problem=error.strerror))
        self._bridge.record(request[SESSION].name, what)
        return web.json_response({"deleted": name})

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
            return web.json_response({"error": NOT_RELOCATED}, status=409)
        self._bridge.record(request[SESSION].name, "relocate", pose)
        initial = {"x": start["x"], "y": start["y"], "theta": start["yaw"]}
        arguments = {"filename": str(path), "match_type": _START_AT_GIVEN_POSE, "initial_pose": initial}
        await self._call_own(graph.SLAM_DESERIALIZE, arguments)
        return web.json_response({"relocated": True})

    def _describe(self) -> dict[str, Any]:
        maps = [
            {
                "name": each.name,
                "saved_s": each.saved_s,
                "loadable": each.is_loadable,
                # To be pasted into a terminal of this computer.
                "command": None if each.yaml is None else f"lupin up --map {shlex.quote(str(each.yaml))}",
            }
            for each in saved_maps()
        ]
        return {"folder": str(maps_folder()), "loaded": self._loaded(), "maps": maps}

    def _loaded(self) -> str | None:
        """Return the name of the saved map that this run uses: loaded by a client, or the one of `lupin up --map`."""
        name = read_json_object(self._run.path / _LOADED).get("name")
        if isinstance(name, str):
            return name
        started_with = Options.from_json(self._run.info().get("options") or {}).map_file
        is_saved = started_with is not None and started_with.parent.resolve() == maps_folder().resolve()
        return started_with.stem if started_with is not None and is_saved else None

    def _refuse(self, request: web.Request, what: str, reason: str) -> web.StreamResponse:
        self._bridge.record(request[SESSION].name, what, refused=reason)
        return web.json_response({"error": reason}, status=409)

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

    def _take_control(self, request: web.Request) -> None:
        """Take control if it is free. Raises Refused."""
        self._bridge.authority.take(request[SESSION], time.monotonic_ns())


def _with_path(service: graph.Service, arguments: dict[str, Any]) -> Any:
    try:
        return with_map_path(service.name, arguments)
    except BadMapName as error:
        raise web.HTTPBadRequest(text=f"{error}\n") from error
