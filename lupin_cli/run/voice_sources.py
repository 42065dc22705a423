"""Where the sentences of `lupin voice` come from: lines of text, a sound file, or the microphone."""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import dataclass
from typing import Any, TextIO, TypeVar

from lupin_cli.run.voice_connection import new_identifier
from lupin_runtime.voice.dialog import Agent, Turn
from lupin_runtime.voice.endpointer import Edge, Endpointer
from lupin_runtime.voice.grammar import has_stop_word
from lupin_runtime.voice.recognizer import Recognizer
from lupin_runtime.voice.speech import SpeechUnavailable
from lupin_runtime.voice.spotting_endpointer import SpottingEndpointer

_MAX_READ = 4096
_KEPT_STOPS = 8
_STOP_TIMEOUT_S = 2.0  # for each step of stops that were said before the microphone was lost

Result = TypeVar("Result")


async def read_lines(stream: TextIO) -> AsyncIterator[Turn]:
    """Yield each line of a terminal, a pipe or a file as a turn."""
    loop, queue = asyncio.get_running_loop(), asyncio.Queue[bytes]()
    descriptor = stream.fileno()
    try:
        loop.add_reader(descriptor, lambda: queue.put_nowait(os.read(descriptor, _MAX_READ)))
    except PermissionError:  # a file, which is always ready
        for line in stream:
            if sentence := line.strip():
                yield Turn(sentence, "text", new_identifier())
        return
    try:
        rest = b""
        while read := await queue.get():
            *lines, rest = (rest + read).split(b"\n")
            for each in lines:
                if sentence := each.decode(errors="replace").strip():
                    yield Turn(sentence, "text", new_identifier())
        if sentence := rest.decode(errors="replace").strip():
            yield Turn(sentence, "text", new_identifier())
    finally:
        loop.remove_reader(descriptor)


async def hear_file(frames: Iterator[bytes], recognizer: Recognizer) -> AsyncIterator[Turn]:
    """Yield what is said in a sound, utterance by utterance."""
    for sound in _utterances(frames):
        if sentence := await asyncio.to_thread(recognizer.transcribe, sound):
            yield Turn(sentence, "speech", new_identifier())


def _utterances(frames: Iterator[bytes]) -> Iterator[bytes]:
    endpointer = Endpointer()
    for frame in frames:
        if endpointer.push(frame) is Edge.END:
            yield endpointer.utterance
    if endpointer.is_speaking:
        yield endpointer.utterance


@dataclass(frozen=True)
class _Event:
    """An edge of the utterance with this id, with its sound at its end; without an edge, the end of the sound."""

    identifier: str
    edge: Edge | None
    sound: bytes = b""


class Microphone:
    """Yields what is said to a microphone, and calls `stop` as soon as a word for stopping is heard.

    Speech that begins while `is_talking` returns true is the robot's own; only its words for stopping count, of which it speaks
    none. `agent` is told when a speaker begins and ends; None in a dry run. A sentence is empty if nothing was understood: for
    the console it was a turn all the same.
    """

    def __init__(
        self,
        frames: Iterator[bytes],
        recognizer: Recognizer,
        agent: Agent | None,
        stop: Callable[[Turn], Awaitable[None]],
        is_talking: Callable[[], bool],
    ) -> None:
        self._frames = frames
        self._recognizer = recognizer
        self._agent = agent
        self._stop = stop
        self._is_talking = is_talking
        self._loop = asyncio.get_running_loop()
        self._events = deque[_Event]()  # that are not taken yet
        self._has_event = asyncio.Event()
        self._spotted = deque[str](maxlen=_KEPT_STOPS)  # ids of the last utterances in which a stop was spotted,
        self._read = deque[str](maxlen=_KEPT_STOPS)  # and of those whose whole sentence had one
        self._stops: set[asyncio.Task[None]] = set()
        self._in_work: tuple[str, asyncio.Future[str]] | None = None  # the utterance that is being recognized
        self._cut: _Event | None = None  # the utterance in which the microphone was lost
        self._lost: asyncio.Future[Exception] = self._loop.create_future()  # done once no stop is heard, or one has failed

    async def turns(self) -> AsyncIterator[Turn]:
        """Yield the sentences. Raises SpeechUnavailable as soon as the microphone is lost, whatever is in work, but a stop.

        Raises also what `stop` raises.
        """
        threading.Thread(target=self._listen, name="lupin-voice-microphone", daemon=True).start()
        ignored = ""
        while (event := await self._next_event()).edge is not None:
            if event.edge is Edge.BEGIN and self._is_talking():
                ignored = event.identifier
            if event.edge is Edge.END:
                self._in_work = event.identifier, asyncio.ensure_future(self._transcribe(event))
            if ignored != event.identifier:
                await self._unless_lost(self._announce(event.identifier, ended=event.edge is Edge.END))
            if self._in_work is None:
                continue
            sentence = await self._unless_lost(self._in_work[1])
            self._in_work = None
            if event.identifier in self._spotted:
                continue
            has_stop = has_stop_word(sentence)
            if has_stop:
                self._read.append(event.identifier)
            if ignored != event.identifier or has_stop:
                yield Turn(sentence, "speech", event.identifier)
        await self._unless_lost(asyncio.gather(*self._stops))

    async def _next_event(self) -> _Event:
        """Take the next event. None is taken while it is waited for: a loss meanwhile leaves it to `_stop_all_the_same`."""
        while not self._events:
            self._has_event.clear()
            await self._unless_lost(self._has_event.wait())
        return self._events.popleft()

    async def _unless_lost(self, work: Awaitable[Result]) -> Result:
        task = asyncio.ensure_future(work)
        waited: tuple[asyncio.Future[Any], ...] = (task, self._lost)
        try:
            await asyncio.wait(waited, return_when=asyncio.FIRST_COMPLETED)
            if self._lost.done():
                await self._stop_all_the_same()
                raise self._lost.result()
            return task.result()
        finally:
            task.cancel()

    async def _stop_all_the_same(self) -> None:
        """Look for stops in the utterances that are not recognized yet, and wait until all that were heard are carried out."""
        unread = [*self._events, *([] if self._cut is None else [self._cut])]
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_STOP_TIMEOUT_S):
                if self._in_work is not None:
                    self._stop_if_said(self._in_work[0], await self._in_work[1])
                for event in unread:
                    if event.edge is Edge.END:
                        self._stop_if_said(event.identifier, await self._transcribe(event))
        if self._stops:
            await asyncio.wait(self._stops, timeout=_STOP_TIMEOUT_S)

    def _stop_if_said(self, identifier: str, sentence: str) -> None:
        if identifier not in self._spotted and has_stop_word(sentence):
            self._begin_stop(Turn(sentence, "speech", identifier))

    def _begin_stop(self, turn: Turn) -> None:
        task = asyncio.ensure_future(self._stop(turn))
        self._stops.add(task)
        task.add_done_callback(self._end_stop)

    def _end_stop(self, task: asyncio.Task[None]) -> None:
        self._stops.discard(task)
        if not task.cancelled() and isinstance(error := task.exception(), Exception):
            self._note_loss(error)

    async def _transcribe(self, event: _Event) -> str:
        return await asyncio.to_thread(self._recognizer.transcribe, event.sound)

    async def _announce(self, identifier: str, *, ended: bool) -> None:
        if self._agent is not None:
            await self._agent.announce_turn(identifier, "speech", ended=ended)

    # -- in the thread of the microphone --------------------------------------------------------------------------------
    def _listen(self) -> None:
        prefix = new_identifier()

        def identifier(number: int) -> str:
            return f"{prefix}-{number}"

        spotting = SpottingEndpointer(self._recognizer, lambda text, number: self._post_stop(identifier(number), text))
        failure: Exception | None = None
        try:
            for frame in self._frames:
                edge = spotting.push(frame)
                if edge is not None:
                    sound = spotting.utterance if edge is Edge.END else b""
                    self._post(_Event(identifier(spotting.number), edge, sound))
        except SpeechUnavailable as error:
            failure = error
        except Exception as error:  # whatever a sound system raises; a session that hears nothing must not go on
            failure = SpeechUnavailable(f"listening has failed: {error!r}")
        if spotting.is_speaking:  # no command is taken from a sentence that was cut off, but a stop
            self._cut = _Event(identifier(spotting.number), Edge.END, spotting.utterance)
        spotting.close()  # after the window that it hears now
        if failure is not None:
            self._call(self._note_loss, failure)
        self._post(_Event("", None))

    def _post(self, event: _Event) -> None:
        self._call(self._take_event, event)

    def _take_event(self, event: _Event) -> None:
        self._events.append(event)
        self._has_event.set()

    def _call(self, function: Callable[[Any], None], argument: Any) -> None:
        """Call a function in the event loop."""
        with contextlib.suppress(RuntimeError):  # the loop has ended, after Ctrl-C
            self._loop.call_soon_threadsafe(function, argument)

    def _post_stop(self, identifier: str, text: str) -> None:
        def start(text: str) -> None:
            if identifier in self._read:  # the whole sentence was recognized before
                return
            self._spotted.append(identifier)
            self._begin_stop(Turn(text, "speech", identifier))

        self._call(start, text)

    def _note_loss(self, problem: Exception) -> None:
        if not self._lost.done():
            self._lost.set_result(problem)
