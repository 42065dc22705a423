"""The API's resources about playbooks: the playbook runs in the journal, and the last deploy to each robot."""

from __future__ import annotations

import asyncio
import re
import time
from typing import Any

from aiohttp import web

from lupin_runtime.console.api_table import Resource
from lupin_runtime.console.program import LupinProgram, ProgramError

_TIMEOUT_S = 20.0
_FRESH_S = 1.0  # how long an answer is given again: each one takes a Python process
_MAX_LISTED = 200
_DEPLOY = "deploy-robot"
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.:@+-]{0,199}")


class Plays:
    """Reads the journal with `lupin journal`, which needs no connection to a robot. It runs once at a time."""

    def __init__(self, program: LupinProgram) -> None:
        self._program = program
        self._lock = asyncio.Lock()
        self._answers: dict[tuple[str, ...], tuple[float, Any, str]] = {}  # time in s, answer, and why there is none

    def resources(self) -> tuple[Resource, ...]:
        """Return the routes, each with a summary of its answer."""
        return (
            Resource(
                "/_api/plays",
                self._plays,
                f"The last {_MAX_LISTED} playbook runs, newest first: playbook, robot, state, and the command to resume.",
            ),
            Resource("/_api/plays/{play}", self._play, "One playbook run, with its steps."),
            Resource("/_api/deployments", self._deployments, "The last deploy to each robot, and its result."),
        )

    async def _plays(self, _: web.Request) -> web.StreamResponse:
        return web.json_response(await self._listed())

    async def _play(self, request: web.Request) -> web.StreamResponse:
        play = request.match_info["play"]
        if not _ID.fullmatch(play) or play not in [each["run"] for each in await self._listed()]:
            raise web.HTTPNotFound(text="there is no such playbook run; see /_api/plays\n")
        return web.json_response(_without_path(await self._journal("show", "--json", play)))

    async def _deployments(self, _: web.Request) -> web.StreamResponse:
        newest: dict[str, dict[str, Any]] = {}
        for play in await self._listed():
            if play["playbook"] == _DEPLOY and not play["undo_of"]:
                newest.setdefault(play["robot"], play)
        return web.json_response(list(newest.values()))

    async def _listed(self) -> list[dict[str, Any]]:
        rows = await self._journal("list", "--json", "-n", str(_MAX_LISTED))
        return [_without_path(row) for row in rows]

    async def _journal(self, *arguments: str) -> Any:
        async with self._lock:
            now_s = time.monotonic()
            self._answers = {key: each for key, each in self._answers.items() if now_s - each[0] <= _FRESH_S}
            if arguments not in self._answers:
                answer, problem = None, ""
                try:
                    answer = await self._program.run(["journal", *arguments], _TIMEOUT_S)
                except ProgramError as error:
                    problem = str(error)
                self._answers[arguments] = time.monotonic(), answer, problem
            _, answer, problem = self._answers[arguments]
        if problem:
            raise web.HTTPServiceUnavailable(text=f"{problem}\n")
        return answer


def _without_path(play: dict[str, Any]) -> dict[str, Any]:
    """Remove the path of a playbook run's journal, which is not for clients."""
    return {name: value for name, value in play.items() if name != "path"}
