"""Requests for playbook runs share processes: each takes a Python process, and browsers may send any number of requests."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import Any

import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from lupin_runtime.console import plays
from lupin_runtime.console.plays import Plays
from lupin_runtime.console.program import LupinProgram, ProgramError

ROW = {"run": "a", "playbook": "greet", "robot": "", "state": "done", "undo_of": "", "path": "/secret"}


class FakeProgram(LupinProgram):
    """Counts its processes."""

    def __init__(self, problem: str = "") -> None:
        super().__init__(["lupin"])
        self._problem = problem
        self.started = self._running = self.most = 0

    async def run(self, arguments: Sequence[str], timeout_s: float) -> Any:
        assert timeout_s > 0
        self.started += 1
        self._running += 1
        self.most = max(self.most, self._running)
        await asyncio.sleep(0.02)
        self._running -= 1
        if self._problem:
            raise ProgramError(self._problem)
        return [ROW] if "list" in arguments else ROW


def ask(made: Plays, count: int, path: str = "/_api/plays") -> Any:
    handler = next(resource.handler for resource in made.resources() if resource.path == path)
    return asyncio.gather(*(handler(make_mocked_request("GET", path)) for _ in range(count)), return_exceptions=True)


def test_simultaneous_requests_share_one_process() -> None:
    async def scenario() -> None:
        program = FakeProgram()
        made = Plays(program)
        answers = await asyncio.gather(ask(made, 50), ask(made, 50, "/_api/deployments"))
        assert all(isinstance(answer, web.Response) and answer.status == 200 for both in answers for answer in both)
        assert (program.started, program.most) == (1, 1)

    asyncio.run(scenario())


def test_answer_is_renewed_after_a_while(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plays, "_FRESH_S", 0.05)

    async def scenario() -> None:
        program = FakeProgram()
        made = Plays(program)
        await ask(made, 1)
        await asyncio.sleep(0.1)
        await ask(made, 1)
        assert program.started == 2

    asyncio.run(scenario())


def test_failure_is_shared_too() -> None:
    async def scenario() -> None:
        program = FakeProgram("lupin journal did not finish within 20 s")
        answers = await ask(Plays(program), 20)
        assert {type(answer) for answer in answers} == {web.HTTPServiceUnavailable}
        assert program.started == 1

    asyncio.run(scenario())
