"""The listener hears stops in all sound and turns between their marks; its messages are framed, and its events are lines."""

from __future__ import annotations

import functools
import io
import json
import queue
import threading
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.voice import listener, stop_spotter
from lupin_runtime.voice.endpointer import FRAME_BYTES, FRAME_MS
from lupin_runtime.voice.listener import Listener, run
from lupin_runtime.voice.listener_protocol import Kind, MalformedMessage, encode, read_message
from lupin_runtime.voice.recognizer import MISSING_PACKAGES
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.speech import SpeechUnavailable
from lupin_runtime.voice.stop_spotter import AGREEING_WINDOWS
from tests.support.fake_listener import SILENCE, LoudnessRecognizer, sound_of
from tests.support.waiting import WAIT_S, wait_until

PAUSE = 20  # frames that end an utterance


class Rig:
    """A listener, and the events that it has sent."""

    def __init__(self, recognizer: LoudnessRecognizer | None = None) -> None:
        self.events: queue.Queue[dict[str, Any]] = queue.Queue()
        self.recognizer = recognizer or LoudnessRecognizer()
        self.listener = Listener(self.recognizer, self.events.put)

    def hear(self, frame: bytes, times: int = 1) -> None:
        for _ in range(times):
            self.listener.handle(Kind.SOUND, frame)

    def mark(self, kind: Kind, identifier: str) -> None:
        self.listener.handle(kind, identifier.encode())

    def event(self) -> dict[str, Any]:
        return self.events.get(timeout=WAIT_S)

    def say_until_stopped(self) -> dict[str, Any]:
        """Go on saying a word for stopping until the spotter has heard it."""
        while True:
            self.hear(sound_of("stop"), 2)
            try:
                return self.events.get(timeout=0.05)
            except queue.Empty:
                continue


@given(st.lists(st.tuples(st.sampled_from(Kind), st.binary(max_size=2000))))
def test_messages_are_read_as_they_were_written(messages: list[tuple[Kind, bytes]]) -> None:
    stream = io.BytesIO(b"".join(encode(kind, payload) for kind, payload in messages))
    assert [message for _ in messages if (message := read_message(stream))] == messages
    assert read_message(stream) is None


@pytest.mark.parametrize("data", [b"x\0\0\0\0", b"s\xff\xff\xff\xff", b"{}\n{}\n"])
def test_malformed_header_is_refused(data: bytes) -> None:
    with pytest.raises(MalformedMessage):
        read_message(io.BytesIO(data))


def test_message_that_is_cut_short_is_the_end() -> None:
    assert read_message(io.BytesIO(encode(Kind.SOUND, SILENCE)[:-1])) is None


def test_stop_is_spotted_while_somebody_still_speaks() -> None:
    rig = Rig()
    assert rig.say_until_stopped() == {"stop": "stop", "id": ""}
    rig.hear(SILENCE, PAUSE)
    rig.mark(Kind.BEGIN, "1")
    rig.mark(Kind.END, "1")
    assert rig.event() == {"heard": {"id": "1", "text": ""}}  # and no second stop before it


def test_stop_is_spotted_within_a_turn() -> None:
    rig = Rig()
    rig.mark(Kind.BEGIN, "1")
    assert rig.say_until_stopped() == {"stop": "stop", "id": "1"}
    rig.mark(Kind.END, "1")
    assert rig.event() == {"heard": {"id": "1", "text": "stop"}}


def test_stop_that_windows_miss_is_found_at_the_end() -> None:
    rig = Rig()
    rig.hear(sound_of("hold"), 8)
    rig.hear(SILENCE, PAUSE)
    assert rig.event() == {"stop": "halt", "id": ""}


@pytest.mark.parametrize("identifier", ["", "2"])
def test_stop_in_a_turn_that_is_dropped_is_found(identifier: str) -> None:
    rig = Rig()
    rig.mark(Kind.BEGIN, "1")
    rig.hear(sound_of("hold"), 8)
    rig.mark(Kind.BEGIN, identifier)
    assert rig.event() == {"stop": "halt", "id": "1"}


class LateWindows(LoudnessRecognizer):
    """Hears each window once the test lets it."""

    def __init__(self) -> None:
        self.permits = threading.Semaphore(0)
        self.begun = 0

    def has_begun(self, count: int) -> bool:
        return self.begun == count

    def transcribe_window(self, sound: bytes) -> str:
        self.begun += 1
        assert self.permits.acquire(timeout=WAIT_S)
        return super().transcribe_window(sound)


class SlowSentences(LoudnessRecognizer):
    """Hears each sentence once the test lets it."""

    def __init__(self) -> None:
        self.permit = threading.Event()
        self.is_busy = False

    def transcribe(self, sound: bytes) -> str:
        self.is_busy = True
        assert self.permit.wait(timeout=WAIT_S)
        return super().transcribe(sound)


def test_stop_that_is_spotted_late_belongs_to_its_own_turn() -> None:
    recognizer = LateWindows()
    rig = Rig(recognizer)
    rig.mark(Kind.BEGIN, "1")
    rig.hear(sound_of("stop"), 8)
    for number in range(1, AGREEING_WINDOWS):
        wait_until(functools.partial(recognizer.has_begun, number), "a window")
        rig.hear(sound_of("stop"), 4)
        recognizer.permits.release()
    wait_until(functools.partial(recognizer.has_begun, AGREEING_WINDOWS), "the window that decides")
    rig.hear(SILENCE, PAUSE)
    rig.mark(Kind.BEGIN, "2")
    rig.hear(sound_of("hold"), 8)
    assert rig.event() == {"stop": "stop", "id": "1"}  # from the sound of the turn that is dropped
    recognizer.permits.release(100)
    assert rig.event() == {"stop": "stop", "id": "1"}  # from the spotter
    rig.mark(Kind.END, "2")
    assert rig.event() == {"heard": {"id": "2", "text": "halt"}}


@pytest.mark.parametrize("turn", ["", "1"])
def test_stop_that_is_spotted_meanwhile_is_not_reported_again(turn: str) -> None:
    recognizer = SlowSentences()
    rig = Rig(recognizer)
    if turn:
        rig.mark(Kind.BEGIN, turn)
    rig.hear(sound_of("hold"), 8)
    if turn:
        rig.mark(Kind.BEGIN, "")
    else:
        rig.hear(SILENCE, PAUSE)
    wait_until(lambda: recognizer.is_busy, "a sentence")
    rig.listener._stop("halt", 1)  # as from the spotter's thread
    assert rig.event() == {"stop": "halt", "id": turn}
    recognizer.permit.set()
    rig.hear(SILENCE, PAUSE)
    rig.mark(Kind.BEGIN, "2")
    rig.mark(Kind.END, "2")
    assert rig.event() == {"heard": {"id": "2", "text": ""}}, "no second report before it"


def test_late_stop_hides_no_stop_of_the_next_utterance() -> None:
    rig = Rig()
    rig.hear(sound_of("what is the battery"), 8)
    rig.hear(SILENCE, PAUSE)
    rig.hear(sound_of("hold"), 8)
    rig.listener._stop("stop", 1)  # as from the spotter's thread, of the first utterance
    rig.hear(SILENCE, PAUSE)
    assert rig.event() == {"stop": "stop", "id": ""}
    assert rig.event() == {"stop": "halt", "id": ""}


def test_stop_in_an_utterance_of_two_turns_is_of_none() -> None:
    rig = Rig()
    rig.mark(Kind.BEGIN, "1")
    rig.hear(sound_of("what is the battery"), 8)
    rig.mark(Kind.BEGIN, "2")
    assert rig.say_until_stopped()["id"] == ""


def test_speech_outside_turns_is_no_sentence() -> None:
    rig = Rig()
    rig.hear(sound_of("what is the battery"), 8)
    rig.hear(SILENCE, PAUSE)
    rig.mark(Kind.BEGIN, "1")
    rig.mark(Kind.END, "1")
    assert rig.event() == {"heard": {"id": "1", "text": ""}}


def test_turn_has_the_sound_between_its_marks() -> None:
    rig = Rig()
    rig.hear(SILENCE, 10)
    rig.mark(Kind.BEGIN, "1")
    rig.hear(sound_of("what is the battery"), 8)
    rig.mark(Kind.END, "another")
    rig.mark(Kind.END, "1")
    assert rig.event() == {"heard": {"id": "1", "text": "what is the battery"}}


def test_turn_has_the_sound_just_before_its_begin() -> None:
    rig = Rig()
    rig.hear(sound_of("yes"))
    rig.mark(Kind.BEGIN, "1")
    rig.mark(Kind.END, "1")
    assert rig.event() == {"heard": {"id": "1", "text": "yes"}}


def test_turns_beyond_what_waits_are_not_understood() -> None:
    rig = Rig()
    for number in range(20):
        rig.hear(sound_of("hang"))
        rig.mark(Kind.BEGIN, str(number))
        rig.mark(Kind.END, str(number))
    assert rig.event()["heard"]["text"] == ""


class LongestSound(LoudnessRecognizer):
    """Notes how much sound it gets at most."""

    longest = 0

    def transcribe(self, sound: bytes) -> str:
        self.longest = max(self.longest, len(sound))
        return super().transcribe(sound)


def test_turn_has_a_greatest_length() -> None:
    recognizer = LongestSound()
    rig = Rig(recognizer)
    rig.mark(Kind.BEGIN, "1")
    rig.hear(sound_of("yes"))
    rig.hear(SILENCE, listener._MAX_TURN_MS // FRAME_MS)
    rig.mark(Kind.END, "1")
    assert rig.event() == {"heard": {"id": "1", "text": ""}}  # its beginning was dropped
    assert recognizer.longest == listener._MAX_TURN_MS // FRAME_MS * FRAME_BYTES


def test_recognizer_that_hangs_in_a_window_ends_the_listener(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stop_spotter, "MAX_WINDOW_S", 0.0)
    recognizer = LateWindows()
    rig = Rig(recognizer)
    rig.hear(sound_of("what is the battery"), 8)
    wait_until(functools.partial(recognizer.has_begun, 1), "a window")
    with pytest.raises(SpeechUnavailable, match="busy"):
        rig.hear(SILENCE)
    recognizer.permits.release(100)


def test_frame_of_another_size_is_ignored() -> None:
    rig = Rig()
    rig.mark(Kind.BEGIN, "1")
    for sound in (b"", b"\xff" * 3, sound_of("yes") * 2):
        rig.hear(sound)
    rig.mark(Kind.END, "1")
    assert rig.event() == {"heard": {"id": "1", "text": ""}}


def test_setup_has_names_for_the_recognizer() -> None:
    rig = Rig()
    setup = {"names": {"locations": ["sink"]}, "start_level": 0.9, "end_level": 0.9}
    rig.listener.handle(Kind.SETUP, json.dumps(setup).encode())
    assert rig.recognizer.names == Names(locations=("sink",))
    rig.hear(sound_of("hold"), 8)  # below the level that speech begins at
    rig.hear(SILENCE, PAUSE)
    rig.mark(Kind.BEGIN, "1")
    rig.mark(Kind.END, "1")
    assert rig.event() == {"heard": {"id": "1", "text": ""}}


def test_process_says_when_it_is_ready_and_ends_with_its_input() -> None:
    target = io.BytesIO()
    run(LoudnessRecognizer, io.BytesIO(encode(Kind.SOUND, bytes(FRAME_BYTES))), target)
    assert target.getvalue() == b'{"ready": true}\n'


def test_process_says_what_is_missing() -> None:
    def fail() -> LoudnessRecognizer:
        raise SpeechUnavailable(MISSING_PACKAGES)

    target = io.BytesIO()
    run(fail, io.BytesIO(), target)
    assert json.loads(target.getvalue()) == {"missing": MISSING_PACKAGES}
