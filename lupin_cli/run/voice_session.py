"""A session of `lupin voice`: sentences from a source go through the dialog to the console, and its replies are shown."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path

from lupin_cli.run.voice_connection import Console, VoiceConnection, connect, new_identifier
from lupin_cli.run.voice_sources import Microphone, hear_file, read_lines
from lupin_cli.terminal import confirm, echo, is_interactive
from lupin_runtime.voice.dialog import Dialog, Reply, Turn
from lupin_runtime.voice.endpointer import split_frames
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.grammar import has_stop_word
from lupin_runtime.voice.language import Language
from lupin_runtime.voice.recognizer import CommandRecognizer
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.speech import Speaker, SpeechUnavailable
from lupin_runtime.voice.utterance import Confirmation

NO_CONSOLE = "this run has no console; start one with: lupin console"
NOT_CONFIRMED = "nobody answered the read-back; type both lines: lupin voice --text"
ENGLISH_ONLY = "speech is recognized in English only; for other languages use --text"

# Answers to a read-back that are typed, not spoken: "why" sounds like the letter.
_LETTERS = {"y": True, "j": True, "n": False}


@dataclass(frozen=True)
class Options:
    """What the command was asked for. Without a console, calls are shown and not sent."""

    sentence: str | None
    is_typed: bool
    wav: Path | None
    language: Language
    speaks: bool
    as_json: bool
    console: Console | None


def find_console(run: str | None) -> Console:
    """Return the console of a live run. Raises RunError."""
    from lupin_runtime.console.description import read_description
    from lupin_runtime.stack.runs import RunError, find_live_run

    folder = find_live_run(run).path
    description = read_description(folder) or read_description(folder / "console-foreground")
    if description is None:
        raise RunError(NO_CONSOLE)
    return Console(description.url.rstrip("/"))


def names_of_this_computer() -> Names:
    """Return the names that this computer has stored, for a dry run."""
    from lupin_runtime.arm.library import Library, LibraryError, from_json
    from lupin_runtime.arm.store import default_path
    from lupin_runtime.atomic_file import MalformedFile
    from lupin_runtime.bounded_file import read_bounded_text
    from lupin_runtime.console.locations import all_locations, locations_file

    locations: dict[str, dict[str, float]] = {}
    library = Library()
    with contextlib.suppress(MalformedFile, OSError):
        locations = all_locations(locations_file())
    with contextlib.suppress(LibraryError, OSError, ValueError):
        library = from_json(read_bounded_text(default_path()))
    return Names(tuple(locations), tuple(library.poses), tuple(library.sequences))


def run_session(options: Options) -> bool:
    """Run a session to its end; return whether the last sentence was done.

    Raises ConnectionLost, SpeechUnavailable, BadSound and OSError.
    """
    with contextlib.suppress(KeyboardInterrupt):
        return asyncio.run(_run(options))
    return True


async def _run(options: Options) -> bool:
    opening: contextlib.AbstractAsyncContextManager[VoiceConnection | None] = contextlib.nullcontext()
    if options.console is not None:
        opening = connect(options.console)
    # The microphone, whose end may take seconds, is closed after the connection, whose end is that of control.
    with contextlib.ExitStack() as microphone:
        async with opening as connection:
            names = names_of_this_computer() if connection is None else Names()
            session = _Session(options, connection, Dialog(connection, options.language, names))
            return await session.run(microphone)


class _Session:
    def __init__(self, options: Options, connection: VoiceConnection | None, dialog: Dialog) -> None:
        self._options = options
        self._connection = connection
        self._dialog = dialog
        self._speaker: Speaker | None = None
        self._is_talking = False
        self._is_done = True
        self._waiting: asyncio.Queue[Turn | None] = asyncio.Queue()

    async def run(self, stack: contextlib.ExitStack) -> bool:
        if self._connection is not None:
            await self._dialog.load_names()
        feeder = asyncio.ensure_future(self._feed(self._source(stack)))
        worker = asyncio.ensure_future(self._work())
        running: set[asyncio.Future[None]] = {feeder, worker}
        if self._connection is not None:
            running.add(asyncio.ensure_future(self._connection.wait_until_lost()))
        try:
            await _wait_for(feeder, running)
            self._waiting.put_nowait(None)
            await _wait_for(worker, running)
        finally:
            for task in running:
                task.cancel()
            await asyncio.gather(*running, return_exceptions=True)
        if self._connection is not None:
            await self._connection.wait_until_idle()
        return self._is_done

    def _source(self, stack: contextlib.ExitStack) -> AsyncIterator[Turn]:
        options = self._options
        if options.sentence is not None:
            return _one(options.sentence)
        if options.is_typed:
            if is_interactive():
                echo("type a sentence, for example: what is the battery; end with Ctrl-D", err=True)
            return read_lines(sys.stdin)
        if options.language is not ENGLISH:
            raise SpeechUnavailable(ENGLISH_ONLY)
        if options.wav is not None:
            from lupin_runtime.voice.sounds import read_wav_file

            sound = read_wav_file(options.wav)
            return hear_file(split_frames(sound), CommandRecognizer(self._dialog.names))
        from lupin_runtime.voice.microphone import open_microphone

        recognizer = CommandRecognizer(self._dialog.names)
        if options.speaks:
            self._speaker = Speaker()
        frames = stack.enter_context(open_microphone())
        echo("speak; end with Ctrl-C", err=True)
        return Microphone(frames, recognizer, self._connection, self._stop, lambda: self._is_talking).turns()

    async def _feed(self, source: AsyncIterator[Turn]) -> None:
        """Queue the sentences. A person's stop does not wait, and drops what does; a file and a pipe keep their order."""
        is_live = self._options.wav is None and (is_interactive() or not self._options.is_typed)
        async for turn in source:
            if is_live and has_stop_word(turn.sentence):
                await self._stop(turn)
            elif turn.sentence or self._dialog.waits_for_answer:
                self._waiting.put_nowait(turn)

    async def _work(self) -> None:
        while (turn := await self._waiting.get()) is not None:
            agrees = _LETTERS.get(turn.sentence.lower())
            if self._options.is_typed and self._dialog.waits_for_answer and agrees is not None:
                await self._show(await self._dialog.answer(turn, Confirmation(agrees)))
            else:
                await self._show(await self._dialog.handle(turn))
            if self._options.sentence is not None and self._dialog.waits_for_answer:
                await self._answer_once()

    async def _answer_once(self) -> None:
        """Ask for the answer to the read-back of the only sentence."""
        if not is_interactive():
            echo(NOT_CONFIRMED, err=True)
            return
        agrees = await asyncio.to_thread(confirm, "Yes?")
        turn = Turn("yes" if agrees else "no", "text", new_identifier())
        await self._show(await self._dialog.answer(turn, Confirmation(agrees)))

    async def _stop(self, turn: Turn) -> None:
        while not self._waiting.empty():
            self._waiting.get_nowait()
        await self._show(await self._dialog.stop(turn))

    async def _show(self, reply: Reply) -> None:
        self._is_done = reply.is_done
        if self._options.as_json:
            print(json.dumps(reply.as_object()))
            sys.stdout.flush()
            return
        is_heard = not self._options.is_typed
        echo(f"{f'{reply.sentence!r}: ' if is_heard else ''}{reply.text}")
        # The robot must not hear its own voice say a word for stopping.
        if self._speaker is not None and not has_stop_word(reply.text):
            self._is_talking = True
            try:
                await asyncio.to_thread(self._speaker.say, reply.text)
            except SpeechUnavailable as error:
                echo(str(error), err=True)
                self._speaker = None
            finally:
                self._is_talking = False


async def _one(sentence: str) -> AsyncIterator[Turn]:
    yield Turn(sentence, "text", new_identifier())


async def _wait_for(task: asyncio.Future[None], running: set[asyncio.Future[None]]) -> None:
    """Wait for a task, and raise at once what any of `running` raises: without microphone or connection, nothing goes on."""
    while not task.done():
        await asyncio.wait(running, return_when=asyncio.FIRST_COMPLETED)
        for done in [each for each in running if each.done()]:
            running.remove(done)
            done.result()
