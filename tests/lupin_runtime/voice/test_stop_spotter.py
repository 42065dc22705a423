"""The stop-word spotter hears a stop while somebody still speaks, and once for each utterance."""

from __future__ import annotations

import queue
import threading

import pytest

from lupin_runtime.voice.endpointer import FRAME_BYTES, SAMPLE_RATE_HZ
from lupin_runtime.voice.stop_spotter import WINDOW_S, StopSpotter

SECOND = SAMPLE_RATE_HZ * 2
TIMEOUT_S = 10.0


class Script:
    """A recognizer that answers each window with the next text, when the test lets it."""

    def __init__(self) -> None:
        self.windows: queue.Queue[bytes] = queue.Queue()
        self.texts: queue.Queue[str] = queue.Queue()

    def transcribe(self, sound: bytes) -> str:
        self.windows.put(sound)
        return self.texts.get(timeout=TIMEOUT_S)

    def hear(self, text: str) -> bytes:
        """Answer the present window, and return it."""
        window = self.windows.get(timeout=TIMEOUT_S)
        self.texts.put(text)
        return window


@pytest.fixture
def script() -> Script:
    return Script()


def spot(script: Script) -> tuple[StopSpotter, queue.Queue[str]]:
    stops: queue.Queue[str] = queue.Queue()
    return StopSpotter(script, stops.put), stops


def test_stop_is_reported_before_the_sentence_ends(script: Script) -> None:
    spotter, stops = spot(script)
    spotter.begin()
    spotter.update(b"\1" * SECOND)
    script.hear("stop the")
    assert stops.get(timeout=TIMEOUT_S) == "stop the"
    spotter.close()


def test_one_utterance_stops_once_and_the_next_again(script: Script) -> None:
    spotter, stops = spot(script)
    for _ in range(2):
        spotter.begin()
        spotter.update(b"\1" * SECOND)
        script.hear("halt")
        assert stops.get(timeout=TIMEOUT_S) == "halt"
        spotter.update(b"\1" * 2 * SECOND)
    spotter.close()
    assert stops.empty() and script.windows.empty()


def test_other_words_stop_nothing(script: Script) -> None:
    spotter, stops = spot(script)
    spotter.begin()
    spotter.update(b"\1" * SECOND)
    script.hear("go to the sink")
    spotter.update(b"\1" * 2 * SECOND)
    script.hear("go to the shop")
    spotter.close()
    assert stops.empty()


def test_window_is_the_newest_sound(script: Script) -> None:
    spotter, _ = spot(script)
    spotter.begin()
    sound = b"".join(bytes([second]) * SECOND for second in range(6))
    spotter.update(sound)
    assert script.hear("") == sound[-int(WINDOW_S * SECOND) :]
    spotter.close()


def test_too_little_sound_is_not_recognized(script: Script) -> None:
    spotter, _ = spot(script)
    spotter.begin()
    spotter.update(b"\1" * FRAME_BYTES)
    spotter.close()
    assert script.windows.empty()


def test_stop_of_a_finished_utterance_is_late_and_dropped(script: Script) -> None:
    # The whole sentence of that utterance is recognized as well, and stops.
    spotter, stops = spot(script)
    spotter.begin()
    spotter.update(b"\1" * SECOND)
    window = script.windows.get(timeout=TIMEOUT_S)
    spotter.begin()
    script.texts.put("stop")
    spotter.close()
    assert len(window) == SECOND and stops.empty()


def test_close_ends_the_thread(script: Script) -> None:
    before = threading.active_count()
    spotter, _ = spot(script)
    spotter.close()
    assert threading.active_count() == before
