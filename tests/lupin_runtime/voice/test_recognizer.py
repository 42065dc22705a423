"""Commands are recognized by what is likeliest among them, never talk; what is missing is named.

The sounds are espeak-ng's, with noise, as `bench_voice` makes them. Freely written, the first is "Calibrations targets".
"""

from __future__ import annotations

import gc
import importlib.util
import random
import sys
import types
import weakref
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lupin_runtime.voice.endpointer import SAMPLE_RATE_HZ
from lupin_runtime.voice.grammar import has_stop_word, parse
from lupin_runtime.voice.moonshine import Heard, Moonshine
from lupin_runtime.voice.recognizer import (
    ACTING_DOUBT,
    ASKED_DOUBT,
    MAX_DOUBT,
    MIN_MARGIN,
    MISSING_PACKAGES,
    PART_DOUBT,
    VALUE_MARGIN,
    CommandRecognizer,
    _unclear,
    choose,
    missing_packages,
)
from lupin_runtime.voice.slots import Names
from lupin_runtime.voice.sounds import read_wav_file
from lupin_runtime.voice.speech import SpeechUnavailable
from lupin_runtime.voice.tools import BY_NAME, Effect
from lupin_runtime.voice.utterance import Call, Question
from tests.support.spoken_commands import CONTEXT, NAMES

SOUNDS = Path(__file__).parent / "sounds"
COMMIT = Call("calibrate_arm", {"action": "commit"})
READINGS = (
    "Yes.", "No.", "Commit.", "Go home.", "Stop.", "Say hello.", "Save here as", "What is the battery?", "E-stop", "Cancel.",
    "Gripper 40%.", "", "Start recording", "or",
)  # fmt: skip


@pytest.fixture(scope="module")
def recognizer() -> CommandRecognizer:
    return CommandRecognizer(NAMES, threads=1)


def heard(recognizer: CommandRecognizer, name: str) -> str:
    return recognizer.transcribe(read_wav_file(SOUNDS / f"{name}.wav"))


# -- the model ---------------------------------------------------------------------------------------------------------
def test_command_that_is_written_wrongly_is_understood(recognizer: CommandRecognizer) -> None:
    sound = read_wav_file(SOUNDS / "calibration_status.wav")
    assert isinstance(parse(recognizer.transcribe_window(sound), CONTEXT), Question)
    assert parse(recognizer.transcribe(sound), CONTEXT) == Call("calibrate_arm", {"action": "status"})


def test_talk_is_no_command(recognizer: CommandRecognizer) -> None:
    assert isinstance(parse(heard(recognizer, "lights_are_blue_today"), CONTEXT), Question)


def test_number_is_right_or_asked_again(recognizer: CommandRecognizer) -> None:
    result = parse(heard(recognizer, "turn_left_ninety_degrees"), CONTEXT)
    assert isinstance(result, Question) or result == Call("rotate", {"angle_deg": 90.0})


def test_stop_is_heard_in_a_window(recognizer: CommandRecognizer) -> None:
    sound = read_wav_file(SOUNDS / "stop_robot.wav")
    assert has_stop_word(recognizer.transcribe_window(sound)) and has_stop_word(recognizer.transcribe(sound))


def test_host_off_is_not_heard_as_a_stop(recognizer: CommandRecognizer) -> None:
    sound = read_wav_file(SOUNDS / "host_off.wav")  # written as "those top and from the bottom"
    assert not has_stop_word(recognizer.transcribe_window(sound))


def test_other_words_are_not_taken_for_halt(recognizer: CommandRecognizer) -> None:
    assert recognizer.may_be_halt(read_wav_file(SOUNDS / "halt.wav"))
    for other in ("slower", "help"):
        assert not recognizer.may_be_halt(read_wav_file(SOUNDS / f"{other}.wav")), other


@pytest.mark.parametrize("seconds", [0.0, 0.01, 1.5])
@pytest.mark.parametrize("level", [0, 500, 32767])
def test_noise_is_no_command(recognizer: CommandRecognizer, seconds: float, level: int) -> None:
    draw = random.Random(1)
    samples = (draw.randint(-level, level) for _ in range(int(seconds * SAMPLE_RATE_HZ)))
    sound = b"".join(sample.to_bytes(2, "little", signed=True) for sample in samples)
    result = parse(recognizer.transcribe(sound), CONTEXT)
    assert isinstance(result, Question) or result == Call("engage_estop")


def test_names_count_from_the_next_sentence_on() -> None:
    recognizer = CommandRecognizer(threads=1)
    sound = read_wav_file(SOUNDS / "calibration_status.wav")
    before = recognizer.transcribe(sound)
    recognizer.expect(Names(sequences=("water",)))
    assert recognizer.transcribe(sound) == before


def test_only_the_graph_of_the_present_names_is_kept() -> None:
    recognizer = CommandRecognizer(threads=1)
    sound = read_wav_file(SOUNDS / "calibration_status.wav")
    built = []
    for number in range(3):
        recognizer.expect(Names(sequences=(f"water {number}",)))
        recognizer.transcribe(sound)
        assert recognizer._graph is not None
        built.append(weakref.ref(recognizer._graph[1]))
    gc.collect()
    assert [each() is None for each in built] == [True, True, False]


# -- the choice --------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("written", "gains", "chosen"),
    [
        ("Calibrations targets.", {"calibration status": 2.0}, "calibration status"),
        ("Blotter tark fave", {"go to tag 5": -MAX_DOUBT}, "go to tag 5"),
        ("Blotter tark fave", {"go to tag 5": -MAX_DOUBT - 0.1}, "go to tag 5?"),
        ("Blotter tark fave", {"go to tag 5": -ASKED_DOUBT - 0.1}, ""),
        ("Lazy screw", {"lights blue": -ACTING_DOUBT}, "lights blue"),
        ("Lazy screw", {"lights blue": -ACTING_DOUBT - 0.1}, "lights blue?"),
        ("Where is the water", {"where are you": -MAX_DOUBT - 0.1}, ""),  # a question mark would not keep it from acting,
        ("Freeze them", {"freeze the arm": -MAX_DOUBT - 0.1}, ""),  # nor this
        ("Gripper for tea", {"gripper 40%": -1.0, "gripper forty percent": -1.2}, "gripper 40%"),
        ("Gripper for tea", {"gripper 40%": -1.0, "gripper 14%": -1.0 - VALUE_MARGIN + 0.1}, "gripper 40%?"),
        ("Gripper for tea", {"gripper 14%": -1.0, "gripper 40%": -1.5}, "gripper 40%?"),  # people say round numbers
        ("Gripper for tea", {"gripper 400%": -1.0, "gripper 40%": -1.5}, ""),  # a number out of range
        ("Gripper for tea", {"gripper 40%": -1.0, "gripper 14%": -1.0 - VALUE_MARGIN}, "gripper 40%"),
        ("Open the ripper", {"open the gripper": -1.0, "go home": -1.0 - MIN_MARGIN + 0.1}, ""),
        ("Open the paper", {"open the gripper": -1.0, "go home": -1.0 - MIN_MARGIN + 0.1}, "open the gripper?"),
        ("Open the ripper", {"open the gripper": -1.0, "go home": -1.0 - MIN_MARGIN}, "open the gripper"),
        ("Don't to the sink", {"go to the sink": -PART_DOUBT}, "go to the sink"),
        ("Don't go to the sink", {"go to the sink": -PART_DOUBT - 0.1}, ""),
        ("Don't do it", {"don't do it": -2.0}, "don't do it"),
        ("Same here, that's zinc", {"save here as sink": -ACTING_DOUBT}, "save here as sink"),
        (
            "Remember this place as wrote two",
            {"remember this place as row two": -ACTING_DOUBT},
            "remember this place as row two",
        ),
        # They would confirm what was read back.
        ("Go a head", {"go ahead": 5.0}, ""),
        ("Come it", {"commit": 5.0}, ""),
        ("Now", {"no": -2.0}, "no"),
    ],
)
def test_sentence_is_chosen_if_it_is_likely_and_clear(written: str, gains: dict[str, float], chosen: str) -> None:
    assert choose({written: 0.0, "Bla": -1.0}, gains, NAMES) == (chosen or written)


@pytest.mark.parametrize("written", ["Never go to the sink", "Go to the sink or the door", "We would go to the sink"])
def test_word_that_was_heard_once_must_not_be_left_out(written: str) -> None:
    doubtful, clear = {"go to the sink": -PART_DOUBT - 0.1}, {"go to the sink": -PART_DOUBT}
    heard = {"Now go to the sing": 0.0, written: -0.1, "Bla": -1.0}
    assert choose(heard, doubtful, NAMES) == "go to the sink?"
    assert choose(heard, clear, NAMES) == "go to the sink"
    # Nor is it asked whether it was meant, if it was written.
    assert choose({written: 0.0, "Now go to the sing": -0.1, "Bla": -1.0}, doubtful, NAMES) == written


def meant(text: str) -> Call | None:
    """Return the call that is read back for a text that does nothing."""
    result = parse(text, CONTEXT)
    return result.meant if isinstance(result, Question) else None


def is_asked_again(text: str) -> bool:
    """Return whether a text does nothing, whatever was read back before."""
    contexts = (CONTEXT, *(replace(CONTEXT, pending=call) for call in (Call("rotate", {"angle_deg": 9.0}), COMMIT)))
    return all(isinstance(parse(text, context), Question) for context in contexts)


@pytest.mark.parametrize(
    ("heard", "gains", "chosen"),
    [
        # What was written is a command itself: a sentence that means something else must be clearly likelier, or less likely.
        ({"Go home.": 0.0}, {"open the gripper": MIN_MARGIN + 0.1}, "open the gripper"),
        ({"Go home.": 0.0}, {"open the gripper": MIN_MARGIN - 0.1}, "open the gripper?"),
        ({"Go home.": 0.0}, {"open the gripper": 0.1 - MIN_MARGIN}, "Go home?"),
        ({"Go home.": 0.0}, {"open the gripper": -MIN_MARGIN}, "Go home."),
        ({"Gripper 15%.": 0.0}, {"gripper 50%": 0.1 - VALUE_MARGIN}, "Gripper 15%?"),
        ({"Gripper 14%.": 0.0}, {"gripper 40%": -VALUE_MARGIN}, "Gripper 14%."),
        ({"Gripper 40%.": 0.0}, {"gripper 40%": -0.2, "gripper 14%": -0.4}, "Gripper 40%."),
        # So must what was written of a slower sound.
        ({"Gripper 40%.": 0.0, "Gripper 14%.": -0.5}, {"gripper 40%": -0.2}, "Gripper 40%?"),
        ({"Gripper 40%.": 0.0, "Gripper 14%.": -VALUE_MARGIN}, {"gripper 40%": -0.2}, "Gripper 40%."),
        ({"Go home.": 0.0, "No.": -0.1}, {"go home": -0.2}, "Go home?"),
        ({"Go home.": -0.1, "No.": 0.0}, {"go home": -0.2}, ""),
        ({"Go to the sink.": 0.0, "Never go to the sink.": -0.1}, {"go to the sink": -0.6}, "Go to the sink?"),
        ({"Save here as think.": 0.0}, {"save here as sink": -ACTING_DOUBT}, "save here as sink"),  # any text is a new name
        ({"Save here as sink.": 0.0}, {"go home": 0.0}, "Save here as sink?"),
        # Without a sentence of the grammar.
        ({"Go home.": 0.0}, {}, "Go home."),
        ({"Go home.": 0.0, "Open the gripper.": 0.0}, {}, "Go home?"),
        ({"Say good morning.": 0.0, "Say good morning": 0.0}, {"hold on": -9.0}, "Say good morning."),
        ({"Battery status.": 0.0, "Freeze the arm.": 0.0}, {}, ""),
        ({"No.": 0.0}, {"go home": -0.2}, ""),
        ({"No.": 0.0}, {"no": -0.2}, "no"),
    ],
)
def test_two_readings_are_asked_again(heard: dict[str, float], gains: dict[str, float], chosen: str) -> None:
    text = choose(heard, gains, NAMES)
    assert text == chosen if chosen else is_asked_again(text) and meant(text) is None
    assert not chosen.endswith("?") or (is_asked_again(text) and meant(text))


@pytest.mark.parametrize(
    ("heard", "gains"),
    [
        # Written were a no, or what stops.
        ({"No.": 0.0}, {"go home": 0.3}),
        ({"Never mind.": 0.0}, {"open the gripper": -0.4}),
        ({"Hold on.": 0.0}, {"go to the sink": -0.3}),
        # What stops, or reads, is likelier, or a number out of range is.
        ({"Gold on": 0.0}, {"hold on": -0.1, "where are you": -0.3, "open the gripper": -8.0}),
        ({"Battery.": 0.0, "Where are you.": -0.1}, {"go to the sink": -8.0}),
        ({"Gripper for tea": 0.0}, {"gripper 400%": -1.0, "gripper 40%": -1.5}),
        # A word that denies was written.
        ({"Don't go to the sink.": 0.0, "Go to the sink.": -0.3}, {}),
        ({"Don't go to the sink.": 0.0}, {"go to the sink": -PART_DOUBT - 0.1}),
        # What commits is never supposed.
        ({"Come at": 0.0}, {"commit": -3.0}),
        ({"Come at": 0.0}, {"commit?": -3.0}),
        ({"Come at": 0.0}, {"arm at zero": -3.0, "arm is at zero?": -2.9}),
    ],
)
def test_command_is_not_supposed(heard: dict[str, float], gains: dict[str, float]) -> None:
    result = parse(choose(heard, gains, NAMES), CONTEXT)
    assert meant(choose(heard, gains, NAMES)) is None
    assert not isinstance(result, Call) or BY_NAME[result.tool].effect in (Effect.READ, Effect.STOP)


def test_new_name_that_was_written_is_kept() -> None:
    heard = {"Save here as workbench.": 0.0}
    assert choose(heard, {"save here as kitchen": -MAX_DOUBT - 0.1}, NAMES) == "Save here as workbench."
    assert choose(heard, {"save here as kitchen": -MAX_DOUBT}, NAMES) == "save here as kitchen?"


@pytest.mark.parametrize("gain", [-ACTING_DOUBT, -ACTING_DOUBT - 0.1])
def test_cancel_may_discard_a_recording_and_must_be_likely(gain: float) -> None:
    assert choose({"Lazy screw": 0.0}, {"cancel": gain}, NAMES) == ("cancel" if gain == -ACTING_DOUBT else "Lazy screw")


def test_command_that_is_asked_is_read_back() -> None:
    sentence = "drive forward at 0.2 metres per second for one second"
    heard = {f"{sentence.capitalize()}?": 0.0}
    assert meant(choose(heard, {sentence: -3.0}, NAMES)) == parse(sentence, CONTEXT)
    assert choose({"Lazy screw": 0.0}, {"lights blue?": -0.1, "lights blue": -0.3}, NAMES) == "lights blue?"
    assert choose({"What is the battery?": 0.0}, {"what is the battery?": -0.1}, NAMES) == "what is the battery?"


@pytest.mark.parametrize("gain", [-ACTING_DOUBT, -ACTING_DOUBT - 0.1])
@pytest.mark.parametrize("sentence", ["save the recording as dance", "slower", "go faster", "cancel the calibration"])
def test_what_acts_without_a_yes_must_be_likelier(sentence: str, gain: float) -> None:
    assert choose({"Lazy screw": 0.0}, {sentence: gain}, NAMES) == (sentence if gain == -ACTING_DOUBT else f"{sentence}?")


def test_question_shows_both_readings() -> None:
    assert choose({"Battery status.": 0.0}, {"freeze the arm": 0.0}, NAMES) == "Battery status or freeze the arm?"


@given(st.lists(st.sampled_from([*READINGS, *(f"{one} {two}" for one in READINGS for two in READINGS)]), min_size=2))
def test_doubtful_reading_never_does_anything(texts: list[str]) -> None:
    assert is_asked_again(_unclear(texts, NAMES))


@pytest.mark.parametrize(
    ("texts", "is_yes"),
    [
        (["Yes.", "Yes.", "Yes."], True),
        (["Yes.", "Yeah.", "Go ahead."], True),
        (["Commit.", "Commit.", "Commit."], True),
        (["Yes.", "No.", "Yes."], False),
        (["Yes.", "Yes.", "Yet."], False),
        (["Yes.", "Yes.", ""], False),
        (["Yes.", "Stop.", "Yes."], False),
        (["Yes.", "Commit.", "Commit."], False),
        (["Lights blue?", "Stop.", "Lights blue."], False),
        (["Commit.", "Commit", "Commit?"], False),
        (["Commit.", "Commit.", "Comet."], False),
    ],
)
def test_yes_counts_only_if_it_is_heard_each_time(
    recognizer: CommandRecognizer, monkeypatch: pytest.MonkeyPatch, texts: list[str], is_yes: bool
) -> None:
    written = iter(texts)
    monkeypatch.setattr(Moonshine, "write", lambda *_: Heard(next(written), 0.0))
    monkeypatch.setattr(Moonshine, "search", lambda *_: pytest.fail("a yes is not searched for"))
    text = recognizer.transcribe(bytes(SAMPLE_RATE_HZ))
    assert text == texts[0] if is_yes else is_asked_again(text) and meant(text) is None


def test_command_with_a_stop_in_a_slower_sound_is_asked_again(
    recognizer: CommandRecognizer, monkeypatch: pytest.MonkeyPatch
) -> None:
    written = iter(["Go home.", "Go stop.", "Go home."])
    monkeypatch.setattr(Moonshine, "write", lambda *_: Heard(next(written), 0.0))
    assert is_asked_again(recognizer.transcribe(bytes(SAMPLE_RATE_HZ)))


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        (["Go stop.", "Go top.", "Go top."], "Go stop."),
        (["Go top.", "Go stop.", "Go halt."], "Go stop."),
        (["Go top.", "Go stop.", "Go top."], "Go top."),  # heard once among slower sounds: asked again, and no command
        (["la " * 100, "la", "la"], "la " * 100),
    ],
)
def test_stop_counts_in_slower_sounds(
    recognizer: CommandRecognizer, monkeypatch: pytest.MonkeyPatch, texts: list[str], expected: str
) -> None:
    written = iter(texts)
    monkeypatch.setattr(Moonshine, "write", lambda *_: Heard(next(written), 0.0))
    monkeypatch.setattr(Moonshine, "search", lambda *_: pytest.fail("no search is needed"))
    assert recognizer.transcribe(bytes(SAMPLE_RATE_HZ)) == expected


# -- what is missing ---------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("missing", ["onnxruntime", "moonshine_voice", ""])
def test_missing_packages_are_found_without_importing(monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == missing else object())
    assert missing_packages() == (MISSING_PACKAGES if missing else "")
    assert "moonshine_voice" not in sys.modules


def test_missing_package_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(SpeechUnavailable, match=r"pip install 'lupin\[voice\]'"):
        CommandRecognizer()
    monkeypatch.undo()
    monkeypatch.setitem(sys.modules, "lupin_runtime.voice.moonshine", None)
    with pytest.raises(SpeechUnavailable, match=r"pip install 'lupin\[voice\]'"):
        CommandRecognizer()


def test_package_without_its_model_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = types.SimpleNamespace(origin=str(tmp_path / "__init__.py"))
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: found)
    with pytest.raises(SpeechUnavailable, match=r"has no model; type: pip install"):
        CommandRecognizer()
