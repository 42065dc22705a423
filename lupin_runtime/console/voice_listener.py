"""The listener of the console: a process that hears the sound of one page at a time (`lupin_runtime/voice/listener.py`).

It is started when a page asks for it, and ended when that page does not need it any more. Whatever becomes of it, the console
goes on: sound that it does not take is dropped, and if it ends, the page is told, and may ask again.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from lupin_runtime.console.authority import Session
from lupin_runtime.console.program import end_or_kill
from lupin_runtime.interpreter import PYTHON
from lupin_runtime.json_text import parse_json
from lupin_runtime.voice.listener_protocol import Kind, encode
from lupin_runtime.voice.recognizer import missing_packages

COMMAND = (*PYTHON, "-m", "lupin_runtime.voice.listener")
MAX_SOUNDS = 40  # frames that wait, 2 s; older ones are of no use to a stop
MAX_DROPPED = 200  # frames, 10 s
MAX_MARKS = 100
MAX_ENDING = 2  # processes that are being ended while another is started
MAX_EVENTS_PER_S = 50
START_TIMEOUT_S = 120.0  # of a process that loads its model on a busy computer
_PIPE_BYTES = 16_000
_END_TIMEOUT_S = 2.0
_CLOSE_TIMEOUT_S = 5.0

# Reasons.
BUSY = "the console listens to {name}"
STILL_ENDING = "the processes before are still ending; ask again"
NOT_READY = f"it was not ready within {START_TIMEOUT_S:g} s; it is started again when you begin to speak"
TAKES_NOTHING = "it took no sound for 10 s, and was ended; it is started again when you begin to speak"
ENDED = "it ended by itself; it is started again when you begin to speak"
ENDED_WITH = "it ended by itself ({reason}); it is started again when you begin to speak"


@dataclass(frozen=True)
class ListenerState:
    """What a page is told: `off`, `starting`, `ready`, `missing`, `failed` or `busy`, and why."""

    name: str = "off"
    reason: str = ""


class ListenerUser(Protocol):
    """The page that is listened to."""

    @property
    def session(self) -> Session:
        """Whose page it is."""

    def listener_changed(self, state: ListenerState) -> None:
        """The listener is in another state."""

    def stop_heard(self, text: str, turn: str) -> None:
        """A word for stopping was heard, in the turn with this id; empty if in none, or in several."""

    def turn_heard(self, identifier: str, text: str) -> None:
        """A turn was recognized; the text is empty if nothing was understood."""


class VoiceListener:
    """The one listener of a console. For the event loop only; `command` is the process to start."""

    def __init__(self, command: Sequence[str] | None = None) -> None:
        self._command = tuple(command or COMMAND)
        self._needs_packages = command is None
        self._process: _Process | None = None
        self._ending: set[asyncio.Task[None]] = set()
        self._is_closed = False

    def start(self, user: ListenerUser) -> ListenerState:
        """Begin to listen to a page, and return the state. One of the same session is listened to no longer."""
        if self._process is not None and self._process.is_alive and self._process.user.session != user.session:
            return ListenerState("busy", BUSY.format(name=self._process.user.session.name))
        if self._needs_packages and (reason := missing_packages()):
            return ListenerState("missing", reason)
        self._end()
        if self._is_closed:
            return ListenerState()
        if len(self._ending) > MAX_ENDING:
            return ListenerState("failed", STILL_ENDING)
        self._process = _Process(self._command, user)
        return self._process.state

    def send(self, user: ListenerUser, kind: Kind, payload: bytes) -> None:
        """Send a message of a page's, if it is the one that is listened to."""
        if self._process is not None and self._process.user is user:
            self._process.send(kind, payload)

    def stop(self, user: ListenerUser) -> None:
        """Listen to a page no longer, if it is the one."""
        if self._process is not None and self._process.user is user:
            self._end()

    async def close(self) -> None:
        """End the process, and wait for its end."""
        self._is_closed = True
        self._end()
        if self._ending:
            await asyncio.wait(self._ending, timeout=_CLOSE_TIMEOUT_S)

    def _end(self) -> None:
        if self._process is not None:
            task = self._process.end()
            self._ending.add(task)
            task.add_done_callback(self._ending.discard)
            self._process = None


class _Process:
    """One process, from its start to its end. Sound is sent once it is ready."""

    def __init__(self, command: Sequence[str], user: ListenerUser) -> None:
        self.user = user
        self.state = ListenerState("starting")
        self._is_ending = False
        self._is_dropped = False  # whether its user must not hear of it any more
        self._waiting: deque[tuple[Kind, bytes]] = deque()
        self._filled = asyncio.Event()
        self._dropped = 0  # frames since one was taken
        self._task = asyncio.ensure_future(self._run(command))
        self._start_limit = asyncio.get_running_loop().call_later(START_TIMEOUT_S, self._give_up)

    def _give_up(self) -> None:
        if self.state.name == "starting":
            self._change("failed", NOT_READY)
            self._cancel()

    @property
    def is_alive(self) -> bool:
        return self.state.name in ("starting", "ready")

    def end(self) -> asyncio.Task[None]:
        """End the process, and return the task that does it. Its user hears no more of it."""
        self._is_dropped = True
        self._cancel()
        return self._task

    def _cancel(self) -> None:
        if not self._is_ending:  # or it would no longer wait for the end of the process
            self._is_ending = True
            self._task.cancel()

    def send(self, kind: Kind, payload: bytes) -> None:
        if not self.is_alive or (kind is Kind.SOUND and self.state.name != "ready"):
            return
        self._waiting.append((kind, payload))
        sounds = [each for each in self._waiting if each[0] is Kind.SOUND]
        if len(sounds) > MAX_SOUNDS:
            self._waiting.remove(sounds[0])
            self._dropped += 1
        if self._dropped > MAX_DROPPED or len(self._waiting) - len(sounds) > MAX_MARKS:
            self._change("failed", TAKES_NOTHING)
            self._cancel()
        self._filled.set()

    def _change(self, name: str, reason: str = "") -> None:
        if not self.is_alive:
            return
        self.state = ListenerState(name, reason)
        if not self._is_dropped:
            self.user.listener_changed(self.state)

    async def _run(self, command: Sequence[str]) -> None:
        pipe = asyncio.subprocess.PIPE
        try:
            process = await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe, stderr=pipe)
        except OSError as error:
            self._change("failed", str(error))
            return
        assert process.stdin is not None and process.stdout is not None and process.stderr is not None
        writer = asyncio.ensure_future(self._write(process.stdin))
        last_line = asyncio.ensure_future(_last_line(process.stderr))
        try:
            await self._read(process.stdout)
            reason = await last_line
            self._change("failed", ENDED_WITH.format(reason=reason) if reason else ENDED)
        except ValueError as error:  # a line that is no event, or is too long
            self._change("failed", f"it sent what is no event: {error}")
            with contextlib.suppress(ProcessLookupError):
                process.kill()
        finally:
            self._change("failed", ENDED)
            self._is_ending = True
            self._start_limit.cancel()
            process.stdin.close()
            writer.cancel()
            # A pipe that nobody reads keeps the end of the process from being noticed.
            rest = asyncio.ensure_future(_last_line(process.stdout))
            try:
                await end_or_kill(process, _END_TIMEOUT_S)
            finally:
                last_line.cancel()
                rest.cancel()

    async def _write(self, pipe: asyncio.StreamWriter) -> None:
        pipe.transport.set_write_buffer_limits(high=_PIPE_BYTES)
        with contextlib.suppress(ConnectionError):  # it has ended, which the reader finds
            while True:
                await self._filled.wait()
                self._filled.clear()
                while self._waiting:
                    kind, payload = self._waiting.popleft()
                    pipe.write(encode(kind, payload))
                    await pipe.drain()
                    self._dropped = 0

    async def _read(self, pipe: asyncio.StreamReader) -> None:
        loop, began_s, count = asyncio.get_running_loop(), 0.0, 0
        while line := await pipe.readline():
            if loop.time() - began_s > 1.0:
                began_s, count = loop.time(), 0
            count += 1
            if count > MAX_EVENTS_PER_S:
                raise ValueError(f"more than {MAX_EVENTS_PER_S} lines in a second")
            event = parse_json(line)
            if self._is_dropped or not isinstance(event, dict):
                continue
            if "ready" in event:
                self._change("ready")
            elif "missing" in event:
                self._change("missing", str(event["missing"]))
            elif "stop" in event:
                self.user.stop_heard(str(event["stop"]), str(event.get("id", "")))
            elif isinstance(heard := event.get("heard"), dict):
                self.user.turn_heard(str(heard.get("id")), str(heard.get("text")))


async def _last_line(pipe: asyncio.StreamReader) -> str:
    """Return the last line that is not empty."""
    last = b""
    while chunk := await pipe.read(4096):
        last = (last + chunk)[-4096:]
    lines = last.decode(errors="replace").strip().splitlines()
    return lines[-1][-300:] if lines else ""
