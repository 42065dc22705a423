"""Asks the command line's program: what it prints with `--json` is all that the console knows of playbooks and the doctor."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Sequence
from typing import Any

_STOP_TIMEOUT_S = 5.0


class ProgramError(RuntimeError):
    """The program did not do what was asked for; the text says why."""


class LupinProgram:
    """`command` is the program and its first arguments, as a list. For the event loop only."""

    def __init__(self, command: Sequence[str]) -> None:
        self._command = list(command)

    async def run(self, arguments: Sequence[str], timeout_s: float) -> Any:
        """The JSON that a command prints. Raises ProgramError."""
        pipe = asyncio.subprocess.PIPE
        process = await asyncio.create_subprocess_exec(
            *self._command, *arguments, stdin=asyncio.subprocess.DEVNULL, stdout=pipe, stderr=pipe
        )
        try:
            output, errors = await asyncio.wait_for(process.communicate(), timeout_s)
        except asyncio.TimeoutError:
            raise ProgramError(f"lupin {arguments[0]} did not end within {timeout_s:g} s") from None
        finally:
            if process.returncode is None:
                await _end(process)
        try:
            return json.loads(output)
        except ValueError:
            said = errors.decode(errors="replace").strip().splitlines()
            raise ProgramError(f"lupin {arguments[0]}: {said[-1] if said else f'ended with {process.returncode}'}") from None


async def _end(process: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        await asyncio.wait_for(process.wait(), _STOP_TIMEOUT_S)
    except asyncio.TimeoutError:
        process.kill()
        await process.wait()
