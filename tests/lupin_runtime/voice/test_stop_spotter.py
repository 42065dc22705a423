"""The stop-word spotter hears a stop while somebody still speaks, and once for each utterance."""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterator

import pytest

from lupin_runtime.voice.endpointer import FRAME_BYTES, SAMPLE_RATE_HZ
from lupin_runtime.voice.recognizer import WINDOW_S
from lupin_runtime.voice.spotting_endpointer import SpottingEndpointer
from lupin_runtime.voice.stop_spotter import AGREEING_WINDOWS, HALT, STEP_S, StopSpotter
from tests.support.waiting import WAIT_S, wait_until

SECOND = SAMPLE_RATE_HZ * 2


class Script:
    """A recognizer that answers each window with the next text, when the test lets it."""

    def __init__(self) -> None:
        self.windows: queue.Queue[bytes] = queue.Queue()
        self.texts: queue.Queue[str] = queue.Queue()

    def transcribe(self, sound: bytes) -> str:
        raise AssertionError(f"a whole sentence of {len(sound)} bytes")

    def transcribe_window(self, sound: bytes) -> str:
        self.windows.put(sound)
        return self.texts.get(timeout=WAIT_S)

    def may_be_halt(self, word: bytes) -> bool:
        return self.transcribe_window(word) == "halt"


class Speaker:
    """Speaks to a spotter, in steps that are each a window."""

    def __init__(self) -> None:
        self.script = Script()
        self.stops: queue.Queue[str] = queue.Queue()
        self.numbers: list[int] = []  # of the utterances that were stopped
        self.spotter = StopSpotter(self.script, self._stop)
        self.sound = b""

    def _stop(self, text: str, number: int) -> None:
        self.numbers.append(number)
        self.stops.put(text)

    def begin(self) -> None:
        self.sound = b"\1" * SECOND
        self.spotter.begin()

    def say(self, *texts: str) -> list[bytes]:
        """Go on speaking, so that each text is heard in one more window; return the windows."""
        windows = []
        for text in texts:
            self.sound += b"\2" * int(STEP_S * SECOND)
            self.spotter.update(self.sound)
            windows.append(self.script.windows.get(timeout=WAIT_S))
            self.script.texts.put(text)
        return windows


@pytest.fixture
def speaker() -> Iterator[Speaker]:
    made = Speaker()
    yield made
    made.script.texts.put("")  # for a window that is still waited for
    made.spotter.close()


def test_stop_is_reported_before_the_sentence_ends(speaker: Speaker) -> None:
    speaker.begin()
    speaker.say("go to the", *["no stop"] * AGREEING_WINDOWS)
    assert speaker.stops.get(timeout=WAIT_S) == "no stop"


def test_stop_needs_windows_in_a_row_that_agree(speaker: Speaker) -> None:
    speaker.begin()
    speaker.say("stop", "stop", "start the clock", "stop", "stop", "start the clock now")
    assert speaker.stops.empty()


def test_windows_of_two_utterances_do_not_agree(speaker: Speaker) -> None:
    speaker.begin()
    speaker.say("stop", "stop")
    speaker.begin()
    speaker.say("stop", "stock")
    assert speaker.stops.empty()


def test_stop_is_found_when_the_next_utterance_has_begun(speaker: Speaker) -> None:
    speaker.begin()
    speaker.say(*["stop"] * (AGREEING_WINDOWS - 1))
    speaker.sound += b"\2" * int(STEP_S * SECOND)
    speaker.spotter.update(speaker.sound)
    speaker.script.windows.get(timeout=WAIT_S)  # the last window is being heard
    speaker.begin()
    speaker.script.texts.put("stop")
    assert speaker.stops.get(timeout=WAIT_S) == "stop" and speaker.numbers == [1]
    speaker.say(*["halt"] * AGREEING_WINDOWS)  # at once: it is not the utterance that was stopped
    assert speaker.stops.get(timeout=WAIT_S) == "halt" and speaker.numbers == [1, 2]


def test_word_is_heard_when_the_next_utterance_has_begun(speaker: Speaker) -> None:
    speaker.begin()
    speaker.sound += b"\2" * int(STEP_S * SECOND)
    speaker.spotter.update(speaker.sound)
    speaker.script.windows.get(timeout=WAIT_S)  # is being heard
    speaker.spotter.end_word(speaker.sound)
    word = speaker.sound
    speaker.begin()
    speaker.script.texts.put("old")
    assert speaker.script.windows.get(timeout=WAIT_S) == word
    speaker.script.texts.put("halt")
    assert speaker.stops.get(timeout=WAIT_S) == HALT and speaker.numbers == [1]


def test_one_utterance_stops_once_and_the_next_again(speaker: Speaker) -> None:
    for _ in range(2):
        speaker.begin()
        speaker.say(*["halt"] * AGREEING_WINDOWS)
        assert speaker.stops.get(timeout=WAIT_S) == "halt"
        speaker.spotter.update(speaker.sound * 2)
    speaker.spotter.close()
    assert speaker.stops.empty() and speaker.script.windows.empty()


def test_second_stop_of_a_long_utterance_is_heard(speaker: Speaker) -> None:
    speaker.begin()
    speaker.say(*["stop"] * AGREEING_WINDOWS)
    assert speaker.stops.get(timeout=WAIT_S) == "stop"
    speaker.sound += b"\3" * int(WINDOW_S * SECOND)
    speaker.say(*["halt"] * AGREEING_WINDOWS)
    assert speaker.stops.get(timeout=WAIT_S) == "halt"


def end_word(speaker: Speaker, heard_as: str) -> None:
    """Let a word end, and have it heard."""
    speaker.spotter.end_word(speaker.sound)
    assert speaker.script.windows.get(timeout=WAIT_S) == speaker.sound
    speaker.script.texts.put(heard_as)


def test_single_word_that_may_be_halt_stops(speaker: Speaker) -> None:
    speaker.begin()
    speaker.say("old")
    end_word(speaker, "heart")
    speaker.say("old")
    assert speaker.stops.empty()
    end_word(speaker, "halt")
    assert speaker.stops.get(timeout=WAIT_S) == HALT


@pytest.mark.parametrize(("spoken", "pause", "asked"), [(10, 10, 1), (10, 3, 0), (30, 10, 0)])
def test_only_a_short_sound_before_a_pause_is_a_word(spoken: int, pause: int, asked: int) -> None:
    words: list[bytes] = []

    class Words(Script):
        def transcribe_window(self, sound: bytes) -> str:
            return str(sound[:0], "ascii")

        def may_be_halt(self, word: bytes) -> bool:
            words.append(word)
            return False

    endpointer = SpottingEndpointer(Words(), lambda *_: None)
    for frame in [b"\0\x20" * (FRAME_BYTES // 2)] * spoken + [bytes(FRAME_BYTES)] * pause:
        endpointer.push(frame)
    wait_until(lambda: len(words) >= asked, "the word")
    endpointer.close()
    assert len(words) == asked


def test_window_is_the_newest_sound(speaker: Speaker) -> None:
    speaker.begin()
    speaker.sound *= 6
    [window] = speaker.say("")
    assert window == speaker.sound[-int(WINDOW_S * SECOND) :]


def test_too_little_sound_is_not_recognized(speaker: Speaker) -> None:
    speaker.begin()
    speaker.spotter.update(b"\1" * FRAME_BYTES)
    speaker.spotter.close()
    assert speaker.script.windows.empty()


def test_close_ends_the_thread() -> None:
    before = threading.active_count()
    Speaker().spotter.close()
    assert threading.active_count() == before
