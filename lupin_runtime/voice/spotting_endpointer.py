"""Follows the sound of a microphone: finds its utterances, and spots words for stopping in them while somebody still speaks."""

from __future__ import annotations

from collections.abc import Callable

from lupin_runtime.voice.endpointer import BEFORE_MS, FRAME_BYTES, FRAME_MS, Edge, Endpointer, EndpointerSettings
from lupin_runtime.voice.recognizer import Recognizer
from lupin_runtime.voice.stop_spotter import StopSpotter

MAX_WORD_MS = 900
WORD_PAUSE_MS = 200  # after a word; between two of a sentence there is less


class SpottingEndpointer:
    """An endpointer whose utterances a stop-word spotter hears.

    `stop` is called from the spotter's thread with what was heard, and the number of the utterance in which it was.
    """

    def __init__(
        self, recognizer: Recognizer, stop: Callable[[str, int], None], settings: EndpointerSettings | None = None
    ) -> None:
        self._endpointer = Endpointer(settings)
        self._spotter = StopSpotter(recognizer, stop)
        self.number = 0  # of the present utterance, or of the last one

    @property
    def utterance(self) -> bytes:
        """The sound of the present utterance, or of the last one."""
        return self._endpointer.utterance

    @property
    def is_speaking(self) -> bool:
        """Whether an utterance is going on."""
        return self._endpointer.is_speaking

    def push(self, frame: bytes) -> Edge | None:
        """Take the next frame, and return the edge that it is, if any. Raises SpeechUnavailable if no stop would be heard."""
        self._spotter.require_hearing()
        edge = self._endpointer.push(frame)
        if edge is Edge.BEGIN:
            self.number = self._spotter.begin()
        if self._endpointer.is_speaking:
            utterance, quiet_ms = self._endpointer.utterance, self._endpointer.quiet_ms
            self._spotter.update(utterance)
            spoken_ms = len(utterance) // FRAME_BYTES * FRAME_MS - BEFORE_MS - quiet_ms
            if quiet_ms == WORD_PAUSE_MS and spoken_ms <= MAX_WORD_MS:
                self._spotter.end_word(utterance)
        return edge

    def configure(self, settings: EndpointerSettings) -> None:
        """Use other thresholds from the next frame on; an utterance that is going on ends."""
        self._endpointer = Endpointer(settings)

    def close(self) -> None:
        """End the spotter, after the window that it hears now, if that is soon done."""
        self._spotter.close()
