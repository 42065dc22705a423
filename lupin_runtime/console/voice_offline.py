"""The voice agent without a model, in the console: the grammar makes calls of what a page's operator types or says.

Its calls are those of the voice session, so they pass the same envelope as those of a model. A turn in speech is recognized by
the listener; what is recognized once another turn has begun, or after a stop, is dropped.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from typing import Any, Protocol

from lupin_runtime.console.voice_hearing import Hearing
from lupin_runtime.voice.dialog import Dialog, Reply, Turn
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.grammar import has_stop_word
from lupin_runtime.voice.language import Language
from lupin_runtime.voice.languages import LANGUAGES
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.speech import Speaker, SpeechUnavailable
from lupin_runtime.voice.utterance import Confirmation

MAX_SENTENCES = 20  # that wait
MAX_TEXT = 2000
_NAMES_AGE_S = 10.0
_NAMES_TIMEOUT_S = 1.0  # a sentence is handled without the names of an arm's library that does not answer

# Reasons.
OUTDATED = "another turn or a stop came before it was understood; say it again"
TOO_MANY = f"{MAX_SENTENCES} sentences wait; wait for their answers"
BAD_SAY = f"say must have an id, text of 1 to {MAX_TEXT} characters, and language: one of {', '.join(LANGUAGES)}"
BAD_ANSWER = "answer must have an id, and agrees: true or false"


class BadSentence(ValueError):
    """A sentence or an answer that is refused; the text says why."""


class SessionCalls(Protocol):
    """The voice session, as its offline agent uses it."""

    @property
    def state(self) -> Mapping[str, Any]:
        """The state of the session."""

    @property
    def turn(self) -> int:
        """The number of the present turn."""

    def announce(self, identifier: str, by: str, *, ended: bool) -> None:
        """Begin or end a turn of the operator."""

    def begin_call(self, name: str, values: Any, answer: Callable[[dict[str, Any]], None]) -> None:
        """Judge a call and carry it out; `answer` is called once."""

    def cancel(self) -> None:
        """Drop what waits, as the operator says no."""

    def stop_at_once(self, text: str) -> None:
        """Engage the stop, as a word for it was heard."""

    async def read_names(self) -> Names:
        """Return the names that exist."""

    def log_failure(self, what: str) -> None:
        """Note a defect."""


class _Agent:
    """The session behind the dialog's interface."""

    def __init__(self, calls: SessionCalls) -> None:
        self._calls = calls

    @property
    def state(self) -> Mapping[str, Any]:
        return self._calls.state

    async def announce_turn(self, identifier: str, by: str, *, ended: bool = True) -> None:
        self._calls.announce(identifier, by, ended=ended)

    async def call(self, tool: str, arguments: dict[str, Any]) -> dict[str, Any]:
        answered: asyncio.Future[dict[str, Any]] = asyncio.get_running_loop().create_future()

        def answer(response: dict[str, Any]) -> None:
            if not answered.done():  # a stop drops the sentence
                answered.set_result(response)

        self._calls.begin_call(tool, arguments, answer)
        return await answered

    async def interrupt(self) -> None:
        self._calls.cancel()


class OfflineAgent:
    """Handles the sentences of one session, one after the other; stops do not wait. For the event loop only.

    `send` sends a message to the page, and `play` the sound of a reply.
    """

    def __init__(
        self, calls: SessionCalls, hearing: Hearing, send: Callable[[dict[str, Any]], None], play: Callable[[bytes], None]
    ) -> None:
        self._calls = calls
        self._hearing = hearing
        self._send = send
        self._play = play
        self._dialog = Dialog(_Agent(calls), ENGLISH, Names())
        self._order = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()
        self._names: asyncio.Task[None] | None = None
        self._names_read_s = 0.0
        self._spoken: tuple[str, int] | None = None  # id and number of the last turn in speech, unless a stop has ended it
        self._stopped = ""  # id of the turn in speech in which a stop was heard
        self._speaker: Speaker | None = None
        self._is_mute = False  # as there is no speech output

    def close(self) -> None:
        """Drop everything."""
        self.drop()
        if self._names is not None:
            self._names.cancel()

    def drop(self, *, stop_heard: bool = False) -> None:
        """Drop the sentences that wait or are in work, what was read back, and what is being said, as a stop does."""
        if self._spoken is not None and stop_heard:
            self._stopped = self._spoken[0]
        self._spoken = None
        self._dialog.forget()
        for task in self._tasks:
            task.cancel()

    # -- what the page sends --------------------------------------------------------------------------------------------
    def say(self, identifier: str, fields: Mapping[str, Any]) -> None:
        """Handle a typed sentence, whose turn has this id. Raises BadSentence."""
        text, language = fields.get("text"), LANGUAGES.get(str(fields.get("language", "en")))
        if not isinstance(text, str) or not 0 < len(text) <= MAX_TEXT or language is None:
            raise BadSentence(BAD_SAY)
        turn = Turn(text, "text", identifier)
        if has_stop_word(text):
            self.drop()
            self._start(self._reply(turn, lambda: self._dialog.stop(turn)))
        elif self._is_full:
            raise BadSentence(TOO_MANY)
        else:
            self._start(self._in_order(turn, lambda: self._understand(turn, language)))

    def answer(self, identifier: str, fields: Mapping[str, Any]) -> None:
        """Handle a button that answers a read-back, as a turn with this id. Raises BadSentence."""
        agrees = fields.get("agrees")
        if not isinstance(agrees, bool):
            raise BadSentence(BAD_ANSWER)
        if self._is_full:
            raise BadSentence(TOO_MANY)
        turn = Turn("", "button", identifier)
        self._start(self._in_order(turn, lambda: self._dialog.answer(turn, Confirmation(agrees))))

    def begin_speech(self, identifier: str) -> None:
        """Note that a turn in speech has begun."""
        self._spoken = identifier, self._calls.turn
        self._hearing.begin_turn(identifier)

    def end_speech(self, identifier: str) -> None:
        """Have a turn in speech recognized; say why if that cannot be."""
        if self._hearing.mode == "commands" and not self._hearing.end_turn(identifier):
            state = self._hearing.state
            self._report(identifier, "", state.reason or f"the listener is {state.name}")

    # -- what the listener hears ----------------------------------------------------------------------------------------
    def hear(self, identifier: str, text: str) -> None:
        """Handle a turn that was recognized. Words for stopping count, whatever has happened since."""
        if has_stop_word(text):
            self._report(identifier, text)
            if identifier != self._stopped:
                self._calls.stop_at_once(text)
        elif self._spoken != (identifier, self._calls.turn):
            self._report(identifier, text, OUTDATED)
        elif self._is_full:
            self._report(identifier, text, TOO_MANY)
        else:
            self._report(identifier, text)
            if text or self._dialog.waits_for_answer:
                turn = Turn(text, "speech", identifier)
                self._start(self._in_order(turn, lambda: self._understand(turn, ENGLISH)))

    def _report(self, identifier: str, text: str, problem: str = "") -> None:
        self._send({"heard": {"id": identifier, "text": text, "problem": problem}})

    # -- sentences ------------------------------------------------------------------------------------------------------
    @property
    def _is_full(self) -> bool:
        return len(self._tasks) >= MAX_SENTENCES

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        task.add_done_callback(self._note_failure)

    def _note_failure(self, done: asyncio.Task[None]) -> None:
        if not done.cancelled() and (error := done.exception()) is not None:
            self._calls.log_failure(repr(error))

    async def _in_order(self, turn: Turn, work: Callable[[], Awaitable[Reply]]) -> None:
        async with self._order:
            await self._reply(turn, work)

    async def _understand(self, turn: Turn, language: Language) -> Reply:
        await self._wait_for_names()
        if turn.by == "speech" and self._spoken != (turn.identifier, self._calls.turn):
            return Reply(turn.sentence, OUTDATED, False)
        self._dialog.language = language
        return await self._dialog.handle(turn)

    async def _reply(self, turn: Turn, work: Callable[[], Awaitable[Reply]]) -> None:
        reply = await work()
        self._send({"reply": {"id": turn.identifier, **reply.as_object()}})
        # The microphone must not hear a word for stopping from the robot itself.
        if self._hearing.mode == "commands" and not self._is_mute and not has_stop_word(reply.text):
            self._start(self._speak(reply.text, self._calls.turn))

    async def _speak(self, text: str, turn: int) -> None:
        """Send the sound of a reply, unless the operator has begun another turn by then."""
        sound = await asyncio.to_thread(self._synthesize, text)
        if sound and turn == self._calls.turn:
            self._play(sound)

    def _synthesize(self, text: str) -> bytes:
        try:
            self._speaker = self._speaker or Speaker()
            return self._speaker.synthesize(text)
        except SpeechUnavailable:  # the page shows the text
            self._is_mute = True
            return b""

    # -- names ----------------------------------------------------------------------------------------------------------
    def refresh_names(self) -> None:
        """Read the names anew, unless that was done a moment ago."""
        now_s = time.monotonic()
        if self._names is None or (self._names.done() and now_s - self._names_read_s > _NAMES_AGE_S):
            self._names_read_s = now_s
            self._names = asyncio.ensure_future(self._read_names())
            self._names.add_done_callback(self._note_failure)

    async def _wait_for_names(self) -> None:
        self.refresh_names()
        if self._names is not None:
            await asyncio.wait({self._names}, timeout=_NAMES_TIMEOUT_S)

    async def _read_names(self) -> None:
        names = await self._calls.read_names()
        self._dialog.use_names(names)
        self._hearing.expect((*names.locations, *names.poses, *names.sequences))
