"""The API's routes as a table, from which the OpenAPI description is generated."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from typing import Any

from aiohttp import web

from lupin_runtime.console.authority import Session
from lupin_runtime.json_text import parse_json

SESSION = web.RequestKey("session", Session)  # the session that sent a request
OPENAPI_PATH = "/_api/openapi.json"

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True)
class Resource:
    """A route: its path with `{placeholders}`, handler and summary.

    `body` has the JSON schema of each property of the object that a POST takes; None for a GET. An `open` route may also be
    used by browsers that are not paired.
    """

    path: str
    handler: Handler
    summary: str
    body: dict[str, dict[str, Any]] | None = None
    open: bool = False

    @property
    def method(self) -> str:
        """POST if the route takes a JSON object, GET otherwise."""
        return "GET" if self.body is None else "POST"


async def json_object(request: web.Request) -> dict[str, Any]:
    """Read the JSON object in a request's body. Raises HTTPBadRequest."""
    try:
        body = await request.json(loads=parse_json)
    except ValueError as error:
        raise web.HTTPBadRequest(text=f"not JSON: {error}\n") from error
    if not isinstance(body, dict):
        raise web.HTTPBadRequest(text="expected a JSON object\n")
    return body


def add_resources(application: web.Application, resources: Sequence[Resource]) -> None:
    """Add the routes of a table to an application, and one that serves their description."""

    async def answer(_: web.Request) -> web.StreamResponse:
        return web.json_response(describe(described))

    described = (*resources, Resource(OPENAPI_PATH, answer, "This description, in OpenAPI 3.1."))
    for resource in described:
        for method in ("GET", "HEAD") if resource.method == "GET" else (resource.method,):
            application.router.add_route(method, resource.path, resource.handler)


def describe(resources: Sequence[Resource]) -> dict[str, Any]:
    """Return the OpenAPI description of a table of routes."""
    paths: dict[str, Any] = {}
    for resource in resources:
        names = re.findall(r"{(\w+)}", resource.path)
        operation: dict[str, Any] = {
            "summary": resource.summary,
            "parameters": [{"name": n, "in": "path", "required": True, "schema": {"type": "string"}} for n in names],
            "responses": {"200": {"description": "done"}},
            "security": [] if resource.open else [{"session": []}],
        }
        if not resource.open:
            operation["responses"]["401"] = {"description": "the browser is not paired"}
        if resource.body is not None:
            schema = {"type": "object", "properties": resource.body}
            operation["requestBody"] = {"required": True, "content": {"application/json": {"schema": schema}}}
            operation["responses"]["400"] = {"description": "the request is malformed"}
            operation["responses"]["403"] = {"description": "this session may not do that; the text says why"}
        paths.setdefault(resource.path, {})[resource.method.lower()] = operation
    return {
        "openapi": "3.1.0",
        "info": {"title": "Lupin's console", "version": "1"},
        "paths": paths,
        "components": {"securitySchemes": {"session": {"type": "apiKey", "in": "cookie", "name": "lupin_session"}}},
    }
