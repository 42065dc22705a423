"""The API's approach overrides: where operators want the robot to stand to read a tag, in the file that the mission reads."""

from __future__ import annotations

import asyncio
import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from aiohttp import web

from lupin_runtime.console.api_table import SESSION, Resource, json_object
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.events import EventChannel
from lupin_runtime.console.locations import BadLocation, checked_pose
from lupin_runtime.console.shared_file import locked
from lupin_runtime.mission.overrides import Override, OverridesError, load_overrides, save_overrides

MAX_APPROACHES = 500
MAX_TAG_ID = 64
_NO_RUN = "this console was not started with a run, so no mission would read it; start one with: lupin up"
_BODY: dict[str, dict[str, Any]] = {
    "tag": {"type": "string"},
    "pose": {
        "type": ["object", "null"],
        "properties": {name: {"type": "number"} for name in ("x", "y", "yaw")},
        "description": "where the robot shall stand on the map, in m and rad; null removes the override",
    },
}


class Approaches:
    """The resource's handlers. Used on the event loop only; the file is read and written on other threads."""

    def __init__(self, bridge: Bridge, events: EventChannel, path: Path) -> None:
        self._bridge = bridge
        self._events = events
        self._path = path

    def resources(self) -> tuple[Resource, ...]:
        """Return the routes, each with a summary of its answer."""
        summary = "The approach overrides of the run by tag: `goal_x` and `goal_y` in m, `yaw` in rad, `standoff` in m."
        return (
            Resource("/_api/approaches", self._list, summary),
            Resource("/_api/approaches", self._change, "Save or remove the override of a tag. Needs control.", _BODY),
        )

    async def _list(self, _: web.Request) -> web.StreamResponse:
        return web.json_response(_plain(await self._in_thread(self._load)))

    async def _change(self, request: web.Request) -> web.StreamResponse:
        body = await json_object(request)
        tag, pose = body.get("tag"), body.get("pose")
        if not isinstance(tag, str) or not 1 <= len(tag) <= MAX_TAG_ID or not tag.isprintable():
            raise web.HTTPBadRequest(text=f"a tag's id must have 1 to {MAX_TAG_ID} printable characters\n")
        try:
            checked = None if pose is None else checked_pose(pose)
        except BadLocation as error:
            raise web.HTTPBadRequest(text=f"{error}\n") from error
        self._bridge.authority.take(request[SESSION], time.monotonic_ns())
        changed = _plain(await self._in_thread(lambda: self._store(tag, checked)))
        self._bridge.record(request[SESSION].name, f"{'remove' if pose is None else 'save'} approach of tag {tag}", pose)
        self._events.push("approaches", changed)
        return web.json_response(changed)

    async def _in_thread(self, act: Any) -> dict[str, Override]:
        try:
            result: dict[str, Override] = await asyncio.to_thread(act)
        except OverridesError as error:
            raise web.HTTPConflict(text=f"{error}\n") from error
        return result

    def _load(self) -> dict[str, Override]:
        return load_overrides(self._path) if self._path.is_file() else {}

    def _store(self, tag: str, pose: dict[str, float] | None) -> dict[str, Override]:
        if not self._path.is_file():
            raise OverridesError(_NO_RUN)
        with locked(self._path):
            overrides = load_overrides(self._path)
            if pose is None:
                overrides.pop(tag, None)
            else:
                drawn = replace(overrides.get(tag, Override()), goal_x=pose["x"], goal_y=pose["y"], yaw=pose["yaw"])
                overrides[tag] = drawn
            if len(overrides) > MAX_APPROACHES:
                raise OverridesError(f"there are {MAX_APPROACHES} approach overrides; remove one first")
            save_overrides(self._path, overrides)
        return overrides


def _plain(overrides: dict[str, Override]) -> dict[str, dict[str, float]]:
    return {tag: {key: value for key, value in asdict(one).items() if value is not None} for tag, one in overrides.items()}
