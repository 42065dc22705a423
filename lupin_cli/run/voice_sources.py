"""Where the sentences of `lupin voice` come from: lines of text, a sound file, or the microphone."""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Iterator
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
_STOP_TIMEOUT_S = 2.0

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
        self._events = asyncio.Queue[_Event]()
        self._spotted = deque[str](maxlen=_KEPT_STOPS)  # ids of the last utterances in which a stop was spotted,
        self._read = deque[str](maxlen=_KEPT_STOPS)  # and of those whose whole sentence had one
        self._stops: set[asyncio.Task[None]] = set()
        self._lost: asyncio.Future[SpeechUnavailable] = self._loop.create_future()  # done once the microphone is lost

    async def turns(self) -> AsyncIterator[Turn]:
        """Yield the sentences. Raises SpeechUnavailable as soon as the microphone is lost, whatever is in work."""
        threading.Thread(target=self._listen, name="lupin-voice-microphone", daemon=True).start()
        ignored = ""
        while (event := await self._unless_lost(self._events.get())).edge is not None:
            if event.edge is Edge.BEGIN and self._is_talking():
                ignored = event.identifier
            if ignored != event.identifier:
                await self._unless_lost(self._announce(event.identifier, ended=event.edge is Edge.END))
            if event.edge is Edge.BEGIN:
                continue
            sentence = await self._unless_lost(asyncio.to_thread(self._recognizer.transcribe, event.sound))
            if event.identifier in self._spotted:
                continue
            has_stop = has_stop_word(sentence)
            if has_stop:
                self._read.append(event.identifier)
            if ignored != event.identifier or has_stop:
                yield Turn(sentence, "speech", event.identifier)
        await asyncio.gather(*self._stops)

    async def _unless_lost(self, work: Coroutine[Any, Any, Result]) -> Result:
        task = asyncio.ensure_future(work)
        waited: tuple[asyncio.Future[Any], ...] = (task, self._lost)
        try:
            await asyncio.wait(waited, return_when=asyncio.FIRST_COMPLETED)
            if self._lost.done():
                if self._stops:  # a stop that was heard is carried out all the same
                    await asyncio.wait(self._stops, timeout=_STOP_TIMEOUT_S)
                raise self._lost.result()
            return task.result()
        finally:
            task.cancel()

    async def _announce(self, identifier: str, *, ended: bool) -> None:
        if self._agent is not None:
            await self._agent.announce_turn(identifier, "speech", ended=ended)

    # -- in the thread of the microphone --------------------------------------------------------------------------------
    def _listen(self) -> None:
        prefix = new_identifier()

        def identifier(number: int) -> str:
            return f"{prefix}-{number}"

        spotting = SpottingEndpointer(self._recognizer, lambda text, number: self._post_stop(identifier(number), text))
        try:
            for frame in self._frames:
                edge = spotting.push(frame)
                if edge is not None:
                    sound = spotting.utterance if edge is Edge.END else b""
                    self._post(_Event(identifier(spotting.number), edge, sound))
        except SpeechUnavailable as error:
            self._call(self._note_loss, error)
        spotting.close()  # after the window that it hears now
        self._post(_Event("", None))

    def _post(self, event: _Event) -> None:
        self._call(self._events.put_nowait, event)

    def _call(self, function: Callable[[Any], None], argument: Any) -> None:
        """Call a function in the event loop."""
        with contextlib.suppress(RuntimeError):  # the loop has ended, after Ctrl-C
            self._loop.call_soon_threadsafe(function, argument)

    def _post_stop(self, identifier: str, text: str) -> None:
        def start(text: str) -> None:
            if identifier in self._read:  # the whole sentence was recognized before
                return
            self._spotted.append(identifier)
            task = asyncio.ensure_future(self._stop(Turn(text, "speech", identifier)))
            self._stops.add(task)
            task.add_done_callback(self._stops.discard)

        self._call(start, text)

    def _note_loss(self, problem: SpeechUnavailable) -> None:
        self._lost.set_result(problem)
