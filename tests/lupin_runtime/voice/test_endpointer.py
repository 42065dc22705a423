"""The endpointer finds beginning and end of speech in synthetic sounds."""

from __future__ import annotations

import array
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.console.settings import SETTINGS
from lupin_runtime.voice.endpointer import (
    FRAME_BYTES,
    FRAME_MS,
    SAMPLE_RATE_HZ,
    Edge,
    Endpointer,
    EndpointerSettings,
    rms,
    split_frames,
)

FRAME_SAMPLES = FRAME_BYTES // 2


def tone(level: float, milliseconds: int = FRAME_MS) -> bytes:
    """A sine of 440 Hz, whose root mean square is the level."""
    count = SAMPLE_RATE_HZ * milliseconds // 1000
    peak = level * math.sqrt(2) * 32767
    return array.array("h", (round(peak * math.sin(2 * math.pi * 440 * n / SAMPLE_RATE_HZ)) for n in range(count))).tobytes()


def edges(sound: bytes, endpointer: Endpointer) -> list[tuple[int, Edge]]:
    """The edges, each with the time in ms at which its frame ends."""
    found = ((index * FRAME_MS, endpointer.push(frame)) for index, frame in enumerate(split_frames(sound), 1))
    return [(time_ms, edge) for time_ms, edge in found if edge is not None]


def test_defaults_are_those_of_the_settings() -> None:
    defaults = {setting.name: setting.default for setting in SETTINGS}
    settings = EndpointerSettings()
    assert (
        defaults.items()
        >= {
            "voiceVadStartThreshold": settings.start_level,
            "voiceVadEndThreshold": settings.end_level,
            "voiceVadEndHoldMs": settings.end_hold_ms,
            "voiceVadMaxUtteranceMs": settings.max_utterance_ms,
        }.items()
    )


def test_speech_ends_after_the_hold() -> None:
    sound = tone(0.0, 500) + tone(0.1, 1000) + tone(0.0, 2000)
    assert edges(sound, Endpointer()) == [(550, Edge.BEGIN), (2300, Edge.END)]


def test_pause_that_is_shorter_than_the_hold_is_bridged() -> None:
    sound = tone(0.1, 500) + tone(0.0, 750) + tone(0.1, 500) + tone(0.0, 1000)
    assert edges(sound, Endpointer()) == [(50, Edge.BEGIN), (2550, Edge.END)]


def test_level_between_the_thresholds_goes_on_but_begins_nothing() -> None:
    assert edges(tone(0.015, 3000), Endpointer()) == []
    assert edges(tone(0.05, 200) + tone(0.015, 3000), Endpointer()) == [(50, Edge.BEGIN)]


def test_long_utterance_is_cut_at_its_limit() -> None:
    endpointer = Endpointer()
    found = edges(tone(0.1, 16_000), endpointer)
    assert found == [(50, Edge.BEGIN), (15_000, Edge.END), (15_050, Edge.BEGIN)]


def test_utterance_has_a_little_of_what_was_before() -> None:
    endpointer = Endpointer()
    before, speech, after = tone(0.01, 1000), tone(0.1, 300), tone(0.0, 800)
    edges(before + speech + after, endpointer)
    assert endpointer.utterance == before[-5 * FRAME_BYTES :] + speech + after


def test_second_utterance_has_nothing_of_the_first() -> None:
    endpointer = Endpointer()
    edges(tone(0.1, 500) + tone(0.0, 1000) + tone(0.2, 200) + tone(0.0, 800), endpointer)
    assert len(endpointer.utterance) == FRAME_BYTES * (4 + 4 + 16)  # after the first one's end only 200 ms were quiet


def test_noise_below_the_threshold_begins_nothing() -> None:
    draw = random.Random(2)
    noise = array.array("h", (round(draw.gauss(0, 0.01 * 32767)) for _ in range(SAMPLE_RATE_HZ * 10))).tobytes()
    assert edges(noise, Endpointer()) == []


@pytest.mark.parametrize("level", [0.0, 0.01, 0.5, 0.7])
def test_level_is_the_root_mean_square(level: float) -> None:
    assert rms(tone(level)) == pytest.approx(level, abs=1e-4)


def test_odd_and_empty_frames_have_a_level() -> None:
    assert rms(b"") == rms(b"\1") == 0.0
    assert rms(b"\xff\x7f\x01") == pytest.approx(1.0, abs=1e-3)


@given(st.lists(st.floats(0.0, 0.5), max_size=60))
def test_edges_alternate_and_utterances_are_bounded(levels: list[float]) -> None:
    endpointer = Endpointer(EndpointerSettings(end_hold_ms=150, max_utterance_ms=500))
    found = edges(b"".join(tone(level) for level in levels), endpointer)
    assert [edge for _, edge in found] == [(Edge.BEGIN, Edge.END)[index % 2] for index in range(len(found))]
    assert len(endpointer.utterance) <= FRAME_BYTES * (500 + 250) // FRAME_MS


def test_split_fills_the_last_frame_with_silence() -> None:
    assert [*split_frames(b"\1" * (FRAME_BYTES + 2))] == [b"\1" * FRAME_BYTES, b"\1\1" + b"\0" * (FRAME_BYTES - 2)]
    assert list(split_frames(b"")) == []
