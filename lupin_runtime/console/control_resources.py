"""The API's resources of control and stop: which session has control, and the stops that clients hold."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from aiohttp import web

from lupin_runtime.console.api_table import SESSION, Resource, json_object
from lupin_runtime.console.authority import REQUEST_TIMEOUT_S
from lupin_runtime.console.bridge import Bridge
from lupin_runtime.console.stop_registry import press_name

_LEASE_BODY: dict[str, dict[str, Any]] = {
    "action": {"enum": ["take", "request", "grant", "refuse", "give_up", "take_over"]},
    "from": {"type": "string", "description": "for take_over: who has control, as shown to the operator"},
}

_STOP_BODY: dict[str, dict[str, Any]] = {
    "engaged": {"type": "boolean"},
    "press": {
        "type": "string",
        "description": "to stop: the name of this press, as in the page's publications; to let go of it, without control",
    },
    "presses": {
        "type": "array",
        "items": {"type": "string"},
        "description": "to release: the presses that the operator has seen; without them, what no client holds any more",
    },
}


class ControlResources:
    """The resources' handlers. Used on the event loop only."""

    def __init__(self, bridge: Bridge, push_state: Callable[[], None]) -> None:
        """`push_state` is called after each change of a stop."""
        self._bridge = bridge
        self._push_state = push_state
        self._holder: str | None = None
        self._since_s = 0.0  # when the holder got control, in wall-clock time for browsers

    def resources(self) -> tuple[Resource, ...]:
        """Return the routes, each with a summary of its answer."""
        return (
            Resource("/_api/lease", self._lease, "Take, request, hand over or give up control.", _LEASE_BODY),
            Resource("/_api/stop", self._stop, "Stop the robot, or release the stops that hold it.", _STOP_BODY),
        )

    def state(self) -> dict[str, Any]:
        """Return who has control since when, and who requests it."""
        now_ns = time.monotonic_ns()
        lease = self._bridge.authority.lease(now_ns)
        if lease.holder != self._holder:
            self._holder, self._since_s = lease.holder, time.time()
        since_s = round(self._since_s) if lease.holder is not None else None
        left_s = None
        if lease.requester is not None:
            left_s = max(0, math.ceil(REQUEST_TIMEOUT_S - (now_ns - lease.requested_ns) / 1e9))
        return {"holder": lease.holder, "since_s": since_s, "requester": lease.requester, "answer_within_s": left_s}

    async def _lease(self, request: web.Request) -> web.StreamResponse:
        session = request[SESSION]
        body = await json_object(request)
        authority, now_ns = self._bridge.authority, time.monotonic_ns()
        action = body.get("action")
        if action == "take":
            authority.take(session, now_ns)
        elif action == "request":
            authority.request(session, now_ns)
        elif action in ("grant", "refuse"):
            authority.answer(session, action == "grant", now_ns)
        elif action == "give_up":
            authority.give_up(session, now_ns)
        elif action == "take_over":
            holder = authority.lease(now_ns).holder
            if body.get("from") != holder:
                # The operator confirmed taking control from somebody else.
                return web.json_response({"error": f"control is with {holder or 'nobody'} now"}, status=409)
            authority.take(session, now_ns, take_over=True)
        else:
            raise web.HTTPBadRequest(text="action must be one of take, request, grant, refuse, give_up, take_over\n")
        return web.json_response(self.state())

    async def _stop(self, request: web.Request) -> web.StreamResponse:
        session = request[SESSION]
        body = await json_object(request)
        engaged, presses = body.get("engaged"), body.get("presses")
        if not isinstance(engaged, bool):
            raise web.HTTPBadRequest(text="engaged must be true or false\n")
        if presses is not None and not (isinstance(presses, list) and all(isinstance(each, str) for each in presses)):
            raise web.HTTPBadRequest(text="presses must be a list of texts\n")
        if engaged:
            self._bridge.manual.stop_for(session, press_name(body.get("press")))
        elif press := press_name(body.get("press")):
            self._bridge.manual.withdraw_for(session, press)
        else:
            self._bridge.manual.release_for(session, presses)
        self._push_state()
        return web.json_response({"stop": self._bridge.manual.stops()})
