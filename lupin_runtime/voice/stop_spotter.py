"""Listens for a word that stops while somebody is still speaking, and does not wait for the end of the sentence.

A thread recognizes the newest seconds of the utterance every 0.1 s. The end of a window may cut "start" to what sounds like
"stop", so several windows in a row must agree. What is heard here decides only about stopping; commands wait for the sentence.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from lupin_runtime.voice.endpointer import SAMPLE_BYTES, SAMPLE_RATE_HZ
from lupin_runtime.voice.grammar import has_stop_word
from lupin_runtime.voice.recognizer import WINDOW_S, Recognizer
from lupin_runtime.voice.speech import SpeechUnavailable

HALT = "halt"

AGREEING_WINDOWS = 3  # in six minutes of other speech, up to two windows in a row heard a stop
STEP_S = 0.1  # of new sound between two windows
_MIN_SPEECH_S = 0.3  # a shorter sound is no word yet
MAX_WINDOW_S = 10.0  # a recognizer that takes longer for a window hears no stop
CLOSE_TIMEOUT_S = 2.0
_BYTES_PER_S = SAMPLE_RATE_HZ * SAMPLE_BYTES


class StopSpotter:
    """Calls `stop` from its thread when a word for stopping is heard, and again once WINDOW_S of new sound has come.

    In a noise an utterance may last long after its stop: a second one must be heard, too. `stop` gets the text and the number
    of the utterance: the next one may have begun before the recognizer finds the stop.
    """

    def __init__(self, recognizer: Recognizer, stop: Callable[[str, int], None]) -> None:
        self._recognizer = recognizer
        self._stop = stop
        self._changed = threading.Condition()
        self._utterance = 0
        self._sound = b""
        self._word: tuple[int, bytes] | None = None  # the last word, with the number of its utterance
        self._heard_bytes = 0
        self._agreeing = self._counted = 0  # windows in a row, of the utterance with this number
        self._deaf_until = 0  # bytes of the utterance, after a stop
        self._is_closed = False
        self._window_began_s: float | None = None
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="lupin-stop-spotter", daemon=True)
        self._thread.start()

    def begin(self) -> int:
        """Begin a new utterance, and return its number."""
        with self._changed:
            self._utterance += 1
            self._sound, self._heard_bytes, self._deaf_until = b"", 0, 0
            return self._utterance

    def update(self, utterance: bytes) -> None:
        """Take the sound of the utterance so far."""
        with self._changed:
            self._sound = utterance
            self._changed.notify()

    def end_word(self, word: bytes) -> None:
        """Take an utterance that was a single word, and may go on."""
        with self._changed:
            self._word = self._utterance, word
            self._changed.notify()

    def require_hearing(self) -> None:
        """Raise SpeechUnavailable if no stop would be heard: the recognizer has failed, or hangs."""
        began_s = self._window_began_s
        if self._failure is not None:
            raise SpeechUnavailable(
                f"no word for stopping is heard: the recognizer failed: {self._failure!r}"
            ) from self._failure
        if began_s is not None and time.monotonic() - began_s > MAX_WINDOW_S:
            raise SpeechUnavailable(f"no word for stopping is heard: the recognizer has been busy for {MAX_WINDOW_S:g} s")

    def close(self) -> None:
        """End the thread, after the window that it hears now, for which CLOSE_TIMEOUT_S are waited."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        self._thread.join(CLOSE_TIMEOUT_S)

    def _run(self) -> None:
        try:
            self._hear()
        except Exception as error:  # whatever a recognizer raises; the owner must not go on without a spotter
            self._failure = error

    def _hear(self) -> None:
        while (window := self._next_window()) is not None:
            number, sound, is_word = window
            self._window_began_s = time.monotonic()
            if is_word:
                text = HALT if self._recognizer.may_be_halt(sound) else ""
            else:
                text = self._recognizer.transcribe_window(sound)
            self._window_began_s = None
            with self._changed:
                before = self._agreeing if self._counted == number else 0
                self._counted, self._agreeing = number, before + 1 if has_stop_word(text) else 0
                is_stop = self._agreeing >= AGREEING_WINDOWS or bool(is_word and text)
                if is_stop:
                    self._agreeing = 0
                    if number == self._utterance:
                        self._deaf_until = self._heard_bytes + int(WINDOW_S * _BYTES_PER_S)
            if is_stop:
                self._stop(text, number)

    def _next_window(self) -> tuple[int, bytes, bool] | None:
        """Wait for a word or enough new sound; return it with the number of its utterance, or None once closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or self._word is not None or self._has_enough())
            if self._is_closed:
                return None
            if self._word is not None:
                (number, word), self._word = self._word, None
                if number != self._utterance or len(word) >= self._deaf_until:
                    return number, word, True
            self._heard_bytes = len(self._sound)
            return self._utterance, self.window(self._sound), False

    @staticmethod
    def window(sound: bytes) -> bytes:
        """Return the newest sound of an utterance, in which a word for stopping is looked for."""
        return sound[-int(WINDOW_S * _BYTES_PER_S) :]

    def _has_enough(self) -> bool:
        new = len(self._sound) - self._heard_bytes
        first = max(_MIN_SPEECH_S * _BYTES_PER_S, self._deaf_until)
        return len(self._sound) >= first and new >= STEP_S * _BYTES_PER_S
