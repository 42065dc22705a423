"""Runs the `lupin` command: the console knows about playbooks and the doctor only what that prints with `--json`."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from typing import Any

from lupin_runtime.interpreter import PYTHON
from lupin_runtime.json_text import parse_json

LUPIN = (*PYTHON, "-m", "lupin_cli.app")  # the program whose `doctor` and `play` the console offers
_STOP_TIMEOUT_S = 5.0  # before the command is killed


class ProgramError(RuntimeError):
    """The command failed; the text says why."""


class LupinProgram:
    """Runs `command`, the program with its first arguments. For the event loop only."""

    def __init__(self, command: Sequence[str]) -> None:
        self._command = list(command)

    async def run(self, arguments: Sequence[str], timeout_s: float) -> Any:
        """Run a subcommand and return the JSON that it prints. Raises ProgramError."""
        pipe = asyncio.subprocess.PIPE
        process = await asyncio.create_subprocess_exec(
            *self._command, *arguments, stdin=asyncio.subprocess.DEVNULL, stdout=pipe, stderr=pipe
        )
        try:
            output, errors = await asyncio.wait_for(process.communicate(), timeout_s)
        except asyncio.TimeoutError:
            raise ProgramError(f"lupin {arguments[0]} did not finish within {timeout_s:g} s") from None
        finally:
            if process.returncode is None:
                await _terminate(process)
        try:
            return parse_json(output)
        except ValueError:
            lines = errors.decode(errors="replace").strip().splitlines()
            reason = lines[-1] if lines else f"exited with status {process.returncode}"
            raise ProgramError(f"lupin {arguments[0]}: {reason}") from None


async def _terminate(process: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    await end_or_kill(process, _STOP_TIMEOUT_S)


async def end_or_kill(process: asyncio.subprocess.Process, timeout_s: float) -> None:
    """Wait until a process has ended; kill one that does not in time."""
    try:
        await asyncio.wait_for(process.wait(), timeout_s)
    except asyncio.TimeoutError:
        process.kill()
        await process.wait()
    finally:
        if process.returncode is None:  # the console stops, and waits no longer
            process.kill()
