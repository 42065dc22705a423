"""The API's read-only resources: runs with their state, report, recording and logs, and saved maps.

Disks are read on other threads, because a slow one must not delay a stop on the event loop.
"""

from __future__ import annotations

import asyncio
from itertools import islice
from pathlib import Path
from typing import Any

from aiohttp import web

from lupin_runtime.atomic_file import read_json_object
from lupin_runtime.bounded_file import open_regular
from lupin_runtime.console.api_table import Resource
from lupin_runtime.console.map_names import maps_folder
from lupin_runtime.json_text import parse_json
from lupin_runtime.stack.results import result_of
from lupin_runtime.stack.retention import StoredRun, stored_runs
from lupin_runtime.stack.runs import Run, RunError, all_runs, choose_run

MAX_LOG_BYTES = 256_000
MAX_COMMANDS = 1000
# A report is a page with its own scripts: the sandbox gives it a unique origin, so that it cannot reach this server.
_REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
)
_REPORT_FILES = {"report.html": "text/html", "report.json": "application/json"}


def resources() -> tuple[Resource, ...]:
    """Return the routes, each with a summary of its answer."""
    return (
        Resource(
            "/_api/runs",
            _runs,
            "The stored runs, newest first: id, state, world, start, duration, tags, size in bytes, kept or not.",
        ),
        Resource("/_api/runs/{run}", _run, "One run: its options, last state and result."),
        Resource("/_api/runs/{run}/report/{file}", _report, "The report: `report.html` or `report.json`."),
        Resource("/_api/runs/{run}/recording", _recording, "The recording of the graph (MCAP); supports range requests."),
        Resource("/_api/runs/{run}/logs", _logs, "The names of the processes that have logs."),
        Resource("/_api/runs/{run}/logs/{process}", _log, f"The end of a process's log as text, up to {MAX_LOG_BYTES} bytes."),
        Resource("/_api/runs/{run}/commands", _commands, f"The command journal: the last {MAX_COMMANDS} commands of clients."),
        Resource("/_api/maps/{map}", _map, "A file of a saved map: its YAML, or the image that the YAML names."),
    )


async def _runs(_: web.Request) -> web.StreamResponse:
    return web.json_response(await asyncio.to_thread(lambda: [_summary(one) for one in reversed(stored_runs())]))


async def _run(request: web.Request) -> web.StreamResponse:
    return web.json_response(await asyncio.to_thread(_describe, await chosen_run(request)))


async def _report(request: web.Request) -> web.StreamResponse:
    name = request.match_info["file"]
    if name not in _REPORT_FILES:
        raise web.HTTPNotFound(text=f"a report has the files {', '.join(_REPORT_FILES)}\n")
    run = await chosen_run(request)
    response = await _file(run.report / name, "there is no report yet; it is written at the end of the run")
    response.content_type = _REPORT_FILES[name]
    response.headers["Content-Security-Policy"] = _REPORT_POLICY
    return response


async def _recording(request: web.Request) -> web.StreamResponse:
    run = await chosen_run(request)
    response = await _file(run.recording, "this run was not recorded")
    response.content_type = "application/octet-stream"
    response.headers["Content-Disposition"] = f'attachment; filename="{run.id}.mcap"'
    return response


async def _logs(request: web.Request) -> web.StreamResponse:
    return web.json_response(sorted(await asyncio.to_thread(_log_files, await chosen_run(request))))


async def _log(request: web.Request) -> web.StreamResponse:
    files = await asyncio.to_thread(_log_files, await chosen_run(request))
    path = files.get(request.match_info["process"])
    if path is None:
        raise web.HTTPNotFound(text=f"there are logs of: {', '.join(sorted(files))}\n")
    return web.Response(body=await asyncio.to_thread(_end_of, path), content_type="text/plain", charset="utf-8")


async def _commands(request: web.Request) -> web.StreamResponse:
    run = await chosen_run(request)
    return web.json_response(await asyncio.to_thread(last_commands, run.path / "console_commands.jsonl"))


async def _map(request: web.Request) -> web.StreamResponse:
    name, absent = request.match_info["map"], "there is no such map"
    files = await asyncio.to_thread(_map_files)
    if name not in files:
        raise web.HTTPNotFound(text=f"{absent}\n")
    return await _file(files[name], absent)


def _map_files() -> dict[str, Path]:
    suffixes = (".yaml", ".pgm", ".png")
    return {path.name: path for path in islice(maps_folder().glob("*"), 10_000) if path.suffix in suffixes}


def _log_files(run: Run) -> dict[str, Path]:
    return {path.stem: path for path in run.logs.glob("*.log")}


def last_commands(path: Path) -> list[Any]:
    """Return the last rows of a command journal; empty if it cannot be read."""
    rows = []
    for line in _end_of(path).decode(errors="replace").splitlines()[-MAX_COMMANDS:]:
        try:
            rows.append(parse_json(line))
        except ValueError:
            continue  # the first line was cut, and the last one may still be incomplete
    return rows


def _describe(run: Run) -> dict[str, Any]:
    info, state = run.info(), run.state()
    state.pop("robot", None)  # clients receive the robot's topics
    return {
        "id": run.id,
        "up": run.is_live(),
        "started_s": info.get("started"),
        "options": info.get("options", {}),
        "state": state,
        "result": read_json_object(run.path / "result.json") or None,
    }


def _summary(stored: StoredRun) -> dict[str, Any]:
    return {**result_of(stored.run).as_json(), "size_bytes": stored.size_bytes, "kept": stored.is_kept}


async def chosen_run(request: web.Request) -> Run:
    """Find a request's run by its name (see `choose_id`): text from the client never becomes part of a path."""
    try:
        return choose_run(request.match_info["run"], await asyncio.to_thread(all_runs))
    except RunError as error:
        raise web.HTTPNotFound(text=f"{error}; see /_api/runs\n") from error


async def _file(path: Path, absent: str) -> web.FileResponse:
    if not await asyncio.to_thread(path.is_file):
        raise web.HTTPNotFound(text=f"{absent}\n")
    return web.FileResponse(path)


def _end_of(path: Path) -> bytes:
    """Return the last MAX_LOG_BYTES of a file; empty if it cannot be read."""
    try:
        with open_regular(path) as file:
            file.seek(max(0, path.stat().st_size - MAX_LOG_BYTES))
            return file.read(MAX_LOG_BYTES)
    except OSError:
        return b""
