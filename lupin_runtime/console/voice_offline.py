"""The voice agent without a model, in the console: the grammar makes calls of what a page's operator types or says.

Its calls are those of the voice session, so they pass the same envelope as those of a model. A turn in speech is recognized by
the listener; what is recognized once another turn has begun, or after a stop, is dropped.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

from lupin_runtime.console.voice_hearing import Hearing
from lupin_runtime.voice.dialog import Dialog, Reply, Turn, describe
from lupin_runtime.voice.english import ENGLISH
from lupin_runtime.voice.grammar import has_stop_word, sounds_like_stop
from lupin_runtime.voice.language import Language
from lupin_runtime.voice.languages import LANGUAGES
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.sounds import BadSound
from lupin_runtime.voice.speech import Speaker, SpeechUnavailable
from lupin_runtime.voice.tools import BY_NAME, Effect
from lupin_runtime.voice.utterance import Call, Confirmation

MAX_SENTENCES = 20  # that wait
MAX_TEXT = 2000
_NAMES_AGE_S = 10.0
_SPEAK_TIMEOUT_S = 5.0
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

    def stop_at_once(self, text: str, turn: str) -> None:
        """Engage the stop, as a word for it was heard, in the turn with this id; empty if in none, or in several."""

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
        self._spoken_answers = ""  # what was read back when that turn began
        self._stopped = ""  # id of the last turn in speech in which a stop was heard
        self._speaker: Speaker | None = None
        self._is_mute = False  # as there is no speech output
        self._voice = ThreadPoolExecutor(1, "lupin-voice-replies")  # of its own: speech output that hangs delays nothing else

    def close(self) -> None:
        """Drop everything."""
        self.drop()
        self._voice.shutdown(wait=False, cancel_futures=True)
        if self._names is not None:
            self._names.cancel()

    def drop(self, *, stopped: str = "") -> None:
        """Drop the sentences that wait or are in work, what was read back, and what is being said, as a stop does.

        `stopped` is the id of the turn in which a stop was heard, which may not be the present one.
        """
        self._stopped = stopped or self._stopped
        self._spoken = None
        self._hearing.drop_turn()
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
        self._hearing.drop_turn()
        if stop := self._stop_in(text, language):
            self._carry_out_stop(turn, stop)
        elif self._is_full:
            self._answer_at_once(Reply(text, TOO_MANY, False), identifier)
        else:
            spoken, answers = self._spoken, self._dialog.read_back
            self._start(self._in_order(turn, lambda: self._understand(turn, language, spoken, answers)))

    def answer(self, identifier: str, fields: Mapping[str, Any]) -> None:
        """Handle a button that answers a read-back, as a turn with this id. Raises BadSentence."""
        agrees = fields.get("agrees")
        if not isinstance(agrees, bool):
            raise BadSentence(BAD_ANSWER)
        turn = Turn("", "button", identifier)
        self._hearing.drop_turn()
        if self._is_full:
            self._answer_at_once(Reply("", TOO_MANY, False), identifier)
            return
        spoken, answers = self._spoken, self._dialog.read_back
        self._start(self._in_order(turn, lambda: self._press(turn, agrees, spoken, answers)))

    def begin_speech(self, identifier: str) -> None:
        """Note that a turn in speech has begun."""
        self._spoken, self._spoken_answers = (identifier, self._calls.turn), self._dialog.read_back
        self._hearing.begin_turn(identifier)

    def end_speech(self, identifier: str) -> None:
        """Have a turn in speech recognized; say why if that cannot be. One that a stop has ended is over."""
        if self._hearing.mode == "commands" and not self._hearing.end_turn(identifier) and identifier != self._stopped:
            state = self._hearing.state
            self._report(identifier, "", state.reason or f"the listener is {state.name}")

    # -- what the listener hears ----------------------------------------------------------------------------------------
    def hear(self, identifier: str, text: str) -> None:
        """Handle a turn that was recognized. Words for stopping count, whatever has happened since."""
        turn = Turn(text, "speech", identifier)
        stop = self._stop_in(text, ENGLISH)
        if stop is not None and stop.tool == "engage_estop":
            if identifier != self._stopped:  # or the spotter was first
                self._calls.stop_at_once(text, identifier)
        elif self._spoken != (identifier, self._calls.turn):
            self._report(identifier, text, OUTDATED)
        elif stop is not None:
            self._report(identifier, text)
            self._carry_out_stop(turn, stop)
        elif self._is_full:
            self._report(identifier, text, TOO_MANY)
        else:
            self._report(identifier, text)
            if text or self._dialog.waits_for_answer:
                spoken, answers = self._spoken, self._spoken_answers
                self._start(self._in_order(turn, lambda: self._understand(turn, ENGLISH, spoken, answers)))

    def _report(self, identifier: str, text: str, problem: str = "") -> None:
        self._send({"heard": {"id": identifier, "text": text, "problem": problem}})

    # -- stops, which wait for nothing and are dropped by nothing --------------------------------------------------------
    def _stop_in(self, text: str, language: Language) -> Call | None:
        """Return what a sentence stops; None if it stops nothing."""
        if has_stop_word(text):
            return Call("engage_estop")
        understood = self._dialog.understand(text, language)
        return understood if isinstance(understood, Call) and BY_NAME[understood.tool].effect is Effect.STOP else None

    def _carry_out_stop(self, turn: Turn, call: Call) -> None:
        def answer(response: dict[str, Any]) -> None:
            reply = Reply(turn.sentence, describe(call.tool, response), bool(response.get("ok")), call, response)
            self._answer_at_once(reply, turn.identifier)

        self.drop()
        self._calls.begin_call(call.tool, dict(call.arguments), answer)

    def _answer_at_once(self, reply: Reply, identifier: str) -> None:
        self._send({"reply": {"id": identifier, **reply.as_object()}})

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

    async def _understand(self, turn: Turn, language: Language, spoken: tuple[str, int] | None, answers: str) -> Reply:
        """Handle a sentence that came after the turn in speech `spoken`, and may answer what was read back by then."""
        await self._wait_for_names()
        if self._is_outdated(turn, spoken):
            return Reply(turn.sentence, OUTDATED, False)
        self._dialog.language = language
        return await self._dialog.handle(turn, answers)

    async def _press(self, turn: Turn, agrees: bool, spoken: tuple[str, int] | None, answers: str) -> Reply:
        if agrees and self._is_outdated(turn, spoken):
            return Reply(turn.sentence, OUTDATED, False)
        return await self._dialog.answer(turn, Confirmation(agrees), answers)

    def _is_outdated(self, turn: Turn, spoken: tuple[str, int] | None) -> bool:
        """Return whether the operator has begun to speak since; what was said is outdated by any other turn, too."""
        return self._spoken != spoken or (turn.by == "speech" and spoken != (turn.identifier, self._calls.turn))

    async def _reply(self, turn: Turn, work: Callable[[], Awaitable[Reply]]) -> None:
        reply = await work()
        self._answer_at_once(reply, turn.identifier)
        # The microphone must not hear a word for stopping from the robot itself.
        if self._hearing.mode == "commands" and not self._is_mute and not sounds_like_stop(reply.text):
            self._start(self._speak(reply.text, self._calls.turn))

    async def _speak(self, text: str, turn: int) -> None:
        """Send the sound of a reply, unless the operator has begun another turn by then."""
        sound = await asyncio.get_running_loop().run_in_executor(self._voice, self._synthesize, text)
        if sound and turn == self._calls.turn:
            self._play(sound)

    def _synthesize(self, text: str) -> bytes:
        try:
            self._speaker = self._speaker or Speaker(timeout_s=_SPEAK_TIMEOUT_S)
            return self._speaker.synthesize(text)
        except (SpeechUnavailable, BadSound):  # the page shows the text
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
        self._hearing.expect(names)
