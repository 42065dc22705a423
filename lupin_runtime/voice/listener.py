"""The listener of a console, a process of its own: spots words for stopping in a page's sound, and recognizes turns.

    python -m lupin_runtime.voice.listener

It takes 300 MB and much of a core, so it runs only while a page is listened to, and ends with its standard input. Messages are
those of `listener_protocol.py`.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import sys
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import IO, Any, Protocol

from lupin_runtime.json_text import parse_json
from lupin_runtime.voice.endpointer import FRAME_BYTES, FRAME_MS, Edge, EndpointerSettings
from lupin_runtime.voice.grammar import has_stop_word
from lupin_runtime.voice.listener_protocol import Kind, read_message
from lupin_runtime.voice.recognizer import CommandRecognizer, Recognizer
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.speech import SpeechUnavailable
from lupin_runtime.voice.spotting_endpointer import SpottingEndpointer

_NICENESS = 5  # the console sends the velocities of bursts, and comes first
_BEFORE_MS = 300  # of a turn: its first sound is below the page's threshold
_MAX_TURN_MS = 30_000
_MAX_SENTENCES = 4  # that wait for the recognizer
_KEPT_UTTERANCES = 8  # in which a stop may still be found

Emit = Callable[[dict[str, Any]], None]


class TurnRecognizer(Recognizer, Protocol):
    """Speech to text that knows the names of commands."""

    def expect(self, names: Names) -> None:
        """Let commands have these names from now on."""


@dataclass(frozen=True)
class _Sound:
    """A sound to recognize, and the id of its turn, if any. If it is no turn, only a word for stopping in it counts.

    `utterance` is the number of the utterance that it is as a whole; 0 if it is a part of one, or of several.
    """

    turn: str
    sound: bytes
    is_turn: bool = True
    utterance: int = 0


class Listener:
    """Handles the messages of a console. Words for stopping count in all sound, whether it belongs to a turn or not.

    The spotter does not find every stop in its short windows, so an utterance that is not part of a turn is recognized at its
    end, too.
    """

    def __init__(self, recognizer: TurnRecognizer, emit: Emit) -> None:
        self._recognizer = recognizer
        self._emit = emit
        self._settings = EndpointerSettings()
        self._spotting = SpottingEndpointer(recognizer, self._stop, self._settings)
        self._recent: deque[bytes] = deque(maxlen=_BEFORE_MS // FRAME_MS)
        self._turn = ""  # id of the turn that is going on
        self._turn_sound: deque[bytes] = deque(maxlen=_MAX_TURN_MS // FRAME_MS)
        self._is_of_turn = False  # whether a part of the utterance belongs to a turn
        self._turns: dict[int, str] = {}  # id of the turn of each of the last utterances; empty if it has several
        self._stopped = 0  # number of the last utterance in which a word for stopping was spotted,
        self._stopped_turn = ""  # and the id of its turn
        self._sentences = queue.Queue[_Sound](maxsize=_MAX_SENTENCES)
        threading.Thread(target=self._recognize, name="lupin-listener-sentences", daemon=True).start()

    def handle(self, kind: Kind, payload: bytes) -> None:
        """Handle one message. A payload that is none is ignored; a BEGIN without an id only ends a turn.

        Raises SpeechUnavailable if no stop would be heard.
        """
        if kind is Kind.SOUND and len(payload) == FRAME_BYTES:
            self._hear(payload)
        elif kind is Kind.BEGIN:
            if self._turn and self._turn != self._stopped_turn:  # it is no turn any more, but may have a word for stopping
                self._queue(_Sound(self._turn, b"".join(self._turn_sound), is_turn=False))
            self._turn = payload.decode(errors="replace")
            self._is_of_turn &= bool(self._turn)
            self._turn_sound.clear()
            self._turn_sound.extend(self._recent)
        elif kind is Kind.END and payload.decode(errors="replace") == self._turn:
            turn, self._turn = self._turn, ""
            self._queue(_Sound(turn, b"".join(self._turn_sound)))
        elif kind is Kind.SETUP:
            self._set_up(parse_json(payload))

    def _set_up(self, setup: dict[str, Any]) -> None:
        self._recognizer.expect(Names(**{kind: tuple(names) for kind, names in setup["names"].items()}))
        settings = replace(self._settings, start_level=setup["start_level"], end_level=setup["end_level"])
        if settings != self._settings:
            self._settings = settings
            self._spotting.configure(settings)

    def _hear(self, frame: bytes) -> None:
        self._recent.append(frame)
        if self._turn:
            self._turn_sound.append(frame)
        edge = self._spotting.push(frame)
        number = self._spotting.number
        if edge is Edge.BEGIN:
            self._is_of_turn = False
            self._turns.pop(number - _KEPT_UTTERANCES, None)
        self._is_of_turn |= bool(self._turn)
        if self._turn and (self._spotting.is_speaking or edge is Edge.END):
            self._turns[number] = self._turn if self._turns.get(number, self._turn) == self._turn else ""
        if edge is Edge.END and not self._is_of_turn and self._stopped != number:
            self._queue(_Sound("", self._spotting.utterance, is_turn=False, utterance=number))

    def _stop(self, text: str, number: int) -> None:
        """Report a stop that was spotted in the utterance with this number; called from the spotter's thread."""
        self._stopped_turn = self._turns.get(number, "")
        self._stopped = number
        self._emit({"stop": text, "id": self._stopped_turn})

    def _queue(self, sound: _Sound) -> None:
        try:
            self._sentences.put_nowait(sound)
        except queue.Full:
            with contextlib.suppress(queue.Empty):  # the newest sound counts most: it may have a word for stopping
                dropped = self._sentences.get_nowait()
                if dropped.is_turn:
                    self._emit({"heard": {"id": dropped.turn, "text": ""}})
            with contextlib.suppress(queue.Full):
                self._sentences.put_nowait(sound)

    def _recognize(self) -> None:
        while True:
            sound = self._sentences.get()
            text = self._recognizer.transcribe(sound.sound) if sound.sound else ""
            if sound.is_turn:
                self._emit({"heard": {"id": sound.turn, "text": text}})
            elif has_stop_word(text) and not self._is_spotted(sound):
                self._emit({"stop": text, "id": sound.turn})

    def _is_spotted(self, sound: _Sound) -> bool:
        """Return whether the spotter has found the stop while the sound waited, or was recognized."""
        return self._stopped == sound.utterance if sound.utterance else self._stopped_turn == sound.turn


def run(create_recognizer: Callable[[], TurnRecognizer], source: IO[bytes], target: IO[bytes]) -> None:
    """Listen until the source ends. The threads are daemons: a recognizer that hangs must not keep the process alive."""
    lock = threading.Lock()

    def emit(event: dict[str, Any]) -> None:
        with lock, contextlib.suppress(BrokenPipeError):  # the console is gone, and so is this process in a moment
            target.write(json.dumps(event).encode() + b"\n")
            target.flush()

    try:
        recognizer = create_recognizer()
    except SpeechUnavailable as error:
        emit({"missing": str(error)})
        return
    listener = Listener(recognizer, emit)
    emit({"ready": True})
    while (message := read_message(source)) is not None:
        listener.handle(*message)


def _end_process(failure: threading.ExceptHookArgs) -> None:
    print(f"{failure.exc_type.__name__}: {failure.exc_value}", file=sys.stderr, flush=True)
    os._exit(1)


def main() -> None:
    """Listen to standard input. What libraries print goes to standard error, out of the way of the events."""
    # Without one of its threads it would hear no stop, and must not seem to.
    threading.excepthook = _end_process
    os.nice(_NICENESS)
    target = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    run(CommandRecognizer, sys.stdin.buffer, target)


if __name__ == "__main__":
    main()
