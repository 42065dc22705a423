"""The doctor for browsers: runs `lupin doctor` to examine this machine and its graph, and `lupin play` to fix a finding."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

from lupin_runtime.console.program import LupinProgram, ProgramError

EXAMINATION_TIMEOUT_S = 90.0
FIX_TIMEOUT_S = 300.0
# Reasons of refusals.
BUSY = "the doctor is {what}; wait until it has finished"
NO_SUCH_FINDING = "the last diagnosis has no such finding; examine again"


class DoctorError(RuntimeError):
    """A request cannot be carried out; the text says why and what to do."""


class Doctor:
    """Runs one examination or fix at a time.

    `changed` is called with the state whenever it changes: what the doctor is doing, the last diagnosis as printed by
    `lupin doctor --json`, its time (Unix time in s), and what went wrong. For the event loop only.
    """

    def __init__(self, program: LupinProgram, changed: Callable[[dict[str, Any]], None]) -> None:
        self._program = program
        self._changed = changed
        self._task: asyncio.Task[None] | None = None
        self._state: dict[str, Any] = {"busy": "", "diagnosis": None, "examined_s": None, "problem": ""}

    @property
    def state(self) -> dict[str, Any]:
        """The state that `changed` was last called with."""
        return self._state

    def start_examination(self) -> None:
        """Start an examination, unless one is running. Raises DoctorError while a fix is being played or previewed."""
        if self._state["busy"] == "examining":
            return
        self._require_idle()
        self._update(busy="examining", problem="")
        self._task = asyncio.create_task(self._examine())

    async def fix(self, finding_id: str, *, dry_run: bool) -> dict[str, Any]:
        """Play or preview the fix of a finding of the last diagnosis; returns what `lupin play --json` prints.

        A played fix is followed by another examination. Raises DoctorError.
        """
        fix = self._fix_of(finding_id)
        self._require_idle()
        arguments = ["play", fix["playbook"], "--json", "--dry-run" if dry_run else "--yes"]
        for name, value in fix["variables"].items():
            arguments += ["--var", f"{name}={value}"]
        self._update(busy=f"{'previewing' if dry_run else 'playing'} {fix['playbook']}", problem="")
        try:
            return await self._run(arguments, FIX_TIMEOUT_S)
        finally:
            self._update(busy="")
            if not dry_run:
                self.start_examination()

    async def close(self) -> None:
        """Cancel a running examination."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    def _require_idle(self) -> None:
        if self._state["busy"]:
            raise DoctorError(BUSY.format(what=self._state["busy"]))

    def _fix_of(self, finding_id: str) -> dict[str, Any]:
        roots = (self._state["diagnosis"] or {}).get("findings", [])
        findings = [*roots, *(each for root in roots for each in root["consequences"])]
        found = next((finding for finding in findings if finding["id"] == finding_id), None)
        if found is None:
            raise DoctorError(NO_SUCH_FINDING)
        fix: dict[str, Any] = found["fix"]
        if not fix["playbook"]:
            raise DoctorError(f"no playbook fixes this; fix it by hand: {fix['instruction'] or fix['command']}")
        return fix

    async def _examine(self) -> None:
        try:
            diagnosis = await self._run(["doctor", "--local", "--json"], EXAMINATION_TIMEOUT_S)
            self._update(diagnosis=diagnosis, examined_s=round(time.time(), 3))
        except DoctorError as error:
            self._update(problem=str(error))
        finally:
            self._update(busy="")

    async def _run(self, arguments: list[str], timeout_s: float) -> dict[str, Any]:
        """Run a subcommand and return the JSON object that it prints. Raises DoctorError."""
        try:
            result = await self._program.run(arguments, timeout_s)
        except ProgramError as error:
            raise DoctorError(str(error)) from error
        if not isinstance(result, dict):
            raise DoctorError(f"lupin {arguments[0]} printed no JSON object")
        return result

    def _update(self, **fields: Any) -> None:
        self._state = {**self._state, **fields}
        self._changed(self._state)
