"""Where the sentences of `lupin voice` come from: lines of text, a sound file, or the microphone."""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import dataclass
from typing import TextIO

from lupin_cli.run.voice_connection import new_identifier
from lupin_runtime.voice.dialog import Agent, Turn
from lupin_runtime.voice.endpointer import Edge, Endpointer
from lupin_runtime.voice.grammar import has_stop_word
from lupin_runtime.voice.recognizer import Recognizer
from lupin_runtime.voice.speech import SpeechUnavailable
from lupin_runtime.voice.spotting_endpointer import SpottingEndpointer

_MAX_READ = 4096


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
    """An edge of the utterance with this id, with its sound at its end; or the end of the microphone, and why."""

    identifier: str
    edge: Edge | None
    sound: bytes = b""
    problem: SpeechUnavailable | None = None


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
        self._stopped = ""  # id of the last utterance that has stopped
        self._stops: set[asyncio.Task[None]] = set()

    async def turns(self) -> AsyncIterator[Turn]:
        """Yield the sentences. Raises SpeechUnavailable when the microphone fails."""
        threading.Thread(target=self._listen, name="lupin-voice-microphone", daemon=True).start()
        ignored = ""
        while (event := await self._events.get()).edge is not None:
            if event.edge is Edge.BEGIN and self._is_talking():
                ignored = event.identifier
            if ignored != event.identifier:
                await self._announce(event.identifier, ended=event.edge is Edge.END)
            if event.edge is Edge.BEGIN:
                continue
            sentence = await asyncio.to_thread(self._recognizer.transcribe, event.sound)
            if self._stopped == event.identifier:
                continue
            has_stop = has_stop_word(sentence)
            if has_stop:
                self._stopped = event.identifier
            if ignored != event.identifier or has_stop:
                yield Turn(sentence, "speech", event.identifier)
        await asyncio.gather(*self._stops)
        if event.problem is not None:
            raise event.problem

    async def _announce(self, identifier: str, *, ended: bool) -> None:
        if self._agent is not None:
            await self._agent.announce_turn(identifier, "speech", ended=ended)

    # -- in the thread of the microphone --------------------------------------------------------------------------------
    def _listen(self) -> None:
        identifier, problem = "", None
        spotting = SpottingEndpointer(self._recognizer, lambda text: self._post_stop(identifier, text))
        try:
            for frame in self._frames:
                edge = spotting.push(frame)
                if edge is Edge.BEGIN:
                    identifier = new_identifier()
                if edge is not None:
                    sound = spotting.utterance if edge is Edge.END else b""
                    self._post(_Event(identifier, edge, sound))
        except SpeechUnavailable as error:
            problem = error
        spotting.close()
        self._post(_Event("", None, problem=problem))

    def _post(self, event: _Event) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended, after Ctrl-C
            self._loop.call_soon_threadsafe(self._events.put_nowait, event)

    def _post_stop(self, identifier: str, text: str) -> None:
        def start() -> None:
            if self._stopped == identifier:  # the whole sentence was recognized before
                return
            self._stopped = identifier
            task = asyncio.ensure_future(self._stop(Turn(text, "speech", identifier)))
            self._stops.add(task)
            task.add_done_callback(self._stops.discard)

        with contextlib.suppress(RuntimeError):  # as above
            self._loop.call_soon_threadsafe(start)
