"""Listens for a word that stops while somebody is still speaking, and does not wait for the end of the sentence.

The recognizer runs in a thread on the newest seconds of the utterance, again and again, so that a stop in the middle of a
sentence is heard as well. What it hears there decides only about stopping; commands wait for the whole sentence.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from lupin_runtime.voice.endpointer import SAMPLE_BYTES, SAMPLE_RATE_HZ
from lupin_runtime.voice.grammar import has_stop_word
from lupin_runtime.voice.speech import Recognizer

WINDOW_S = 2.5  # longer than any stop phrase, so that the word is whole in one window
_MIN_SPEECH_S = 0.3  # a shorter sound is no word yet
_MIN_NEW_S = 0.2  # of sound since the window that was heard last
_BYTES_PER_S = SAMPLE_RATE_HZ * SAMPLE_BYTES


class StopSpotter:
    """Calls `stop` from its thread, once for each utterance in which a word for stopping is heard."""

    def __init__(self, recognizer: Recognizer, stop: Callable[[str], None]) -> None:
        self._recognizer = recognizer
        self._stop = stop
        self._changed = threading.Condition()
        self._utterance = 0
        self._sound = b""
        self._heard_bytes = 0
        self._has_stopped = self._is_closed = False
        self._thread = threading.Thread(target=self._run, name="lupin-stop-spotter", daemon=True)
        self._thread.start()

    def begin(self) -> None:
        """Begin a new utterance."""
        with self._changed:
            self._utterance += 1
            self._sound, self._heard_bytes, self._has_stopped = b"", 0, False

    def update(self, utterance: bytes) -> None:
        """Take the sound of the utterance so far."""
        with self._changed:
            self._sound = utterance
            self._changed.notify()

    def close(self) -> None:
        """End the thread, after the window that it hears now."""
        with self._changed:
            self._is_closed = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while (window := self._next_window()) is not None:
            number, sound = window
            text = self._recognizer.transcribe(sound)
            with self._changed:
                is_new = number == self._utterance and not self._has_stopped and has_stop_word(text)
                self._has_stopped |= is_new
            if is_new:
                self._stop(text)

    def _next_window(self) -> tuple[int, bytes] | None:
        """Wait for enough new sound, and return it with the number of its utterance; None once closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed or self._has_enough())
            if self._is_closed:
                return None
            self._heard_bytes = len(self._sound)
            return self._utterance, self.window(self._sound)

    @staticmethod
    def window(sound: bytes) -> bytes:
        """Return the newest sound of an utterance, in which a word for stopping is looked for."""
        return sound[-int(WINDOW_S * _BYTES_PER_S) :]

    def _has_enough(self) -> bool:
        new = len(self._sound) - self._heard_bytes
        return not self._has_stopped and len(self._sound) >= _MIN_SPEECH_S * _BYTES_PER_S and new >= _MIN_NEW_S * _BYTES_PER_S
